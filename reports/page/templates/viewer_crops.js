// Crops: rectangles of the image, shown enlarged for every image of the group, with the look of the stage.

const MOST_CROPS = 6;

class Crops {
  constructor(viewer) {
    this.viewer = viewer;
    this.box = viewer.root.querySelector('.viewer-crops');
  }

  add(crop) {
    const { crops } = this.viewer.state;
    if (!crop || crop.width < 1 || crop.height < 1) return;
    this.viewer.change({ crops: [...crops, crop].slice(-MOST_CROPS) });
    this.viewer.say(`Crop ${this.viewer.state.crops.length}: ${described(crop)}`);
  }

  // The visible part; if the whole image is visible, its middle half.
  addVisible() {
    const { viewer } = this, { width, height } = viewer.group;
    const pane = viewer.panes[0], seen = visible(viewer, { ...pane, rect: pane.frame });
    const isAll = seen.width >= width && seen.height >= height;
    this.add(isAll ? { x: width >> 2, y: height >> 2, width: (width + 1) >> 1, height: (height + 1) >> 1 } : seen);
  }

  draw() {
    const { group, image, mode, tone, stops, range, crops } = this.viewer.state;
    const stamp = JSON.stringify([group, image, mode, tone, stops, range, crops]);
    if (stamp === this.drawn) return;
    this.drawn = stamp;
    this.box.replaceChildren(...crops.map((crop, i) => this.row(crop, i)));
  }

  row(crop, i) {
    const { viewer } = this, row = document.createElement('figure');
    const caption = document.createElement('figcaption'), remove = document.createElement('button');
    caption.textContent = `Crop ${i + 1}: ${described(crop)} `;
    remove.type = 'button';
    remove.textContent = 'remove';
    remove.addEventListener('click', () => {
      viewer.change({ crops: viewer.state.crops.filter((each) => each !== crop) });
    });
    caption.append(remove);
    const tiles = document.createElement('div');
    tiles.className = 'viewer-tiles';
    tiles.append(...viewer.images.map((_, index) => this.tile(crop, index)));
    row.append(caption, tiles);
    return row;
  }

  tile(crop, index) {
    const { viewer } = this, { name, note } = viewer.images[index];
    const button = document.createElement('button'), canvas = document.createElement('canvas');
    const text = document.createElement('span'), quiet = document.createElement('span');
    button.type = 'button';
    button.setAttribute('aria-pressed', String(index === viewer.state.image));
    Object.assign(canvas, { width: crop.width, height: crop.height });
    text.textContent = name;
    quiet.textContent = [details(viewer.images[index]), note].filter(Boolean).join(' · ');
    button.append(canvas, text, quiet);
    button.addEventListener('click', () => viewer.show(viewer.state.group, index));
    const image = viewer.loaded(index);
    if (image?.half && viewer.reference?.half) {
      const { x, y, width, height } = crop;
      const pixels = coloured(image, viewer.reference, viewer.lookOf(index), viewer.colours, x, y, width, height);
      canvas.getContext('2d').putImageData(pixels, 0, 0);
    } else if (!image?.problem) {
      this.drawn = null; // drawn again when the image is loaded
    }
    return button;
  }
}

// Options and samples of a cell.
function details({ kind, options, samples }) {
  return [options, kind === 'cell' && samples !== null ? `${samples} ${samples === 1 ? 'sample' : 'samples'}` : ''].filter(Boolean).join(' · ');
}

function described({ x, y, width, height }) {
  return `${width} × ${height} pixels from ${x}, ${y}`;
}
