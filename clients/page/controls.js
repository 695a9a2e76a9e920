// SPDX-License-Identifier: Apache-2.0
// Mouse and touch on the picture, as movements of a camera and clicks.

const CLICK_PIXELS = 4;
const TAP_PIXELS = 10; // fingers are less steady
const DOUBLE_MS = 350;
const DOUBLE_PIXELS = { mouse: 6, pen: 12, touch: 30 };
const NEW_WHEEL_MS = 300; // without an event: the next one begins a gesture

/**
 * @param handlers.moved called after the camera has moved
 * @param handlers.pressed called when a button or finger goes down: what follows is to be quick
 * @param handlers.clicked called with {x, y} in [0, 1] of the picture, y down
 * @param handlers.doubleClicked the same, for the second of two clicks
 * @param handlers.zooming called with {x, y} when a gesture begins to zoom there
 */
export function attachControls(canvas, camera, handlers) {
  const pointers = new Map(); // those that are down, by id: their last place
  let travelled = 0; // pixels since the first went down: a click stays small
  let gesture = null; // distance and middle of two fingers
  let lastClick = { time: -Infinity };
  let lastWheel = -Infinity;

  const place = ({ x, y }) => {
    const box = canvas.getBoundingClientRect();
    return { x: (x - box.left) / box.width, y: (y - box.top) / box.height };
  };
  const placeOf = (event) => place({ x: event.clientX, y: event.clientY });
  const aspect = () => canvas.clientWidth / Math.max(1, canvas.clientHeight);
  const turn = (dx, dy) =>
    camera.orbit((-dx / canvas.clientHeight) * Math.PI, (dy / canvas.clientHeight) * Math.PI);
  const pan = (dx, dy) => camera.pan(-dx / canvas.clientHeight, dy / canvas.clientHeight);

  canvas.addEventListener('contextmenu', (event) => event.preventDefault());

  canvas.addEventListener('pointerdown', (event) => {
    canvas.setPointerCapture(event.pointerId);
    if (pointers.size === 0) travelled = 0;
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    gesture = twoFingers(pointers);
    if (gesture) handlers.zooming(place(gesture));
    handlers.pressed(event.pointerType);
  });

  canvas.addEventListener('pointermove', (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) return;
    const dx = event.clientX - last.x;
    const dy = event.clientY - last.y;
    travelled += Math.abs(dx) + Math.abs(dy);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (travelled < (event.pointerType === 'touch' ? TAP_PIXELS : CLICK_PIXELS)) return;
    if (pointers.size === 2) {
      const now = twoFingers(pointers);
      pan(now.x - gesture.x, now.y - gesture.y);
      camera.zoom(gesture.distance / Math.max(1, now.distance), place(now), aspect());
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
    const wasGesture = gesture !== null;
    gesture = twoFingers(pointers);
    if (wasGesture) travelled = Infinity; // the other finger's release is no click
    const limit = event.pointerType === 'touch' ? TAP_PIXELS : CLICK_PIXELS;
    const isClick = event.type === 'pointerup' && event.button === 0 && travelled < limit;
    if (!isClick || pointers.size > 0) return handlers.released();
    const click = { time: event.timeStamp, x: event.clientX, y: event.clientY };
    const isDouble =
      click.time - lastClick.time < DOUBLE_MS &&
      Math.hypot(click.x - lastClick.x, click.y - lastClick.y) < DOUBLE_PIXELS[event.pointerType];
    lastClick = isDouble ? { time: -Infinity } : click;
    return isDouble ? handlers.doubleClicked(placeOf(event)) : handlers.clicked(placeOf(event));
  };
  canvas.addEventListener('pointerup', release);
  canvas.addEventListener('pointercancel', release);

  canvas.addEventListener(
    'wheel',
    (event) => {
      event.preventDefault();
      const where = placeOf(event);
      if (event.timeStamp - lastWheel > NEW_WHEEL_MS) handlers.zooming(where);
      lastWheel = event.timeStamp;
      const pixels = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 20 : 1);
      // Trackpads report a pinch as small wheel steps with Ctrl.
      const speed = event.ctrlKey ? 0.01 : 0.0015;
      camera.zoom(Math.exp(Math.max(-300, Math.min(300, pixels)) * speed), where, aspect());
      handlers.moved();
    },
    { passive: false },
  );
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
