// Drawn over the images: values of enlarged pixels, outlines of crops, names of panes.

const VALUES_FROM = 44; // CSS pixels per image pixel that have room for three numbers

function drawInk(viewer) {
  const canvas = viewer.stage.querySelector('.viewer-ink'), context = canvas.getContext('2d');
  context.setTransform(viewer.ratio, 0, 0, viewer.ratio, 0, 0);
  context.clearRect(0, 0, viewer.size.width, viewer.size.height);
  const style = getComputedStyle(viewer.stage);
  const named = ['paper', 'ink', 'quiet'].map((name) => [name, style.getPropertyValue(`--${name}`)]);
  const colours = Object.fromEntries(named);
  if (viewer.state.layout === 'all') inkGaps(context, viewer, colours);
  for (const pane of viewer.panes) {
    context.save();
    context.beginPath();
    context.rect(pane.rect.x, pane.rect.y, pane.rect.width, pane.rect.height);
    context.clip();
    if (pane.image?.half && viewer.reference?.half && pane.scale >= VALUES_FROM) inkValues(context, viewer, pane);
    inkCrops(context, viewer, pane);
    context.restore();
    inkName(context, viewer, pane, colours);
  }
}

// The background between panes and outside them.
function inkGaps(context, { panes, size }, colours) {
  context.fillStyle = colours.paper;
  context.beginPath();
  context.rect(0, 0, size.width, size.height);
  for (const { rect } of panes) context.rect(rect.x, rect.y, rect.width, rect.height);
  context.fill('evenodd');
}

function inkText(context, text, x, y, align = 'center') {
  context.textAlign = align;
  context.lineWidth = 3;
  context.lineJoin = 'round';
  context.strokeStyle = 'rgb(0 0 0 / 75%)';
  context.strokeText(text, x, y);
  context.fillStyle = '#fff';
  context.fillText(text, x, y);
}

function inkValues(context, viewer, pane) {
  const { image, scale, origin, index } = pane, { reference } = viewer, { x, y, width, height } = visible(viewer, pane);
  const look = viewer.lookOf(index), under = coloured(image, reference, look, viewer.colours, x, y, width, height).data;
  context.font = `${Math.min(12, scale / 4.4)}px ui-monospace, Menlo, Consolas, monospace`;
  context.textAlign = 'center';
  context.textBaseline = 'middle';
  for (let i = 0; i < width * height; i++) {
    const column = i % width, row = (i - column) / width, at = 4 * ((y + row) * image.width + x + column);
    if (!under[4 * i + 3]) continue;
    const lines = look.mode === 'image'
      ? [0, 1, 2].map((c) => number(HALF[image.half[at + c]]))
      : [number(errorOf(viewer, image, at))];
    const brightness = 0.3 * under[4 * i] + 0.6 * under[4 * i + 1] + 0.1 * under[4 * i + 2];
    context.fillStyle = brightness > 120 ? '#000' : '#fff';
    lines.forEach((text, line) => {
      const down = 0.5 + 0.27 * (line - (lines.length - 1) / 2);
      context.fillText(text, origin.x + scale * (x + column + 0.5), origin.y + scale * (y + row + down));
    });
  }
}

function errorOf(viewer, image, at) {
  return errorAt(viewer.state.mode, image.half, viewer.reference.half, at, viewer.registry.epsilon);
}

function inkCrops(context, viewer, { scale, origin }) {
  const drawn = viewer.marking ? [...viewer.state.crops, viewer.marking] : viewer.state.crops;
  context.font = '600 12px system-ui, sans-serif';
  context.textBaseline = 'top';
  drawn.forEach(({ x, y, width, height }, i) => {
    const box = [origin.x + scale * x, origin.y + scale * y, scale * width, scale * height];
    context.lineWidth = 3;
    context.strokeStyle = 'rgb(0 0 0 / 75%)';
    context.strokeRect(...box);
    context.lineWidth = 1.5;
    context.strokeStyle = '#fff';
    context.strokeRect(...box);
    inkText(context, String(i + 1), box[0] + 4, box[1] + 4, 'left');
  });
}

// The name of a pane above it, on the background of the page.
function inkName(context, viewer, { index, rect, frame, image }, colours) {
  const { layout } = viewer.state, height = NAME[layout], top = frame.y - height;
  const { name } = viewer.images[index], state = image ? '' : '…';
  const rest = image?.problem ?? `${details(viewer.images[index])} ${state}`;
  const isRight = layout === 'split' && rect.x + rect.width === frame.width && index === viewer.state.image;
  const letter = layout === 'split' ? (isRight ? 'B  ' : 'A  ') : '';
  const box = layout === 'split' ? { x: isRight ? frame.width / 2 : 0, width: frame.width / 2 } : rect;
  context.fillStyle = colours.paper;
  context.fillRect(box.x, top, box.width + GAP, height);
  context.textBaseline = 'top';
  context.textAlign = 'left';
  context.font = '600 12px system-ui, sans-serif';
  const title = fitting(context, letter + name, box.width - 8);
  const indent = layout === 'all' ? 0 : context.measureText(title).width + 8;
  context.fillStyle = colours.ink;
  context.fillText(title, box.x, top + 3);
  context.font = '12px system-ui, sans-serif';
  context.fillStyle = colours.quiet;
  context.fillText(fitting(context, rest, box.width - indent - 8), box.x + indent, top + (layout === 'all' ? 17 : 3));
}

// A text, cut to the room that there is.
function fitting(context, text, width) {
  if (context.measureText(text).width <= width) return text;
  let n = text.length;
  while (n > 0 && context.measureText(`${text.slice(0, n)}…`).width > width) n--;
  return n > 0 ? `${text.slice(0, n)}…` : '';
}
