// The state of the viewer as the fragment of the page's address, so that a link can show a crop.

const ROUND = (v, digits) => Number(v.toFixed(digits));

function writeFragment(viewer) {
  const { state, images } = viewer, fields = new URLSearchParams();
  fields.set('image', images[state.image].key);
  fields.set('with', images[state.other].key);
  fields.set('layout', state.layout);
  fields.set('mode', state.mode);
  fields.set('tone', state.tone);
  fields.set('stops', ROUND(state.stops, 2));
  if (state.layout === 'split') fields.set('split', ROUND(state.split, 3));
  if (state.range !== null) fields.set('range', state.range);
  if (state.zoom !== null) fields.set('zoom', ROUND(state.zoom, 3));
  if (state.centre) fields.set('at', `${ROUND(state.centre.x, 2)},${ROUND(state.centre.y, 2)}`);
  for (const { x, y, width, height } of state.crops) fields.append('crop', [x, y, width, height].join());
  history.replaceState(null, '', `#${fields.toString().replaceAll('%2C', ',')}`);
}

// The state in a fragment; null if it has none. Invalid parts are left out.
function readFragment({ groups }, fragment) {
  const fields = new URLSearchParams(fragment.slice(1));
  const group = groups.findIndex(({ images }) => images.some(({ key }) => key === fields.get('image')));
  if (group < 0) return null;
  const { images, width, height } = groups[group], state = { group, other: 0 };
  const find = (name) => images.findIndex(({ key }) => key === fields.get(name));
  const number = (name, low, high) => {
    const value = Number.parseFloat(fields.get(name));
    return Number.isFinite(value) ? { [name]: Math.min(Math.max(value, low), high) } : {};
  };
  const one = (name, values) => (values.includes(fields.get(name)) ? { [name]: fields.get(name) } : {});
  state.image = find('image');
  if (find('with') >= 0) state.other = find('with');
  Object.assign(state, one('layout', LAYOUTS), one('mode', MODES), one('tone', TONES), number('stops', -30, 30),
    number('split', 0, 1), number('range', Number.MIN_VALUE, Number.MAX_VALUE), number('zoom', 1e-3, LARGEST_ZOOM));
  const numbers = (text) => text.split(',').map(Number);
  const [x, y] = numbers(fields.get('at') ?? '');
  if (Number.isFinite(x) && Number.isFinite(y)) state.centre = kept({ group: groups[group] }, { x, y });
  state.crops = fields.getAll('crop').map(numbers).filter(
    (n) => n.length === 4 && n.every(Number.isInteger) && n[0] >= 0 && n[1] >= 0 && n[2] > 0 && n[3] > 0
      && n[0] + n[2] <= width && n[1] + n[3] <= height,
  ).slice(0, MOST_CROPS).map(([left, top, w, h]) => ({ x: left, y: top, width: w, height: h }));
  return state;
}
