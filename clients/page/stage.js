// SPDX-License-Identifier: Apache-2.0
// The picture with all that belongs to it: the camera, what moves it, the lines over the picture,
// the legend, and the file of the picture.
import { OrbitCamera } from './camera.js';
import { attachControls } from './controls.js';
import { byId, saveBlob } from './dom.js';
import { attachKeys } from './keys.js';
import { showLegend } from './legend.js';
import { Overlay } from './overlay.js';
import { Picture } from './picture.js';
import { millisecondsText } from './text.js';

export class Stage {
  /**
   * @param handlers.query gives the fields of a render request except the camera's
   * @param handlers.shot called with a ray when the picture was clicked
   * @param handlers.surfaceAt promises the mesh's point on a ray, or null
   * @param handlers.shown called with what Picture tells of each picture
   * @param handlers.actions functions by key
   * @param handlers.onError called with what a request threw
   */
  constructor(api, handlers) {
    this.api = api;
    this.handlers = handlers;
    this.canvas = byId('canvas');
    this.camera = new OrbitCamera();
    this.urgent = 0; // requests that go before pictures
    this.overlay = new Overlay(byId('overlay'), byId('marker'));
    this.picture = new Picture(this.canvas, api, {
      onShown: (shown) => this.pictureShown(shown),
      onError: handlers.onError,
      onBusy: (isBusy) => (byId('busy').hidden = !isBusy),
    });
    const gestures = {
      moved: () => this.refresh({ moving: true }),
      pressed: (pointerType) => {
        this.fitHints(pointerType);
        this.picture.hold();
      },
      released: () => this.urgent === 0 && this.picture.release(),
      clicked: (place) => this.click(place),
      doubleClicked: (place) => this.pivot(place),
      zooming: (place) => this.focus(place),
      actions: handlers.actions,
    };
    attachControls(this.canvas, this.camera, gestures);
    attachKeys(this.canvas, this.camera, gestures);
    const coarse = matchMedia('(pointer: coarse)');
    const fit = () => this.fitHints(coarse.matches ? 'touch' : 'mouse');
    coarse.addEventListener('change', fit);
    fit();
    new ResizeObserver(() => this.followCamera()).observe(this.canvas);
  }

  get aspect() {
    return this.picture.aspect;
  }

  get isIdle() {
    return this.picture.isIdle && this.urgent === 0;
  }

  /** Shows another tree; null shows none. */
  choose(tree) {
    this.tree = tree;
    if (!tree) {
      this.picture.show(null);
      byId('status').textContent = '';
      byId('legend').hidden = true;
      return;
    }
    this.camera.measure(tree.mesh.bounds.min, tree.mesh.bounds.max);
  }

  /** Frames the whole mesh, from the side that `view` names. */
  frame(view) {
    if (!this.tree) return;
    const { min, max } = this.tree.mesh.bounds;
    this.camera.frame(min, max, this.aspect, view);
  }

  refresh({ moving = false } = {}) {
    if (!this.tree) return;
    // The page's own background shows through.
    const query = { ...this.handlers.query(), background: 'transparent' };
    this.picture.show({ id: this.tree.id, camera: this.camera, query }, { moving });
    this.followCamera();
  }

  followCamera() {
    this.overlay.follow(this.picture.placement, this.aspect);
  }

  /** The ray through a place of what is seen, which may lag behind the camera. */
  rayAt({ x, y }) {
    const seen = this.picture.placement;
    if (!seen) return this.camera.ray(x, y, this.aspect);
    const { camera, zoom } = seen;
    return camera.ray(0.5 + (x - seen.x) / zoom, 0.5 + (y - seen.y) / zoom, this.aspect);
  }

  pictureShown(shown) {
    const { width, height, precision, depthRange, traceMs, totalMs } = shown;
    this.followCamera();
    const parts = [`${width} × ${height}`, precision, `traced in ${millisecondsText(traceMs)}`];
    byId('status').textContent = parts.filter(Boolean).join(' · ');
    byId('status').title = `Here after ${millisecondsText(totalMs)}`;
    showLegend(this.handlers.query().mode, depthRange);
    this.handlers.shown(shown);
  }

  /** The answer to a click is not to wait for the page's own pictures. */
  async first(work) {
    this.picture.hold();
    ++this.urgent;
    try {
      return this.tree ? await work() : null;
    } finally {
      if (--this.urgent === 0) this.picture.release();
    }
  }

  click(place) {
    return this.first(() => this.handlers.shot(this.rayAt(place)));
  }

  /** Makes the surface at a place what the camera circles. */
  async pivot(place) {
    const ray = this.rayAt(place);
    const point = await this.first(() => this.handlers.surfaceAt(ray));
    if (!point) return;
    this.camera.pivot(point);
    this.refresh({ moving: true });
  }

  /** Zooming goes towards the surface that is seen at a place. */
  async focus(place) {
    if (!this.tree) return;
    const point = await this.handlers.surfaceAt(this.rayAt(place));
    if (point) this.camera.focus(point);
  }

  /** The hints of the device that was used last. */
  fitHints(pointerType) {
    const isTouch = pointerType === 'touch';
    byId('hint-mouse').hidden = isTouch;
    byId('hint-touch').hidden = !isTouch;
  }

  /** Saves the picture in its best quality, without background. */
  async save(name) {
    const query = {
      ...this.handlers.query(),
      ...this.camera.parameters(),
      ...this.picture.size(),
      background: 'transparent',
    };
    const { blob } = await this.api.render(this.tree.id, query);
    saveBlob(blob, `${name}.png`);
  }
}
