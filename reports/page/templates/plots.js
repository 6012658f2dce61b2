// The plots of the page: the choices, the lines as a legend, and one drawing for each panel of each figure.

function openCell(key) {
  document.dispatchEvent(new CustomEvent("open-cell", { detail: { key } }));
}

// A panel with its axes and lines, which the data store once for all panels.
function unpacked(panel, pool) {
  const all = (places) => places && places.map((place) => pool[place]);
  const lines = panel.lines.map(([x, y, rest]) => {
    const { label, keys, hollow, band, interval, spread, slope, beside } = pool[rest];
    return {
      ...pool[label], x: pool[x], y: pool[y], keys: pool[keys], hollow: pool[hollow], slope,
      band: all(band), interval: all(interval), spread: all(spread),
      beside: beside.map(({ title, values, spread: ends }) => ({ title, values: pool[values], spread: all(ends) })),
    };
  });
  return { ...panel, x: pool[panel.x], y: pool[panel.y], fronts: pool[panel.fronts], lines };
}

// What the data of the plots hold.
async function plotData() {
  const bytes = await inflated(bytesOf(document.getElementById("plot-data").textContent));
  return JSON.parse(new TextDecoder().decode(bytes));
}

function plots({ figures, options: titles, pool }, container) {
  if (!figures.some(({ cases }) => cases.length)) return;
  const [form, key, nothing, boxes] = ["controls", "key", "nothing", "options"].map(
    (name) => document.getElementById(`plot-${name}`));
  const hidden = new Set(); // indices of lines, which are the same in every case over one quantity
  const without = new Set(); // values of options whose lines are neither in plots nor in the legend
  const names = Object.keys(titles);
  const selects = Object.fromEntries(names.map((name) => [name, selectOf(name, titles[name])]));
  let drawn = []; // the panels that are shown, each with its element

  function selectOf(name, title) {
    const select = Object.assign(document.createElement("select"), { id: `plot-${name}` });
    const label = document.createElement("label");
    label.append(`${title} `, select);
    form.insertBefore(label, boxes);
    return select;
  }

  const agrees = ({ given }, among) => among.every((name) => !(name in given) || pool[given[name]].name === selects[name].value);

  // The choices of an option, given the options before it; the present choice stays if it is among them.
  const offer = (name) => {
    const before = names.slice(0, names.indexOf(name));
    const places = new Set(figures.flatMap(({ cases }) => cases)
      .filter((each) => name in each.given && agrees(each, before)).map(({ given }) => given[name]));
    const chosen = selects[name].value;
    const choices = [...places].map((place) => pool[place]);
    const option = ({ name: value, title }) => new Option(title, value);
    const parts = [...new Set(choices.map(({ part }) => part))];
    selects[name].replaceChildren(...parts.flatMap((label) => {
      const offered = choices.filter(({ part }) => part === label).map(option);
      if (!label) return offered;
      const group = Object.assign(document.createElement("optgroup"), { label });
      group.append(...offered);
      return [group];
    }));
    const values = [...selects[name].options].map(({ value }) => value);
    selects[name].value = values.includes(chosen) ? chosen : values[0];
  };

  const chosenCases = () => figures.flatMap(({ cases }) => cases.filter((each) => agrees(each, names)).slice(0, 1));

  // The panels for the present choices; a last resort only if there are no others.
  const chosenPanels = () => {
    const panels = chosenCases().flatMap((each) => each.panels).map((panel) => unpacked(panel, pool));
    const others = panels.filter(({ isLastResort }) => !isLastResort);
    return others.length ? others : panels.slice(0, 1);
  };

  // All lines of the panels without repetition, each with its slope in the first panel.
  const linesOf = (panels) => {
    const found = new Map();
    for (const line of panels.flatMap(({ lines }) => lines)) {
      const known = found.get(line.index);
      if (!known) found.set(line.index, line);
      else if (known.slope === null && line.slope !== null) found.set(line.index, { ...known, slope: line.slope });
    }
    return [...found.values()].sort((a, b) => a.index - b.index);
  };

  const isIn = (line) => Object.entries(line.options).every((option) => !without.has(option.join(" ")));

  const describe = (line, i, { x, y }) => {
    const across = x.atValues ? tick(line.x[i]) : number(line.x[i]);
    const size = y.names.length ? "" : line.hollow[i] ? ", at the noise floor" : `, ${y.name} ${number(line.y[i])}`;
    return `${line.name}, ${x.name} ${across}${size}`;
  };

  const tipOf = (point) => {
    const panel = drawn[point.closest("figure").dataset.panel].panel;
    const line = panel.lines.find((each) => String(each.index) === point.dataset.line);
    const i = Number(point.dataset.i);
    const ends = (pair) => pair.map((end) => number(end[i])).join(" to ");
    const row = (axis, value) => line.hollow[i] && axis.floor > 0
      ? `at the noise floor: ${axis.name} at most about ${number(axis.floor, 2)}`
      : `${axis.label}: ${axis.atValues ? tick(value) : number(value)}`;
    const [metric, value] = panel.y.names.length ? [panel.x, line.x[i]] : [panel.y, line.y[i]];
    const rows = [[line.name, "name"]];
    if (panel.x.atValues) rows.push([row(panel.x, line.x[i])]);
    rows.push([row(metric, value)]);
    if (line.band) rows.push([`95 % interval ${ends(line.band)}`]);
    if (line.interval) rows.push([`95 % interval by the reference's noise: ${ends(line.interval)}`]);
    if (panel.x !== metric && !panel.x.atValues) rows.push([row(panel.x, line.x[i])]);
    if (line.spread) rows.push([`runs from ${ends(line.spread)}`]);
    for (const { title, values, spread } of line.beside) {
      if (title === panel.y.label) continue;
      rows.push([`${title}: ${number(values[i])}${spread ? `, runs from ${ends(spread)}` : ""}`]);
    }
    if (point.dataset.key) rows.push(["click for its image", "hint"]);
    return rows;
  };

  const draw = () => {
    for (const { panel, figure } of drawn) {
      const width = Math.max(220, Math.floor(figure.clientWidth));
      const height = Math.round(panel.isMain ? Math.min(drawn.length === 1 ? 460 : 380, width * 0.72) : Math.min(260, width * 0.8));
      figure.replaceChildren(drawPlot({
        panel, width, height, describe: (line, i) => describe(line, i, panel),
        shown: (line) => !hidden.has(line.index) && isIn(line) }));
    }
  };

  // Only a choice makes the legend again: the focus on it must survive a drawing at another width.
  const choose = () => {
    const panels = chosenPanels();
    for (const { figure } of drawn) figure.remove();
    drawn = panels.map((panel, i) => {
      const figure = document.createElement("figure");
      figure.dataset.x = panel.name;
      figure.dataset.panel = i;
      figure.className = panels.length === 1 ? "whole" : panel.isMain ? "large" : "small";
      container.append(figure);
      return { panel, figure };
    });
    draw();
    key.replaceChildren(...linesOf(panels).filter(isIn).map(keyOf), ...floorKey(panels));
    nothing.textContent = chosenCases().map(({ note }) => note).filter(Boolean).join(" ");
    for (const table of document.querySelectorAll(".equal")) {
      table.hidden = Object.entries(table.dataset).some(([name, value]) => name in selects && selects[name].value !== value);
    }
  };

  // Another quantity has other lines.
  const chooseLines = () => {
    hidden.clear();
    without.clear();
    const others = figures.flatMap(({ cases }) => cases).filter((each) => agrees(each, ["over"]));
    boxes.replaceChildren(...optionsOf(linesOf(others.flatMap((each) => each.panels).map((panel) => unpacked(panel, pool)))));
  };

  // If lines differ in two options or more, a checkbox for each value hides or shows its lines.
  const optionsOf = (lines) => {
    const values = {};
    for (const line of lines) {
      for (const [name, value] of Object.entries(line.options)) (values[name] ??= new Set()).add(value);
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

  const keyOf = (line) => {
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
    if (line.slope !== null) {
      const slope = document.createElement("span");
      slope.className = "quiet";
      slope.textContent = ` slope ${number(line.slope)}`;
      button.append(slope);
    }
    button.addEventListener("click", () => {
      hidden.has(line.index) ? hidden.delete(line.index) : hidden.add(line.index);
      choose();
      key.children[linesOf(chosenPanels()).filter(isIn).findIndex(({ index }) => index === line.index)]?.firstChild.focus();
    });
    item.append(button);
    return item;
  };

  const floorKey = (panels) => {
    const panel = panels.find(({ y }) => y.isLog && y.floor > 0);
    if (!panel) return [];
    const item = document.createElement("li");
    item.className = "quiet floor-key";
    item.textContent = `noise floor: up to ${number(panel.y.floor, 2)}`;
    return [item];
  };

  form.hidden = false;
  document.getElementById("plot-note").hidden = false;
  followPoints(container, tipOf, openCell);
  form.addEventListener("change", (event) => {
    const changed = names.find((name) => selects[name] === event.target);
    if (changed) names.slice(names.indexOf(changed) + 1).forEach(offer);
    if (changed === "over") chooseLines();
    choose();
  });
  form.addEventListener("submit", (event) => event.preventDefault());
  names.forEach(offer);
  chooseLines();
  choose();
  let width = container.clientWidth;
  new ResizeObserver(() => {
    if (container.clientWidth === width) return;
    width = container.clientWidth;
    draw();
  }).observe(container);
}

async function drawPlots() {
  const container = document.getElementById("plots-drawn");
  if (!container) return;
  container.ariaBusy = "true";
  try {
    plots(await plotData(), container);
  } catch (error) {
    document.getElementById("plot-nothing").textContent =
      `The plots cannot be drawn (${error.message}); the tables below have the same numbers.`;
    throw error;
  } finally {
    container.ariaBusy = null;
  }
}

drawPlots();
