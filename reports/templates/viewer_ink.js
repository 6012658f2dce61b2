// What is written over the images: values of enlarged pixels, outlines of crops, names of panes.

const VALUES_FROM = 44; // CSS pixels to an image pixel: room for three numbers

function drawInk(viewer) {
  const canvas = viewer.stage.querySelector('.viewer-ink'), context = canvas.getContext('2d');
  context.setTransform(viewer.ratio, 0, 0, viewer.ratio, 0, 0);
  context.clearRect(0, 0, viewer.size.width, viewer.size.height);
  for (const pane of viewer.panes) {
    context.save();
    context.beginPath();
    context.rect(pane.rect.x, pane.rect.y, pane.rect.width, pane.rect.height);
    context.clip();
    if (pane.image?.half && viewer.reference?.half && pane.scale >= VALUES_FROM) inkValues(context, viewer, pane);
    inkCrops(context, viewer, pane);
    inkName(context, viewer, pane);
    context.restore();
  }
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
  const { image, scale, origin } = pane, { width } = image, seen = visible(viewer, pane);
  const isImage = viewer.lookOf(pane.index).mode === 'image';
  context.font = `${Math.min(12, scale / 4.4)}px ui-monospace, Menlo, Consolas, monospace`;
  context.textBaseline = 'middle';
  for (let y = seen.y; y < seen.y + seen.height; y++) {
    for (let x = seen.x; x < seen.x + seen.width; x++) {
      const at = 4 * (y * width + x);
      if (HALF[viewer.reference.half[at + 3]] < 0.5) continue;
      const lines = isImage
        ? [0, 1, 2].map((c) => figure(HALF[image.half[at + c]]))
        : [figure(errorOf(viewer, image, at))];
      lines.forEach((text, i) => {
        const down = 0.5 + 0.27 * (i - (lines.length - 1) / 2);
        inkText(context, text, origin.x + scale * (x + 0.5), origin.y + scale * (y + down));
      });
    }
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

function inkName(context, viewer, { index, rect, image }) {
  const { name } = viewer.images[index], { layout } = viewer.state;
  const isA = layout === 'split' && rect.x === 0 && rect.width < viewer.size.width;
  const words = [name, details(viewer.images[index]), image ? '' : '…'];
  const text = image?.problem ?? words.filter(Boolean).join(' · ');
  context.font = `${layout === 'all' ? 11 : 12}px system-ui, sans-serif`;
  context.textBaseline = 'top';
  if (layout !== 'split') inkText(context, text, rect.x + 8, rect.y + 8, 'left');
  else if (isA) inkText(context, `A  ${text}`, rect.x + 8, rect.y + 8, 'left');
  else inkText(context, `${text}  B`, rect.x + rect.width - 8, rect.y + 8, 'right');
}
