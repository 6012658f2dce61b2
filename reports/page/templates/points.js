// Points of plots under the pointer and with keys: the marked cell is marked in every plot, with a tip at the point.

const REACH = 28; // largest distance [pixels] at which the pointer is on a point

function followPoints(container, tipOf, open) {
  const tip = document.createElement("div");
  tip.className = "tip";
  tip.setAttribute("aria-hidden", "true");
  tip.hidden = true;
  container.append(tip);

  const show = (point) => {
    for (const other of container.querySelectorAll(".point")) {
      const same = point && other.dataset.line === point.dataset.line && other.dataset.i === point.dataset.i;
      other.classList.toggle("active", Boolean(same));
    }
    for (const band of container.querySelectorAll(".band")) {
      band.classList.toggle("active", Boolean(point) && band.dataset.line === point.dataset.line);
    }
    tip.hidden = !point;
    if (!point) return;
    tip.replaceChildren(...tipOf(point).map(([text, kind]) => {
      const line = document.createElement("div");
      line.textContent = text;
      line.className = kind ?? "";
      return line;
    }));
    const outer = container.getBoundingClientRect();
    const at = point.getBoundingClientRect();
    const left = at.left + at.width / 2 - outer.left;
    tip.style.left = `${Math.max(0, Math.min(left + 12, outer.width - tip.offsetWidth))}px`;
    const above = at.top - outer.top - tip.offsetHeight - 8;
    tip.style.top = `${above > 0 ? above : at.bottom - outer.top + 8}px`;
  };

  const nearest = (event) => {
    const svg = event.target.closest("svg");
    let found = null;
    let best = REACH;
    for (const point of svg ? svg.querySelectorAll(".point") : []) {
      const box = point.getBoundingClientRect();
      const distance = Math.hypot(box.left + box.width / 2 - event.clientX, box.top + box.height / 2 - event.clientY);
      if (distance < best) [found, best] = [point, distance];
    }
    return found;
  };

  const act = (point) => point?.dataset.key && open(point.dataset.key);

  container.addEventListener("pointermove", (event) => show(nearest(event)));
  container.addEventListener("pointerleave", () => show(container.querySelector(".point:focus-visible")));
  container.addEventListener("click", (event) => act(nearest(event)));
  container.addEventListener("focusin", (event) => event.target.closest(".point") && show(event.target.closest(".point")));
  container.addEventListener("focusout", () => show(null));
  container.addEventListener("keydown", (event) => {
    const point = event.target.closest(".point");
    if (!point) return;
    if (event.key === "Enter" || event.key === " ") act(point);
    else if (event.key === "Escape") show(null);
    else if (!move(point, event.key)) return;
    event.preventDefault();
  });
}

// Left and right move along a line, up and down to the next line; one point of each plot is in the tab order.
function move(point, key) {
  const all = [...point.ownerSVGElement.querySelectorAll(".point")];
  const lines = [...new Set(all.map((other) => other.dataset.line))];
  const own = all.filter((other) => other.dataset.line === point.dataset.line);
  const i = own.indexOf(point);
  const others = (step) => {
    const line = lines[lines.indexOf(point.dataset.line) + step];
    const members = all.filter((other) => other.dataset.line === line);
    return members[Math.min(i, members.length - 1)];
  };
  const target = {
    ArrowRight: () => own[i + 1], ArrowLeft: () => own[i - 1], ArrowDown: () => others(1), ArrowUp: () => others(-1),
    Home: () => own[0], End: () => own.at(-1),
  }[key]?.();
  if (!target) return key.startsWith("Arrow");
  point.setAttribute("tabindex", -1);
  target.setAttribute("tabindex", 0);
  target.focus();
  return true;
}
