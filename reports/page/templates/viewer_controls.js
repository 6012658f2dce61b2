// The controls next to the images: they show the state, and change it.

class Controls {
  constructor(viewer) {
    this.viewer = viewer;
    this.form = viewer.root.querySelector('form');
    this.list = viewer.root.querySelector('.viewer-list');
    this.readout = viewer.root.querySelector('.viewer-readout');
    this.scale = viewer.root.querySelector('.viewer-scale');
    const fields = this.form.elements, { registry } = viewer;
    fields.group.append(...registry.groups.map(({ title }, i) => new Option(title, i)));
    fields.group.closest('label').hidden = registry.groups.length < 2;
    fields.mode.append(...registry.errors.map(({ mode, name }) => new Option(`error: ${name}`, mode)));
    if (registry.flipReduction > 1) {
      viewer.root.querySelector('.viewer-flip').textContent =
        `FLIP maps are of images with a side 1/${registry.flipReduction} as long, seen under the same angle.`;
    }
    this.listen();
  }

  listen() {
    const { viewer, form } = this, fields = form.elements;
    form.addEventListener('submit', (event) => event.preventDefault());
    form.addEventListener('input', ({ target }) => {
      const { name, value } = target;
      if (name === 'group') viewer.stepGroup(Number(value) - viewer.state.group);
      else if (name === 'layout' || name === 'tone') viewer.change({ [name]: value });
      else if (name === 'mode') viewer.change({ mode: value, range: null });
      else if (name === 'stops' || name === 'other') viewer.change({ [name]: Number(value) });
      else if (name === 'range') viewer.change({ range: Number(value) > 0 ? Number(value) : null });
    });
    fields.fit.addEventListener('click', () => viewer.change({ zoom: null, centre: null }));
    fields.in.addEventListener('click', () => zoomAt(viewer, 1.5));
    fields.out.addEventListener('click', () => zoomAt(viewer, 1 / 1.5));
    fields.crop.addEventListener('click', () => viewer.crops.addVisible());
    this.list.addEventListener('change', ({ target }) => viewer.show(viewer.state.group, Number(target.value)));
  }

  update() {
    const { viewer } = this, { state, group } = viewer, fields = this.form.elements;
    if (this.listed !== state.group) this.fill();
    fields.group.value = state.group;
    fields.layout.value = state.layout;
    fields.other.value = state.other;
    fields.mode.value = state.mode;
    fields.tone.value = state.tone;
    if (Number(fields.stops.value) !== state.stops) fields.stops.value = state.stops;
    const stops = group.stops + state.stops;
    fields.exposure.value = `${stops < 0 ? '−' : '+'}${Math.abs(stops).toFixed(1)} stops`;
    fields.range.placeholder = number(group.ranges[state.mode] ?? 1);
    if (document.activeElement !== fields.range) fields.range.value = state.range ?? ''; // not while the user types
    for (const [selector, isShown] of [
      ['.viewer-other', state.layout === 'split'], ['.viewer-range', state.mode !== 'image'],
    ]) for (const each of this.form.querySelectorAll(selector)) each.hidden = !isShown;
    const chosen = this.list.querySelector(`input[value="${state.image}"]`);
    if (!chosen.checked) {
      chosen.checked = true;
      const row = chosen.parentElement, { list } = this;
      if (row.offsetTop < list.scrollTop || row.offsetTop + row.offsetHeight > list.scrollTop + list.clientHeight) {
        list.scrollTop = row.offsetTop - list.clientHeight / 2;
      }
    }
    const { handle, stage } = viewer;
    handle.hidden = state.layout !== 'split';
    handle.style.left = `${100 * state.split}%`;
    handle.setAttribute('aria-valuenow', Math.round(100 * state.split));
    stage.style.touchAction = state.zoom === null ? 'pan-y' : 'none';
    this.bar(state.mode, state.range ?? group.ranges[state.mode]);
  }

  // The list of images, and the choice of A.
  fill() {
    const { viewer } = this, { images } = viewer;
    this.listed = viewer.state.group;
    const label = (image) => [image.name, details(image)].filter(Boolean).join(' · ');
    this.form.elements.other.replaceChildren(...images.map((image, i) => new Option(label(image), i)));
    for (const row of this.list.querySelectorAll('label')) row.remove();
    this.list.append(...images.map((image, i) => {
      const row = document.createElement('label'), input = document.createElement('input');
      Object.assign(input, { type: 'radio', name: 'viewer-image', value: i });
      const texts = [i < 10 ? String(i) : '', image.name, details(image), image.note];
      if (image.colour) row.style.setProperty('--method', image.colour);
      row.append(input, ...texts.map((text) => Object.assign(document.createElement('span'), { textContent: text })));
      return row;
    }));
  }

  // The colour bar of the shown error.
  bar(mode, limit) {
    const { registry, colours } = this.viewer;
    this.scale.hidden = mode === 'image';
    if (this.scale.hidden || this.drawn === `${mode} ${limit}`) return;
    this.drawn = `${mode} ${limit}`;
    const canvas = this.scale.querySelector('canvas'), isSigned = mode === 'signed';
    canvas.width = N_COLOURS;
    const pixels = new ImageData(N_COLOURS, 1), map = isSigned ? colours.signed : colours.unsigned;
    for (let i = 0; i < N_COLOURS; i++) pixels.data.set([map[3 * i], map[3 * i + 1], map[3 * i + 2], 255], 4 * i);
    canvas.getContext('2d').putImageData(pixels, 0, 0);
    const ticks = isSigned ? [-1, -0.5, 0, 0.5, 1] : [0, 0.25, 0.5, 0.75, 1];
    this.scale.querySelector('.viewer-ticks').replaceChildren(...ticks.map(
      (t) => Object.assign(document.createElement('span'), { textContent: number(t * limit, 2) })));
    const { formula } = registry.errors.find((each) => each.mode === mode);
    this.scale.querySelector('.viewer-formula').textContent = formula;
  }

  // The pixel under the pointer, or in the middle of the view.
  read() {
    const { viewer } = this, { group, reference, panes } = viewer;
    if (!panes) return;
    const point = viewer.pointer ?? middle(viewer), at = pointed(viewer, point.x, point.y);
    if (!at?.pane.image?.half || !reference?.half) return;
    const x = Math.floor(at.x), y = Math.floor(at.y), i = 4 * (y * group.width + x);
    const inside = x >= 0 && y >= 0 && x < group.width && y < group.height && HALF[reference.half[i + 3]] >= 0.5;
    const rgb = ({ half }) => [0, 1, 2].map((c) => number(HALF[half[i + c]])).join(' ');
    const words = [`pixel ${x}, ${y}`];
    if (!inside) words.push('off the surface');
    else {
      words.push(`${viewer.images[at.pane.index].name} ${rgb(at.pane.image)}`);
      if (at.pane.index !== 0) words.push(`reference ${rgb(reference)}`);
      const { mode } = viewer.lookOf(at.pane.index);
      if (mode !== 'image') words.push(`error ${number(errorOf(viewer, at.pane.image, i))}`);
    }
    this.readout.textContent = words.join(' · ');
  }
}
