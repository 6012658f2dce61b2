// The plots of the page: what is chosen, its lines as a key, and one drawing a quantity.

function openCell(key) {
  document.dispatchEvent(new CustomEvent("open-cell", { detail: { key } }));
}

function plots() {
  const { places, metrics, quantities, colours } = JSON.parse(document.getElementById("plot-data").textContent);
  const container = document.getElementById("plots-drawn");
  if (!container || !places.length || !metrics.length) return;
  const controls = document.getElementById("plot-controls");
  const place = document.getElementById("plot-place");
  const metric = document.getElementById("plot-metric");
  const key = document.getElementById("plot-key");
  const nothing = document.getElementById("plot-nothing");
  const hidden = new Set(); // indices of lines, which are the same in every place

  const swept = places.some(({ of }) => Object.values(of).some(({ lines }) =>
    lines.some((line) => new Set(line.x.samples).size > 1)));
  const drawn = Object.entries(quantities).filter(([name]) => name !== "samples" || swept);
  const figures = drawn.map(([name, label]) => {
    const figure = document.createElement("figure");
    figure.dataset.x = name;
    figure.className = name === "samples" || name === "shade" ? "large" : "small";
    container.append(figure);
    return { name, label, figure };
  });

  const chosen = () => places[Number(place.value)].of[metric.value];

  const describe = (line, i, x) => {
    const size = line.floor[i] ? "at the noise floor" : `${metric.value} ${number(line.y[i])}`;
    const cost = x === "samples" ? "" : `, ${quantities[x]} ${number(line.x[x][i])}`;
    return `${line.name}, ${line.x.samples[i]} samples, ${size}${cost}`;
  };

  const tipOf = (point) => {
    const data = chosen();
    const line = data.lines.find((each) => String(each.index) === point.dataset.line);
    const i = Number(point.dataset.i);
    const x = point.closest("figure").dataset.x;
    const size = line.floor[i]
      ? `at the noise floor: ${metric.value} at most about ${number(2 * data.noise, 2)}`
      : `${data.label}: ${number(line.y[i])}`;
    const rows = [[line.name, "name"], [`${line.x.samples[i]} light samples a pixel`], [size]];
    if (line.low) rows.push([`95 % interval ${number(line.low[i])} to ${number(line.high[i])}`]);
    if (data.noise > 0) rows.push([`noise of the reference: ${number(data.noise, 2)}`]);
    rows.push([`${quantities.shade}: ${number(line.x.shade[i])}`]);
    if (x !== "samples" && x !== "shade") rows.push([`${quantities[x]}: ${number(line.x[x][i])}`]);
    if (point.dataset.key) rows.push(["click for its image", "hint"]);
    return rows;
  };

  const draw = () => {
    const data = chosen();
    for (const { name, label, figure } of figures) {
      const width = Math.max(220, Math.floor(figure.clientWidth));
      const height = Math.round(figure.className === "large" ? Math.min(380, width * 0.72) : Math.min(260, width * 0.8));
      figure.hidden = data.lines.every((line) => line.x[name].every((value) => value === 0));
      if (figure.hidden) continue;
      const svg = drawPlot({
        data, x: name, label, colours, width, height, describe, shown: (line) => !hidden.has(line.index) });
      figure.replaceChildren(svg);
    }
    const free = figures.filter(({ figure }) => figure.hidden).map(({ label }) => label.replace(/ \[.*/, ""));
    nothing.textContent = free.length ? `No cost at all, for any line: ${free.join(", ")}.` : "";
  };

  // The key is made anew only by a choice: a click on it must survive a drawing to another width.
  const choose = () => {
    draw();
    const data = chosen();
    key.replaceChildren(...data.lines.map(keyOf), ...floorKey(data));
    for (const table of document.querySelectorAll(".equal")) {
      table.hidden = table.dataset.place !== place.value || table.dataset.metric !== metric.value;
    }
  };

  const keyOf = (line) => {
    const item = document.createElement("li");
    const button = document.createElement("button");
    button.type = "button";
    button.setAttribute("aria-pressed", String(!hidden.has(line.index)));
    const colour = colourOf(line, colours);
    button.append(
      svgElement("svg", { viewBox: "-12 -7 24 14", width: 24, height: 14, "aria-hidden": "true" },
        svgElement("path", { d: "M-12 0H12", stroke: colour, "stroke-width": 1.5 }),
        svgElement("path", { d: markerPath(line.index), transform: `scale(${SIZE})`, fill: colour })),
      line.name);
    if (line.slope !== null) {
      const slope = document.createElement("span");
      slope.className = "quiet";
      slope.textContent = ` slope ${number(line.slope)}`;
      button.append(slope);
    }
    button.addEventListener("click", () => {
      hidden.has(line.index) ? hidden.delete(line.index) : hidden.add(line.index);
      choose();
      key.children[chosen().lines.indexOf(line)]?.firstChild.focus();
    });
    item.append(button);
    return item;
  };

  const floorKey = (data) => {
    if (!data.isLog || !(data.noise > 0)) return [];
    const item = document.createElement("li");
    item.className = "quiet floor-key";
    item.textContent = `twice the reference's noise: ${number(2 * data.noise, 2)}`;
    return [item];
  };

  controls.hidden = false;
  document.getElementById("plot-note").hidden = false;
  followPoints(container, tipOf, openCell);
  controls.addEventListener("change", choose);
  controls.addEventListener("submit", (event) => event.preventDefault());
  choose();
  let width = container.clientWidth;
  new ResizeObserver(() => {
    if (container.clientWidth === width) return;
    width = container.clientWidth;
    draw();
  }).observe(container);
}

plots();
