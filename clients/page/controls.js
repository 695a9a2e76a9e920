// Mouse, touch and keys on the picture, as movements of a camera and clicks.

const CLICK_PIXELS = 4;
const STEP = Math.PI / 24; // of an arrow key
const PAN_STEP = 0.05; // of the picture's height

/**
 * @param handlers.moved called after the camera has moved
 * @param handlers.clicked called with {x, y} in [0, 1] of the picture, y down
 * @param handlers.reset called when the whole mesh is to be framed
 */
export function attachControls(canvas, camera, handlers) {
  const pointers = new Map(); // those that are down, by id: their last place
  let travelled = 0; // pixels since the first went down: a click stays small
  let gesture = null; // distance and middle of two fingers

  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return { x: (event.clientX - box.left) / box.width, y: (event.clientY - box.top) / box.height };
  };
  const turn = (dx, dy) =>
    camera.orbit((-dx / canvas.clientHeight) * Math.PI, (dy / canvas.clientHeight) * Math.PI);
  const pan = (dx, dy) => camera.pan(-dx / canvas.clientHeight, dy / canvas.clientHeight);

  canvas.addEventListener('contextmenu', (event) => event.preventDefault());

  canvas.addEventListener('pointerdown', (event) => {
    canvas.setPointerCapture(event.pointerId);
    if (pointers.size === 0) travelled = 0;
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    gesture = twoFingers(pointers);
  });

  canvas.addEventListener('pointermove', (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) return;
    const dx = event.clientX - last.x;
    const dy = event.clientY - last.y;
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    travelled += Math.abs(dx) + Math.abs(dy);
    if (travelled < CLICK_PIXELS) return;
    if (pointers.size === 2) {
      const now = twoFingers(pointers);
      camera.zoom(gesture.distance / Math.max(1, now.distance));
      pan(now.x - gesture.x, now.y - gesture.y);
      gesture = now;
    } else if (event.shiftKey || event.buttons & 2 || event.buttons & 4) {
      pan(dx, dy);
    } else {
      turn(dx, dy);
    }
    handlers.moved();
  });

  const release = (event) => {
    if (!pointers.delete(event.pointerId)) return;
    gesture = twoFingers(pointers);
    const isClick = event.type === 'pointerup' && event.button === 0 && travelled < CLICK_PIXELS;
    if (isClick && pointers.size === 0) handlers.clicked(place(event));
  };
  canvas.addEventListener('pointerup', release);
  canvas.addEventListener('pointercancel', release);

  canvas.addEventListener(
    'wheel',
    (event) => {
      event.preventDefault();
      const pixels = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 20 : 1);
      camera.zoom(Math.exp(Math.max(-300, Math.min(300, pixels)) * 0.0015));
      handlers.moved();
    },
    { passive: false },
  );

  canvas.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const action = keyAction(event, camera, handlers);
    if (!action) return;
    event.preventDefault();
    action();
  });
}

function twoFingers(pointers) {
  if (pointers.size !== 2) return null;
  const [a, b] = pointers.values();
  return {
    x: (a.x + b.x) / 2,
    y: (a.y + b.y) / 2,
    distance: Math.hypot(a.x - b.x, a.y - b.y),
  };
}

function keyAction(event, camera, handlers) {
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const move = (change) => () => {
    change();
    handlers.moved();
  };
  const arrow = arrows[event.key];
  if (arrow && event.shiftKey)
    return move(() => camera.pan(arrow[0] * PAN_STEP, arrow[1] * PAN_STEP));
  if (arrow) return move(() => camera.orbit(arrow[0] * STEP, arrow[1] * STEP));
  if (event.key === '+' || event.key === '=') return move(() => camera.zoom(1 / 1.15));
  if (event.key === '-') return move(() => camera.zoom(1.15));
  if (event.key === 'Home' || event.key === '0') return handlers.reset;
  // A ray through the middle: what a click is for those who use no mouse.
  if (event.key === 'Enter') return () => handlers.clicked({ x: 0.5, y: 0.5 });
  return null;
}
