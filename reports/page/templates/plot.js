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

// `shown` says which lines of a panel are drawn; `describe` returns the text of a point for screen readers.
function drawPlot({ panel, shown, width, height, describe }) {
  const lines = panel.lines.filter((line) => shown(line));
  const isNamed = panel.y.names.length > 0;
  const isSeen = (axis, value) => value !== null && (value > 0 || !axis.isLog || (axis.hasZero && value === 0));
  const indices = (line) => line.y.map((_, i) => i).filter((i) => isSeen(panel.x, line.x[i]) && isSeen(panel.y, line.y[i]));
  const valuesOf = (side) => {
    const values = lines.flatMap((line) => indices(line).map((i) => line[side][i]));
    const floor = panel[side].isLog ? panel[side].floor : 0;
    return { values, floor, showsFloor: values.length > 0 && floor > Math.min(...values) / 30 };
  };
  const [across, up] = [valuesOf("x"), valuesOf("y")];
  const ends = lines.flatMap((line) => (line.spread ?? []).flat()).filter((value) => isSeen(panel.x, value));
  const withFloor = ({ values, floor, showsFloor }, more = []) =>
    values.length ? [...values, ...more, ...(showsFloor ? [floor] : [])] : [1];
  const left = isNamed ? Math.min(width / 2, 12 + 6.2 * Math.max(...panel.y.names.map(({ length }) => length))) : MARGIN.left;
  const area = { left, right: width - MARGIN.right, top: MARGIN.top, bottom: height - MARGIN.bottom };
  const scaleOf = (axis) => (axis.names.length ? nameScale : axis.isLog ? logScale : linearScale);
  const horizontal = scaleOf(panel.x)(withFloor(across, ends), [area.left, area.right]);
  const distinct = [...new Set(across.values)];
  if (panel.x.atValues && panel.x.isLog && fit(horizontal, distinct)) Object.assign(horizontal, { major: distinct, minor: [] });
  const vertical = scaleOf(panel.y)(isNamed ? panel.y.names : withFloor(up), [area.bottom, area.top], 1.6);
  const place = (line, i) => [horizontal.at(line.x[i]), vertical.at(line.y[i])];

  const svg = svgElement("svg", {
    viewBox: `0 0 ${width} ${height}`, width, height, role: "group",
    "aria-label": `${panel.y.label} over ${panel.x.label}; ${up.values.length} points`,
  });
  if (up.showsFloor) svg.append(floorOf(area.left, vertical.at(up.floor), area.right, area.bottom));
  if (across.showsFloor) svg.append(floorOf(area.left, area.top, horizontal.at(across.floor), area.bottom));
  svg.append(axes(horizontal, vertical, area, panel.x.label, panel.y.label));
  if (!up.values.length) svg.append(text(width / 2, height / 2, "no line is shown", "middle"));
  for (const line of lines) {
    const band = line.band ? indices(line).filter((i) => isSeen(panel.y, line.band[0][i])) : [];
    if (band.length > 1) svg.append(bandOf(line, band, horizontal, vertical, area));
  }
  svg.append(...frontOf(panel, lines, place, indices));
  for (const line of lines) {
    const points = indices(line);
    if (points.length > 1 && !isNamed) {
      const d = points.map((i) => place(line, i).map((v) => v.toFixed(1)).join(" ")).join("L");
      svg.append(svgElement("path", { class: "line", d: "M" + d, stroke: line.colour, "stroke-dasharray": dashOf(line) }));
    }
    if (line.spread) svg.append(...points.map((i) => spreadOf(line, i, horizontal, vertical)));
    if (line.interval) svg.append(...points.map((i) => intervalOf(line, i, place(line, i), isNamed ? horizontal : vertical, isNamed, area)));
    for (const i of points) {
      const [px, py] = place(line, i);
      const point = svgElement("g", {
        class: "point", transform: `translate(${px.toFixed(1)} ${py.toFixed(1)})`, tabindex: -1,
        role: "button", "aria-label": describe(line, i), "data-line": line.index, "data-i": i,
      }, svgElement("path", {
        d: markerPath(line.index), transform: `scale(${SIZE})`, stroke: line.colour,
        fill: line.hollow[i] ? "var(--paper)" : line.colour,
      }));
      if (line.keys[i]) point.dataset.key = line.keys[i];
      svg.append(point);
    }
  }
  svg.querySelector(".point")?.setAttribute("tabindex", 0);
  return svg;
}

// The band of errors that the reference cannot resolve.
function floorOf(left, top, right, bottom) {
  return svgElement("rect", { class: "floor", x: left, y: top, width: right - left, height: bottom - top });
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
    const said = vertical.names ? vertical.names[value] : tick(value);
    group.append(text(area.left - 8, vertical.at(value) + 3.5, said, "end"));
  }
  group.append(text(area.right, area.bottom + 32, below, "end"), text(4, 12, above, "start"));
  return group;
}

// Whether there is room for a tick at each value of the sweep.
function fit({ at }, values) {
  const places = values.map(at).sort((a, b) => a - b);
  return places.every((x, i) => i === 0 || x - places[i - 1] > 36);
}

function text(x, y, content, anchor) {
  return svgElement("text", { x, y, "text-anchor": anchor }, content);
}

function bandOf(line, indices, horizontal, vertical, area) {
  const clip = (y) => Math.min(area.bottom, Math.max(area.top, y)).toFixed(1);
  const at = (i, y) => `${horizontal.at(line.x[i]).toFixed(1)} ${clip(vertical.at(y))}`;
  const [low, high] = line.band;
  const upper = indices.map((i) => at(i, high[i]));
  const lower = indices.map((i) => at(i, low[i])).reverse();
  const d = `M${[...upper, ...lower].join("L")}Z`;
  return svgElement("path", { class: "band", d, fill: line.colour, "data-line": line.index });
}

// A bar from the fastest to the slowest run of a point.
function spreadOf(line, i, { at }, vertical) {
  const [from, to] = line.spread.map((end) => at(end[i]).toFixed(1));
  const y = vertical.at(line.y[i]).toFixed(1);
  return svgElement("path", { class: "spread", d: `M${from} ${y}H${to}`, stroke: line.colour });
}

// The interval from the noise of the reference, along y, or along x if rows have names.
function intervalOf(line, i, [x, y], { at }, isAcross, area) {
  const [low, high] = isAcross ? [area.left, area.right] : [area.top, area.bottom];
  const [from, to] = line.interval.map((ends) => (ends[i] > 0 ? Math.min(high, Math.max(low, at(ends[i]))) : isAcross ? low : high).toFixed(1));
  return svgElement("path", { class: "interval", d: isAcross ? `M${from} ${y}H${to}` : `M${x} ${from}V${to}`, stroke: line.colour });
}

// The Pareto front of all lines: a ring around each of its points that is shown, and stairs through those that no other
// is below. Points above the stairs are on the front because noise leaves open whether they are better.
function frontOf(panel, lines, place, indices) {
  const points = panel.fronts
    .map(([line, i]) => [panel.lines[line], i])
    .filter(([line, i]) => lines.includes(line) && indices(line).includes(i))
    .map(([line, i]) => place(line, i).map((v) => v.toFixed(1)))
    .sort((a, b) => a[0] - b[0] || b[1] - a[1]);
  if (!points.length) return [];
  let best = panel.y.isLog ? -Infinity : Infinity;
  const corners = points.filter(([, py]) => {
    if (panel.y.isLog ? py <= best : py >= best) return false;
    best = Number(py);
    return true;
  });
  const steps = corners.slice(1).map(([px, py]) => `H${px}V${py}`);
  const stairs = svgElement("path", { class: "front", d: `M${corners[0].join(" ")}${steps.join("")}` });
  const rings = points.map(([cx, cy]) => svgElement("circle", { class: "front", cx, cy, r: 1.9 * SIZE }));
  return [stairs, ...rings];
}
