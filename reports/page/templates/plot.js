// One plot as SVG: axes, the floor of the reference, the Pareto front, and lines with their points.

const MARGIN = { left: 52, right: 12, top: 24, bottom: 38 };
const SIZE = 4.2; // half of a marker [pixels]
const MARKERS = [
  "M-1 0A1 1 0 1 0 1 0A1 1 0 1 0 -1 0Z",
  "M-.9 -.9H.9V.9H-.9Z",
  "M0 -1.3L1.3 0L0 1.3L-1.3 0Z",
  "M0 -1.2L1.15 .9H-1.15Z",
  "M0 1.2L1.15 -.9H-1.15Z",
  "M-.4 -1.2H.4V-.4H1.2V.4H.4V1.2H-.4V.4H-1.2V-.4H-.4Z",
  "M-1.1 -.6L-.6 -1.1L0 -.5L.6 -1.1L1.1 -.6L.5 0L1.1 .6L.6 1.1L0 .5L-.6 1.1L-1.1 .6L-.5 0Z",
];

function svgElement(name, attributes = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

const DASHES = ["none", "7 2", "2 2", "8 2 2 2"];

function markerPath(index) {
  return MARKERS[index % MARKERS.length];
}

// `data` is one place under one metric or cost; `shown` says which of its lines are; `x` names the quantity across,
// which is "over" for what is swept.
function drawPlot({ data, shown, x, label, width, height, describe }) {
  const lines = data.lines.filter((line) => shown(line));
  const visible = (line, i) => line.y[i] !== null && line.x[x][i] !== null && (line.y[i] > 0 || !data.isLog || data.isCost);
  const indices = (line) => line.y.map((_, i) => i).filter((i) => visible(line, i));
  const across = [...new Set(lines.flatMap((line) => indices(line).map((i) => line.x[x][i])))];
  if (x === "shade" && !data.isCost) across.push(...lines.flatMap((line) => (line.spread ?? []).flat()).filter((v) => v > 0));
  const up = lines.flatMap((line) => indices(line).map((i) => line.y[i]));
  const floor = data.isLog ? 2 * data.noise : 0;
  const showsFloor = up.length > 0 && floor > Math.min(...up) / 30;
  const area = { left: MARGIN.left, right: width - MARGIN.right, top: MARGIN.top, bottom: height - MARGIN.bottom };
  const isLinear = x === "over" && data.isLinear;
  const horizontal = (isLinear ? linearScale : logScale)(across.length ? across : [1], [area.left, area.right]);
  if (x === "over" && !isLinear && fit(horizontal, across)) Object.assign(horizontal, { major: across, minor: [] });
  const vertical = (data.isLog ? logScale : linearScale)(
    up.length ? [...up, ...(showsFloor ? [floor] : [])] : [1], [area.bottom, area.top], 1.6);
  const place = (line, i) => [horizontal.at(line.x[x][i]), vertical.at(line.y[i])];

  const svg = svgElement("svg", {
    viewBox: `0 0 ${width} ${height}`, width, height, role: "group",
    "aria-label": `${data.label} over ${label}; ${up.length} points`,
  });
  if (showsFloor) {
    const top = vertical.at(floor);
    svg.append(svgElement("rect", {
      class: "floor", x: area.left, y: top, width: area.right - area.left, height: area.bottom - top }));
  }
  svg.append(axes(horizontal, vertical, area, label, data.label));
  if (!up.length) svg.append(text(width / 2, height / 2, "no line is shown", "middle"));
  for (const line of lines) {
    const band = line.low ? indices(line).filter((i) => line.low[i] > 0 || !data.isLog) : [];
    if (band.length > 1) svg.append(bandOf(line, band, horizontal, vertical, x, area, line.colour));
  }
  svg.append(...frontOf(data, lines, x, place, visible));
  for (const line of lines) {
    const points = indices(line);
    const colour = line.colour;
    if (points.length > 1) {
      const d = points.map((i) => place(line, i).map((v) => v.toFixed(1)).join(" ")).join("L");
      svg.append(svgElement("path", { class: "line", d: "M" + d, stroke: colour, "stroke-dasharray": dashOf(line) }));
    }
    if (x === "shade" && line.spread && !data.isCost) svg.append(...points.map((i) => spreadOf(line, i, horizontal, vertical)));
    for (const i of points) {
      const [px, py] = place(line, i);
      const point = svgElement("g", {
        class: "point", transform: `translate(${px.toFixed(1)} ${py.toFixed(1)})`, tabindex: -1,
        role: "button", "aria-label": describe(line, i, x), "data-line": line.index, "data-i": i,
      }, svgElement("path", {
        d: markerPath(line.index), transform: `scale(${SIZE})`, stroke: colour,
        fill: line.floor[i] ? "var(--paper)" : colour,
      }));
      if (line.keys[i]) point.dataset.key = line.keys[i];
      svg.append(point);
    }
  }
  svg.querySelector(".point")?.setAttribute("tabindex", 0);
  return svg;
}

function dashOf(line) {
  return DASHES[line.dash % DASHES.length];
}

function axes(horizontal, vertical, area, below, above) {
  const group = svgElement("g", { class: "axes", "aria-hidden": "true" });
  const rule = (x1, y1, x2, y2) => group.append(svgElement("line", { x1, y1, x2, y2 }));
  rule(area.left, area.bottom, area.right, area.bottom);
  rule(area.left, area.bottom, area.left, area.top);
  for (const value of horizontal.minor) rule(horizontal.at(value), area.bottom, horizontal.at(value), area.bottom + 2.5);
  for (const value of vertical.minor) rule(area.left, vertical.at(value), area.left - 2.5, vertical.at(value));
  for (const value of horizontal.major) {
    rule(horizontal.at(value), area.bottom, horizontal.at(value), area.bottom + 5);
    group.append(text(horizontal.at(value), area.bottom + 16, tick(value), "middle"));
  }
  for (const value of vertical.major) {
    rule(area.left, vertical.at(value), area.left - 5, vertical.at(value));
    group.append(text(area.left - 8, vertical.at(value) + 3.5, tick(value), "end"));
  }
  group.append(text(area.right, area.bottom + 32, below, "end"), text(4, 12, above, "start"));
  return group;
}

// Whether there is room for a tick at each value of what is swept.
function fit({ at }, values) {
  const places = values.map(at).sort((a, b) => a - b);
  return places.every((x, i) => i === 0 || x - places[i - 1] > 36);
}

function text(x, y, content, anchor) {
  return svgElement("text", { x, y, "text-anchor": anchor }, content);
}

function bandOf(line, indices, horizontal, vertical, x, area, colour) {
  const clip = (y) => Math.min(area.bottom, Math.max(area.top, y)).toFixed(1);
  const at = (i, y) => `${horizontal.at(line.x[x][i]).toFixed(1)} ${clip(vertical.at(y))}`;
  const upper = indices.map((i) => at(i, line.high[i]));
  const lower = indices.map((i) => at(i, line.low[i])).reverse();
  const d = `M${[...upper, ...lower].join("L")}Z`;
  return svgElement("path", { class: "band", d, fill: colour, "data-line": line.index });
}

// From the fastest to the slowest run of a point.
function spreadOf(line, i, { at }, vertical) {
  const [from, to] = line.spread.map((end) => at(end[i]).toFixed(1));
  const y = vertical.at(line.y[i]).toFixed(1);
  return svgElement("path", { class: "spread", d: `M${from} ${y}H${to}`, stroke: line.colour });
}

// The Pareto front of all lines: stairs through its points that are shown, and a ring about each.
function frontOf(data, lines, x, place, visible) {
  const points = (data.fronts[x] ?? [])
    .map(([line, i]) => [data.lines[line], i])
    .filter(([line, i]) => lines.includes(line) && visible(line, i))
    .map(([line, i]) => place(line, i).map((v) => v.toFixed(1)))
    .sort((a, b) => a[0] - b[0] || b[1] - a[1]);
  if (!points.length) return [];
  const steps = points.slice(1).map(([px, py]) => `H${px}V${py}`);
  const stairs = svgElement("path", { class: "front", d: `M${points[0].join(" ")}${steps.join("")}` });
  const rings = points.map(([cx, cy]) => svgElement("circle", { class: "front", cx, cy, r: 1.9 * SIZE }));
  return [stairs, ...rings];
}
