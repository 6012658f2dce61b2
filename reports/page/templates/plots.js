// The plots of the page: what is chosen, its lines as a key, and one drawing a quantity.

function openCell(key) {
  document.dispatchEvent(new CustomEvent("open-cell", { detail: { key } }));
}

function plots() {
  const { sweeps, metrics, costs, negligible } = JSON.parse(document.getElementById("plot-data").textContent);
  const container = document.getElementById("plots-drawn");
  if (!container || !metrics.length) return;
  const [controls, over, place, metric, key, nothing] = ["controls", "over", "place", "metric", "key", "nothing"].map(
    (name) => document.getElementById(`plot-${name}`));
  const options = document.getElementById("plot-options");
  const hidden = new Set(); // indices of lines, which are the same in every place of a sweep
  const without = new Set(); // values of options whose lines are out of plots and key

  const figures = ["over", ...Object.keys(costs)].map((name) => {
    const figure = document.createElement("figure");
    figure.dataset.x = name;
    container.append(figure);
    return { name, figure };
  });

  const swept = () => sweeps[Number(over.value)];
  const titleOf = (x) => (x === "over" ? swept().title : costs[x]);

  // The place under the metric; or under a cost, which is another number of the same cells.
  const chosen = () => {
    const { of } = swept().places[Number(place.value)];
    const y = metric.value;
    const found = of[y in costs ? metrics[0] : y];
    const data = { ...found, lines: found.lines.map((line) => ({ ...swept().labels[line.index], ...line })) };
    const isLinear = swept().name !== "samples" && data.lines.some((line) => line.x.over.some((value) => value <= 0));
    const slope = (line) => line.slopes[y in costs ? y : ""];
    if (!(y in costs)) return { ...data, isLinear, slope };
    const lines = data.lines.map((line) => ({ ...line, y: line.x[y], floor: [], low: null, high: null }));
    return { label: costs[y], noise: 0, isLog: true, isCost: true, fronts: {}, lines, isLinear, slope };
  };

  const isIn = (line) => Object.entries(line.options).every((option) => !without.has(option.join(" ")));

  const isHidden = (x, data) => {
    if (x === "over") return !swept().isSwept && !data.isCost;
    return data.isCost || !swept().hasCosts || data.lines.every((line) => line.x[x].every((value) => value < negligible[x]));
  };

  const describe = (line, i, x) => {
    const size = line.floor[i] ? "at the noise floor" : `${metric.value} ${number(line.y[i])}`;
    const cost = x === "over" ? "" : `, ${costs[x]} ${number(line.x[x][i])}`;
    return `${line.name}, ${swept().name} ${tick(line.x.over[i])}, ${size}${cost}`;
  };

  const tipOf = (point) => {
    const data = chosen();
    const line = data.lines.find((each) => String(each.index) === point.dataset.line);
    const i = Number(point.dataset.i);
    const x = point.closest("figure").dataset.x;
    const size = line.floor[i]
      ? `at the noise floor: ${metric.value} at most about ${number(2 * data.noise, 2)}`
      : `${data.label}: ${number(line.y[i])}`;
    const rows = [[line.name, "name"], [`${swept().title}: ${tick(line.x.over[i])}`], [size]];
    if (line.low) rows.push([`95 % interval ${number(line.low[i])} to ${number(line.high[i])}`]);
    if (data.noise > 0) rows.push([`noise of the reference: ${number(data.noise, 2)}`]);
    const shown = new Set(["shade", x].filter((cost) => cost !== "over" && cost !== metric.value));
    for (const cost of shown) rows.push([`${costs[cost]}: ${number(line.x[cost][i])}`]);
    if (line.spread && shown.has("shade")) rows.push([`runs from ${line.spread.map((end) => number(end[i])).join(" to ")} ms`]);
    if (point.dataset.key) rows.push(["click for its image", "hint"]);
    return rows;
  };

  const draw = () => {
    const data = chosen();
    const isAlone = figures.slice(1).every(({ name }) => isHidden(name, data));
    for (const { name, figure } of figures) {
      figure.hidden = isHidden(name, data);
      if (figure.hidden) continue;
      const isLarge = name === "over" || name === "shade";
      figure.className = name === "over" && isAlone ? "whole" : isLarge ? "large" : "small";
      const width = Math.max(220, Math.floor(figure.clientWidth));
      const height = Math.round(isLarge ? Math.min(isAlone ? 460 : 380, width * 0.72) : Math.min(260, width * 0.8));
      const svg = drawPlot({
        data, x: name, label: titleOf(name), width, height, describe,
        shown: (line) => !hidden.has(line.index) && isIn(line) });
      figure.replaceChildren(svg);
    }
    const free = isAlone ? [] : figures.filter(({ figure }) => figure.hidden && figure.dataset.x !== "over")
      .map(({ name }) => costs[name].replace(/ \[.*/, ""));
    nothing.textContent = free.length ? `No cost, or less than 0.01 ms, for any line: ${free.join(", ")}.` : "";
  };

  // The key is made anew only by a choice: a click on it must survive a drawing to another width.
  const choose = () => {
    draw();
    const data = chosen();
    key.replaceChildren(...data.lines.filter(isIn).map((line) => keyOf(line, data.slope(line))), ...floorKey(data));
    for (const table of document.querySelectorAll(".equal")) {
      table.hidden = swept().name !== "samples" || table.dataset.place !== place.value
        || table.dataset.metric !== metric.value;
    }
  };

  const chooseOver = () => {
    hidden.clear();
    without.clear();
    options.replaceChildren(...optionsOf(Object.values(swept().labels)));
    place.replaceChildren(...swept().places.map(({ title }, i) => new Option(title, i)));
  };

  // Where lines differ in two options or more, a box for each value: without it, its lines are away.
  const optionsOf = (labels) => {
    const values = {};
    for (const label of labels) {
      for (const [name, value] of Object.entries(label.options)) (values[name] ??= new Set()).add(value);
    }
    const several = Object.entries(values).filter(([, { size }]) => size > 1);
    return several.length < 2 ? [] : several.map(([name, each]) => {
      const group = document.createElement("span");
      group.setAttribute("role", "group");
      group.setAttribute("aria-label", name);
      group.append(name, ...[...each].map((value) => {
        const label = document.createElement("label");
        const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: true });
        box.addEventListener("change", () => without[box.checked ? "delete" : "add"](`${name} ${value}`));
        label.append(box, value);
        return label;
      }));
      return group;
    });
  };

  const keyOf = (line, fitted) => {
    const item = document.createElement("li");
    const button = document.createElement("button");
    button.type = "button";
    button.setAttribute("aria-pressed", String(!hidden.has(line.index)));
    const { colour } = line;
    button.append(
      svgElement("svg", { viewBox: "-15 -7 30 14", width: 30, height: 14, "aria-hidden": "true" },
        svgElement("path", { d: "M-15 0H15", stroke: colour, "stroke-width": 1.5, "stroke-dasharray": dashOf(line) }),
        svgElement("path", { d: markerPath(line.index), transform: `scale(${SIZE})`, fill: colour })),
      line.name);
    if (fitted !== null) {
      const slope = document.createElement("span");
      slope.className = "quiet";
      slope.textContent = ` slope ${number(fitted)}`;
      button.append(slope);
    }
    button.addEventListener("click", () => {
      hidden.has(line.index) ? hidden.delete(line.index) : hidden.add(line.index);
      choose();
      key.children[chosen().lines.filter(isIn).findIndex(({ index }) => index === line.index)]?.firstChild.focus();
    });
    item.append(button);
    return item;
  };

  const floorKey = (data) => {
    if (!data.isLog || !(data.noise > 0)) return [];
    const item = document.createElement("li");
    item.className = "quiet floor-key";
    const atMost = swept().kind ? "at most " : "";
    item.textContent = `twice the reference's noise: ${atMost}${number(2 * data.noise, 2)}`;
    return [item];
  };

  controls.hidden = false;
  document.getElementById("plot-note").hidden = false;
  followPoints(container, tipOf, openCell);
  over.addEventListener("change", chooseOver);
  controls.addEventListener("change", choose);
  controls.addEventListener("submit", (event) => event.preventDefault());
  chooseOver();
  choose();
  let width = container.clientWidth;
  new ResizeObserver(() => {
    if (container.clientWidth === width) return;
    width = container.clientWidth;
    draw();
  }).observe(container);
}

plots();
