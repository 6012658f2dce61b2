// Positions of images on the stage: the panes of a layout, and their common zoom and centre; in CSS pixels.

const MOST_PANES = 16, LARGEST_ZOOM = 160, GAP = 6;
const NAME = { one: 22, split: 22, all: 32 }; // height of the names over the panes

// Gives stage and canvases the shape of the group's images.
function resize(viewer) {
  const { stage, canvas, group } = viewer;
  const ratio = window.devicePixelRatio || 1, width = stage.clientWidth;
  const shape = Math.max(0.5, group.height / group.width);
  const height = Math.round(Math.min(width * shape + NAME.one, 0.72 * window.innerHeight));
  if (stage.clientHeight !== height) stage.style.height = `${height}px`;
  viewer.ratio = ratio;
  viewer.size = { width, height };
  for (const each of [canvas, stage.querySelector('.viewer-ink')]) {
    const w = Math.round(width * ratio), h = Math.round(height * ratio);
    if (each.width !== w || each.height !== h) Object.assign(each, { width: w, height: h });
    Object.assign(each.style, { width: `${w / ratio}px`, height: `${h / ratio}px` }); // a stage may end within a pixel
  }
}

// Panes {index, rect, frame, scale, origin}: the image, its part of the stage, and the position of its corner.
function panesOf(viewer) {
  const { width, height } = viewer.size, { layout, image, other, split } = viewer.state;
  const full = { x: 0, y: NAME[layout], width, height: height - NAME[layout] };
  const border = Math.round(split * width);
  let panes = [{ index: image, frame: full, rect: full }];
  if (layout === 'split') {
    panes = [
      { index: other, frame: full, rect: { ...full, width: border } },
      { index: image, frame: full, rect: { ...full, x: border, width: width - border } },
    ];
  }
  if (layout === 'all') panes = grid(viewer).map(({ index, rect }) => ({ index, frame: rect, rect }));
  return panes.map((pane) => ({ ...pane, ...placed(viewer, pane.frame) }));
}

// Scale and corner of an image in a frame.
function placed({ group, state }, frame) {
  const scale = state.zoom ?? fitted(group, frame);
  const centre = state.centre ?? { x: group.width / 2, y: group.height / 2 };
  return {
    scale,
    origin: { x: frame.x + frame.width / 2 - scale * centre.x, y: frame.y + frame.height / 2 - scale * centre.y },
  };
}

// The whole image in a frame; a strong enlargement is by a whole number, so that all pixels have the same size.
function fitted(group, frame) {
  const scale = Math.min(frame.width / group.width, frame.height / group.height);
  return scale >= 3 ? Math.floor(scale) : scale;
}

// Up to MOST_PANES images around the chosen one, the reference first, as large as possible.
function grid(viewer) {
  const { width, height } = viewer.size, { group, images } = viewer;
  const n = Math.min(images.length, MOST_PANES);
  const first = Math.max(1, Math.min(viewer.state.image - (n >> 1), images.length - n + 1));
  const shown = [0, ...Array.from({ length: n - 1 }, (_, i) => first + i)];
  let columns = 1, best = 0;
  for (let k = 1; k <= n; k++) {
    const size = Math.min(width / k / group.width, (height / Math.ceil(n / k) - NAME.all) / group.height);
    if (size > best * 1.001) [columns, best] = [k, size];
  }
  const w = width / columns, h = height / Math.ceil(n / columns);
  return shown.map((index, i) => ({
    index,
    rect: {
      x: (i % columns) * w, y: Math.floor(i / columns) * h + NAME.all, width: w - GAP, height: h - NAME.all - GAP,
    },
  }));
}

// The centre of the pane of the chosen image.
function middle({ panes, state }) {
  const { frame, rect } = panes.find(({ index }) => index === state.image) ?? panes[0];
  const x = Math.min(Math.max(frame.x + frame.width / 2, rect.x), rect.x + rect.width - 1);
  return { x, y: frame.y + frame.height / 2 };
}

// The pane under a point of the stage, and the position in its image.
function pointed(viewer, x, y) {
  const holds = ({ rect }) => x >= rect.x && y >= rect.y && x < rect.x + rect.width && y < rect.y + rect.height;
  const pane = viewer.panes?.find(holds);
  return pane && { pane, x: (x - pane.origin.x) / pane.scale, y: (y - pane.origin.y) / pane.scale };
}

// Zooms by a factor around a point of the stage.
function zoomAt(viewer, factor, { x, y } = middle(viewer)) {
  const at = pointed(viewer, x, y);
  if (!at) return;
  const { frame, scale } = at.pane, fit = fitted(viewer.group, frame);
  const zoom = Math.min(Math.max(scale * factor, fit / 2), LARGEST_ZOOM);
  const centre = {
    x: at.x - (x - frame.x - frame.width / 2) / zoom,
    y: at.y - (y - frame.y - frame.height / 2) / zoom,
  };
  viewer.change({ zoom, centre: kept(viewer, centre) });
}

// Moves images by this many pixels of the stage.
function panBy(viewer, dx, dy) {
  const { scale } = viewer.panes[0], { group, state } = viewer;
  const centre = state.centre ?? { x: group.width / 2, y: group.height / 2 };
  viewer.change({ zoom: scale, centre: kept(viewer, { x: centre.x - dx / scale, y: centre.y - dy / scale }) });
}

// The centre never leaves the image.
function kept({ group }, { x, y }) {
  return { x: Math.min(Math.max(x, 0), group.width), y: Math.min(Math.max(y, 0), group.height) };
}

// The pixels that a pane shows, as whole numbers.
function visible({ group }, { rect, origin, scale }) {
  const x = Math.max(0, Math.floor((rect.x - origin.x) / scale));
  const y = Math.max(0, Math.floor((rect.y - origin.y) / scale));
  return {
    x, y,
    width: Math.min(group.width, Math.ceil((rect.x + rect.width - origin.x) / scale)) - x,
    height: Math.min(group.height, Math.ceil((rect.y + rect.height - origin.y) / scale)) - y,
  };
}
