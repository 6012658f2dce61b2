// Keys of the viewer: they work while it has the focus, or while the pointer is over it and nothing has the focus.

const PAN_STEP = 48; // CSS pixels

function listenToKeys(viewer) {
  document.addEventListener('keydown', (event) => {
    const focus = document.activeElement;
    const isOurs = viewer.root.contains(focus) || (focus === document.body && viewer.root.matches(':hover'));
    if (!isOurs || event.ctrlKey || event.metaKey || event.altKey) return;
    const isTyping = focus.matches('select, input:not([type=radio]), summary');
    const hasArrows = isTyping || focus.matches('input');
    if (isTyping || (hasArrows && event.key.startsWith('Arrow'))) return;
    if (focus === viewer.handle && moveHandle(viewer, event)) return event.preventDefault();
    const action = keyAction(viewer, event);
    if (!action) return;
    event.preventDefault();
    action();
  });
}

function moveHandle(viewer, { key, shiftKey }) {
  const to = { ArrowLeft: viewer.state.split - 0.02, ArrowRight: viewer.state.split + 0.02, Home: 0, End: 1 }[key];
  if (to === undefined || shiftKey) return false;
  viewer.change({ split: Math.min(Math.max(to, 0), 1) });
  return true;
}

function keyAction(viewer, { key, shiftKey }) {
  const { state } = viewer;
  const next = (list, value) => list[(list.indexOf(value) + 1) % list.length];
  if (shiftKey) {
    const pan = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[key];
    if (pan) return () => panBy(viewer, PAN_STEP * pan[0], PAN_STEP * pan[1]);
  }
  if (/^[0-9]$/.test(key)) return key < viewer.images.length ? () => viewer.show(state.group, Number(key)) : null;
  return {
    ArrowRight: () => viewer.step(1),
    ArrowLeft: () => viewer.step(-1),
    ArrowDown: () => viewer.stepGroup(1),
    ArrowUp: () => viewer.stepGroup(-1),
    '+': () => zoomAt(viewer, 1.5),
    '=': () => zoomAt(viewer, 1.5),
    '-': () => zoomAt(viewer, 1 / 1.5),
    f: () => viewer.change({ zoom: null, centre: null }),
    a: () => viewer.change({ other: state.image }),
    l: () => viewer.change({ layout: next(LAYOUTS, state.layout) }),
    m: () => viewer.change({ mode: next(MODES, state.mode), range: null }),
    t: () => viewer.change({ tone: next(TONES, state.tone) }),
    e: () => viewer.change({ stops: state.stops + 0.5 }),
    E: () => viewer.change({ stops: state.stops - 0.5 }),
    c: () => viewer.crops.addVisible(),
  }[key];
}
