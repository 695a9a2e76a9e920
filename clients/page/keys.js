// SPDX-License-Identifier: Apache-2.0
// Keys on the picture. The help dialog in index.html lists them.

const STEP = Math.PI / 24; // of an arrow key
const PAN_STEP = 0.05; // of the picture's height
const ZOOM_STEP = 1.15;

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/**
 * @param handlers.moved called after the camera has moved
 * @param handlers.clicked called with {x, y} in [0, 1] of the picture, y down
 * @param handlers.doubleClicked the same
 * @param handlers.actions functions by key
 */
export function attachKeys(canvas, camera, handlers) {
  canvas.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const action = movement(event, camera, handlers) ?? pointing(event, handlers) ??
      handlers.actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });
}

function movement(event, camera, { moved }) {
  const move = (change) => () => {
    change();
    moved();
  };
  const arrow = ARROWS[event.key];
  if (arrow && event.shiftKey)
    return move(() => camera.pan(arrow[0] * PAN_STEP, arrow[1] * PAN_STEP));
  if (arrow) return move(() => camera.orbit(arrow[0] * STEP, arrow[1] * STEP));
  if (event.key === '+' || event.key === '=') return move(() => camera.zoom(1 / ZOOM_STEP));
  if (event.key === '-') return move(() => camera.zoom(ZOOM_STEP));
  return null;
}

/** Rays through the middle: what clicks are for those who use no mouse. */
function pointing(event, { clicked, doubleClicked }) {
  if (event.key !== 'Enter') return null;
  const middle = { x: 0.5, y: 0.5 };
  return event.shiftKey ? () => doubleClicked(middle) : () => clicked(middle);
}
