// Pointer and wheel on the stage: drag pans, Shift + drag marks a crop, two fingers and the wheel zoom.

function listenToPointer(viewer) {
  const { stage, handle } = viewer;
  const down = new Map(); // positions of the pointers on the stage, by id
  let start = null;

  const place = (event) => {
    const box = stage.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  };

  stage.addEventListener('pointerdown', (event) => {
    if (event.target === handle || event.button !== 0) return;
    stage.focus({ preventScroll: true });
    down.set(event.pointerId, place(event));
    start = event.shiftKey ? pointed(viewer, ...Object.values(place(event))) : null;
    try {
      stage.setPointerCapture(event.pointerId);
    } catch {} // the pointer has already left
  });

  // Without this the browser scrolls with two fingers and cancels their events.
  stage.addEventListener('touchstart', (event) => {
    if (event.touches.length > 1) event.preventDefault();
  }, { passive: false });

  stage.addEventListener('pointermove', (event) => {
    const now = place(event), before = down.get(event.pointerId);
    viewer.pointer = now;
    if (before) {
      down.set(event.pointerId, now);
      if (start) mark(viewer, start, now);
      else if (down.size === 2) pinch(viewer, [...down.entries()], event.pointerId, before);
      else if (event.pointerType !== 'touch' || viewer.state.zoom !== null) panBy(viewer, now.x - before.x, now.y - before.y);
    }
    viewer.controls.read();
  });

  for (const kind of ['pointerup', 'pointercancel']) {
    stage.addEventListener(kind, (event) => {
      down.delete(event.pointerId);
      if (start && kind === 'pointerup') viewer.crops.add(viewer.marking);
      start = viewer.marking = null;
      viewer.schedule();
    });
  }

  stage.addEventListener('pointerleave', () => {
    viewer.pointer = null;
    viewer.controls.read();
  });

  // The wheel scrolls the page until a click or a key gives the focus to the stage.
  stage.addEventListener('wheel', (event) => {
    if (!stage.contains(document.activeElement) && !event.ctrlKey) return;
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 30 : 1;
    zoomAt(viewer, Math.exp(-event.deltaY * lines * (event.ctrlKey ? 0.01 : 0.0016)), place(event));
  }, { passive: false });

  stage.addEventListener('dblclick', (event) => {
    const at = pointed(viewer, ...Object.values(place(event)));
    if (event.target === handle || !at) return;
    if (viewer.state.layout === 'all') viewer.change({ layout: 'one', image: at.pane.index });
    else viewer.change({ zoom: null, centre: null });
  });

  handle.addEventListener('pointerdown', (event) => handle.setPointerCapture(event.pointerId));
  handle.addEventListener('pointermove', (event) => {
    if (!handle.hasPointerCapture(event.pointerId)) return;
    viewer.change({ split: Math.min(Math.max(place(event).x / viewer.size.width, 0), 1) });
  });
}

// Two fingers: the one that moves zooms around the other.
function pinch(viewer, fingers, moved, before) {
  const [, now] = fingers.find(([id]) => id === moved), [, still] = fingers.find(([id]) => id !== moved);
  const distance = (a, b) => Math.hypot(a.x - b.x, a.y - b.y);
  zoomAt(viewer, distance(now, still) / Math.max(distance(before, still), 1), still);
}

// The crop between the start of the drag and its present position.
function mark(viewer, { pane, x, y }, now) {
  const { group } = viewer;
  const to = { x: (now.x - pane.origin.x) / pane.scale, y: (now.y - pane.origin.y) / pane.scale };
  const inside = (v, n) => Math.min(Math.max(v, 0), n);
  const [left, right] = [x, to.x].sort((a, b) => a - b).map((v) => inside(v, group.width));
  const [top, bottom] = [y, to.y].sort((a, b) => a - b).map((v) => inside(v, group.height));
  viewer.marking = {
    x: Math.floor(left), y: Math.floor(top),
    width: Math.ceil(right) - Math.floor(left), height: Math.ceil(bottom) - Math.floor(top),
  };
  viewer.schedule();
}
