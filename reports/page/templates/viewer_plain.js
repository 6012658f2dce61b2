// Draws panes without WebGL2: the processor colours each image once per look; then it is only scaled.

class PlainPainter {
  constructor(canvas, colours) {
    this.context = canvas.getContext('2d');
    this.colours = colours;
    this.painted = new Map(); // by name of image, least recently used first: {stamp, canvas}
  }

  coloured(image, reference, look) {
    const stamp = JSON.stringify(look);
    let held = this.painted.get(image.name);
    this.painted.delete(image.name);
    if (held?.stamp !== stamp) {
      const { width, height } = image;
      const canvas = held?.canvas ?? Object.assign(document.createElement('canvas'), { width, height });
      canvas.getContext('2d').putImageData(coloured(image, reference, look, this.colours), 0, 0);
      held = { stamp, canvas };
    }
    this.painted.set(image.name, held);
    return held.canvas;
  }

  paint(panes) {
    const { canvas } = this.context;
    this.context.clearRect(0, 0, canvas.width, canvas.height);
    for (const { image, reference, look, rect, origin, scale } of panes) {
      this.context.save();
      this.context.beginPath();
      this.context.rect(rect.x, rect.y, rect.width, rect.height);
      this.context.clip();
      this.context.imageSmoothingEnabled = scale < 1;
      const source = this.coloured(image, reference, look);
      this.context.drawImage(source, origin.x, origin.y, scale * image.width, scale * image.height);
      this.context.restore();
    }
    let held = 0;
    for (const { canvas: each } of this.painted.values()) held += 4 * each.width * each.height;
    for (const [name, { canvas: each }] of this.painted) {
      if (held <= MOST_BYTES || panes.some((pane) => pane.image.name === name)) continue;
      held -= 4 * each.width * each.height;
      this.painted.delete(name);
    }
  }
}
