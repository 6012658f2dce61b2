// The viewer: images of a group, one at a time, split or side by side, with one exposure, one error scale, one zoom.
// The other viewer_*.js files are part of this module. It does not depend on the rest of the page, which opens a cell
// with: document.dispatchEvent(new CustomEvent('open-cell', {detail: {key}})).

queueMicrotask(() => {
  const root = document.getElementById('viewer');
  const registry = JSON.parse(document.getElementById('viewer-registry')?.textContent ?? '{}');
  if (!root || !registry.groups?.length) return;
  globalThis.glossbenchViewer = new Viewer(root, registry);
});

const LAYOUTS = ['one', 'split', 'all'];

class Viewer {
  constructor(root, registry) {
    this.root = root;
    this.registry = registry;
    this.stage = root.querySelector('.viewer-stage');
    this.handle = root.querySelector('.viewer-handle');
    this.colours = {
      signed: bytesOf(registry.signed), unsigned: bytesOf(registry.unsigned), epsilon: registry.epsilon,
    };
    this.state = {
      group: 0, image: Math.min(1, registry.groups[0].images.length - 1), other: 0, layout: 'split', mode: 'image',
      tone: 'srgb', stops: 0, range: null, zoom: null, centre: null, split: 0.5, crops: [],
    };
    this.store = new Store(registry.folder);
    this.draw = this.draw.bind(this);
    this.again = () => this.schedule();
    root.hidden = false;
    this.choosePainter();
    this.controls = new Controls(this);
    this.crops = new Crops(this);
    listenToPointer(this);
    listenToKeys(this);
    const asked = readFragment(registry, location.hash);
    if (asked) this.arrive(asked);
    window.addEventListener('hashchange', () => {
      const again = readFragment(registry, location.hash);
      if (again) this.arrive(again);
    });
    document.addEventListener('open-cell', (event) => this.openCell(event.detail.key));
    new ResizeObserver(this.again).observe(this.stage);
    // Images are unpacked when they are near the visible part of the page.
    new IntersectionObserver(([entry]) => {
      this.seen = entry.isIntersecting;
      if (this.seen) this.schedule();
    }, { rootMargin: '400px' }).observe(root);
    this.change({});
  }

  get group() {
    return this.registry.groups[this.state.group];
  }

  get images() {
    return this.group.images;
  }

  // The look that all images share; the reference, which has no error, is always shown as an image.
  lookOf(index) {
    const { tone, stops, range } = this.state, mode = index === 0 ? 'image' : this.state.mode;
    return { mode, tone, gain: 2 ** (this.group.stops + stops), limit: range ?? this.group.ranges[mode] ?? 1 };
  }

  choosePainter() {
    const old = this.stage.querySelector('.viewer-paint'), canvas = old.cloneNode();
    old.replaceWith(canvas);
    this.canvas = canvas;
    const wanted = new URLSearchParams(location.search).get('painter'); // for comparisons: webgl2 or plain
    const isGl = !this.lost && (wanted === null ? GlPainter.isFast() : wanted === 'webgl2');
    this.painter = isGl ? GlPainter.create(canvas, this.colours) : null;
    this.painter ??= new PlainPainter(canvas, this.colours);
    canvas.addEventListener('webglcontextlost', () => {
      this.lost = true;
      this.choosePainter();
      this.schedule();
    }, { once: true });
    const isPlain = this.painter instanceof PlainPainter;
    this.root.querySelector('.viewer-painter').textContent = isPlain
      ? 'This browser has no hardware-accelerated WebGL2, so the processor colours the images: a new exposure or error '
        + 'takes longer, and zoomed out the screen shows means of colours, not of radiance.'
      : 'Drawn with WebGL2.';
    this.root.dataset.painter = isPlain ? 'plain' : 'webgl2';
  }

  // Opens a cell, or a reference, by group and key.
  open(group, key) {
    const image = this.registry.groups[group]?.images.findIndex((each) => each.key === key) ?? -1;
    if (image < 0) return false;
    this.show(group, image);
    this.stage.focus({ preventScroll: true });
    this.root.scrollIntoView({ block: 'start' });
    return true;
  }

  openCell(key) {
    return this.registry.groups.some((_, group) => this.open(group, key));
  }

  // Shows an image; in another group the zoom stays if the images have the same size.
  show(group, image) {
    const from = this.group, to = this.registry.groups[group];
    const same = from.width === to.width && from.height === to.height;
    const other = group === this.state.group ? this.state.other : 0;
    this.change({ group, image, other, ...(same ? {} : { zoom: null, centre: null, crops: [] }) });
    const { name, note } = this.images[image];
    const words = [`${image + 1} of ${this.images.length}`, name, details(this.images[image]), note];
    this.say(words.filter(Boolean).join(', '));
  }

  step(by) {
    const n = this.images.length;
    this.show(this.state.group, (this.state.image + by + n) % n);
  }

  // The same cell in another group: the one with the same name, options and samples, otherwise the same index.
  stepGroup(by) {
    const n = this.registry.groups.length, group = (this.state.group + by + n) % n;
    const now = this.images[this.state.image], there = this.registry.groups[group].images;
    const alike = there.findIndex((each) => ['kind', 'name', 'options', 'samples'].every(
      (key) => each[key] === now[key] || (key === 'samples' && now.kind === 'reference')));
    this.show(group, alike >= 0 ? alike : Math.min(this.state.image, there.length - 1));
  }

  say(text) {
    this.root.querySelector('.viewer-status').textContent = text;
  }

  change(changes) {
    Object.assign(this.state, changes);
    this.controls.update();
    this.schedule();
    clearTimeout(this.writing);
    if (Object.keys(changes).length) this.writing = setTimeout(() => writeFragment(this), 250);
  }

  arrive(state) {
    Object.assign(this.state, { zoom: null, centre: null, crops: [], range: null, ...state });
    this.change({});
    requestAnimationFrame(() => this.root.scrollIntoView({ block: 'start' }));
  }

  schedule() {
    this.scheduled ??= requestAnimationFrame(this.draw);
  }

  // An image of this group if it is loaded, else null.
  loaded(index) {
    const { width, height, images } = this.group;
    return this.store.get(images[index].data, width, height, this.again);
  }

  draw() {
    this.scheduled = null;
    if (!this.seen) return;
    resize(this);
    const reference = this.loaded(0), panes = panesOf(this);
    const ready = panes.map((pane) => ({ ...pane, image: this.loaded(pane.index) }));
    const { ratio } = this;
    this.stage.style.touchAction = this.state.zoom === null ? 'pan-x pan-y' : 'none'; // one finger scrolls the page, or pans
    const here = ready.filter(({ image }) => image?.half && reference?.half);
    this.painter.paint(here.map(({ index, image, rect, origin, scale }) => ({
      image, reference, look: this.lookOf(index), scale: scale * ratio,
      rect: {
        x: snap(rect.x), y: snap(rect.y),
        width: snap(rect.x + rect.width) - snap(rect.x), height: snap(rect.y + rect.height) - snap(rect.y),
      },
      origin: { x: snap(origin.x), y: snap(origin.y) },
    })));
    this.panes = ready;
    this.reference = reference;
    drawInk(this);
    this.controls.read();
    this.crops.draw();
    this.ahead();

    function snap(v) {
      return Math.round(v * ratio);
    }
  }

  // Unpacks the neighbours of the shown image, so that a flip does not wait.
  ahead() {
    const n = this.images.length, { image } = this.state;
    if (this.panes.some((pane) => !pane.image)) return;
    const near = [1, -1, 2].map((by) => (image + by + n) % n);
    const missing = near.find((i) => !this.store.images.has(this.images[i].data));
    if (missing !== undefined) this.loaded(missing);
  }
}
