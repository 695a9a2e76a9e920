// SPDX-License-Identifier: Apache-2.0
// Keeps the canvas up to date. At most one picture is requested at a time: rough ones while things
// move, then the full size, then the same with smooth silhouettes. A picture that is no longer
// wanted is cancelled, which also ends its work in the server.
import { serverTiming } from './api.js';
import { isAbort } from './errors.js';

const STILL_AFTER_MS = 140;
const ROUGH_FRAME_MS = 80; // the size of rough pictures is steered to take about that long
const ROUGH_LEAST = 0.5; // of the size in CSS pixels: smaller pictures look like stamps
const LARGEST_SIDE = 3072;
const SLOW_MS = 4000; // a full picture that took longer is not made finer
const BUSY_AFTER_MS = 350;

const STAGES = ['none', 'rough', 'full', 'fine'];
const [NONE, ROUGH, FULL, FINE] = STAGES.keys();

/** Samples per pixel by mode and stage; undefined leaves the choice to the server. */
const SAMPLES = {
  shaded: { [ROUGH]: 1, [FULL]: 1 },
  normal: { [ROUGH]: 1, [FULL]: 1 },
  'ambient-occlusion': { [ROUGH]: 4, [FULL]: 16, [FINE]: 64 },
};

export class Picture {
  /**
   * @param handlers.onShown called with {camera, width, height, precision, depthRange, traceMs,
   *     totalMs, stage, isSettled}
   * @param handlers.onError called with what the request threw
   * @param handlers.onBusy called with whether the canvas lags behind noticeably
   */
  constructor(canvas, api, handlers) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d');
    this.api = api;
    this.handlers = handlers;
    this.scene = null; // {id, camera, query}
    this.version = 0; // counts changes of the scene
    this.shown = { version: -1, stage: NONE };
    this.bitmap = null; // {image, camera}
    this.inFlight = null;
    this.roughScale = 0.7;
    this.isHeld = false;
    new ResizeObserver(() => this.resize()).observe(canvas);
  }

  /** Width over height of the picture. */
  get aspect() {
    return this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
  }

  /** Whether nothing is requested, and nothing is to be. */
  get isIdle() {
    return !this.inFlight && !this.isMoving && this.wantedStage() === NONE;
  }

  /** Shows `scene`: {id, camera, query}, or null for nothing. */
  show(scene, { moving = false } = {}) {
    const isOther = this.scene?.id !== scene?.id;
    if (isOther) this.bitmap = null;
    this.scene = scene && { ...scene, camera: scene.camera.clone() };
    this.version += 1;
    delete this.canvas.dataset.settled;
    clearTimeout(this.stillTimer);
    this.isMoving = moving;
    if (moving) this.isHeld = false;
    // Of a mesh that was not seen before, anything is better than waiting for the full picture.
    this.isNew = (this.isNew || isOther) && Boolean(scene);
    if (moving) this.stillTimer = setTimeout(() => this.settle(), STILL_AFTER_MS);
    this.draw();
    this.next();
  }

  settle() {
    this.isMoving = false;
    this.next();
  }

  /** Cancels a picture in flight that is not rough. No other follows until release() or a move. */
  hold() {
    this.isHeld = true;
    if (this.inFlight?.stage > ROUGH) this.inFlight.abort.abort();
  }

  release() {
    this.isHeld = false;
    this.next();
  }

  /** Requests again what could not be had, for example while the server was gone. */
  retry() {
    this.shown = { version: -1, stage: NONE };
    this.next();
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(this.canvas.clientWidth * ratio);
    this.canvas.height = Math.round(this.canvas.clientHeight * ratio);
    this.draw();
    if (this.scene) this.show(this.scene, { moving: true });
  }

  /** Size in pixels of a request at this fraction of the full size. */
  size(part = 1) {
    const { width, height } = this.canvas;
    const fit = Math.min(part, LARGEST_SIDE / Math.max(width, height, 1));
    return {
      width: Math.max(16, Math.round(width * fit)),
      height: Math.max(16, Math.round(height * fit)),
    };
  }

  /** Starts the next request if there is something to do and none is in flight. */
  next() {
    if (this.inFlight) {
      // A rough picture is nearly there and better than none; a large one of yesterday is dropped,
      // and so is any of another tree.
      const isStale = this.inFlight.version !== this.version;
      const isDear = this.inFlight.stage > ROUGH || this.inFlight.id !== this.scene?.id;
      if (isStale && isDear) this.inFlight.abort.abort();
      return;
    }
    const stage = this.wantedStage();
    if (stage !== NONE && !this.isHeld) this.request(stage);
  }

  wantedStage() {
    if (!this.scene || !this.canvas.width || !this.canvas.height) return NONE;
    const current = this.shown.version === this.version ? this.shown.stage : NONE;
    if (this.isMoving || this.isNew) return current === NONE ? ROUGH : NONE;
    return current < this.lastStage() ? Math.max(FULL, current + 1) : NONE;
  }

  /** The best stage that this scene has. */
  lastStage() {
    const isSlow = this.shown.version === this.version && this.shown.totalMs > SLOW_MS;
    return this.scene.query.mode in SAMPLES && !isSlow ? FINE : FULL;
  }

  parameters(stage) {
    const { camera, query } = this.scene;
    const roughPart = this.roughScale / (window.devicePixelRatio || 1);
    const parameters = {
      ...query,
      ...camera.parameters(),
      ...this.size(stage === ROUGH ? roughPart : 1),
    };
    const samples = SAMPLES[query.mode]?.[stage];
    if (samples) parameters.samples = samples;
    return parameters;
  }

  async request(stage) {
    const { id, camera } = this.scene;
    const version = this.version;
    const abort = new AbortController();
    this.inFlight = { version, stage, id, abort };
    if (stage < FINE) this.expect();
    try {
      const parameters = this.parameters(stage);
      const started = performance.now();
      // Rough pictures are many, and none is asked for twice.
      const cache = stage === ROUGH ? 'no-store' : 'default';
      const options = { signal: abort.signal, cache };
      const { blob, headers } = await this.api.render(id, parameters, options);
      const image = await createImageBitmap(blob);
      abort.signal.throwIfAborted();
      const totalMs = performance.now() - started;
      if (stage === ROUGH) this.steer(totalMs);
      if (this.scene?.id === id) {
        this.bitmap?.image.close(); // frees its memory now: moving makes many
        this.bitmap = { image, camera };
        this.shown = { version, stage, totalMs };
        this.isNew = false;
        this.draw();
        this.tell(stage, camera, parameters, headers, totalMs);
      }
    } catch (error) {
      this.fail(error, version);
    }
    this.inFlight = null;
    this.next();
  }

  tell(stage, camera, { width, height }, headers, totalMs) {
    const isCurrent = this.shown.version === this.version;
    const isSettled = isCurrent && stage >= this.lastStage();
    this.canvas.dataset.stage = STAGES[stage];
    if (isSettled) this.canvas.dataset.settled = 'true';
    if (stage >= FULL ? isCurrent : this.isMoving) this.busy(false);
    this.handlers.onShown({
      camera,
      width,
      height,
      stage: STAGES[stage],
      isSettled,
      totalMs,
      precision: headers.get('Kdray-Precision'),
      depthRange: headers.get('Kdray-Depth-Range'),
      traceMs: serverTiming(headers).trace,
    });
  }

  fail(error, version) {
    if (isAbort(error)) return;
    this.busy(false);
    // Asking the same again at once would give the same: this version counts as shown.
    this.shown = { version, stage: FINE, totalMs: 0 };
    this.isNew = false;
    if (error.isOutage) return; // retry() follows when the server is back
    if (error.retryAfterMs) setTimeout(() => this.retry(), error.retryAfterMs);
    else this.handlers.onError(error);
  }

  /** Says that the canvas lags behind if the full picture takes long. */
  expect() {
    this.busyTimer ??= setTimeout(() => this.busy(true), BUSY_AFTER_MS);
  }

  busy(isBusy) {
    clearTimeout(this.busyTimer);
    this.busyTimer = null;
    this.handlers.onBusy(isBusy);
  }

  /** Adapts the size of rough pictures to their speed. */
  steer(tookMs) {
    const factor = Math.sqrt(ROUGH_FRAME_MS / Math.max(tookMs, 1));
    const wanted = this.roughScale * Math.max(0.8, Math.min(1.15, factor));
    this.roughScale = Math.max(ROUGH_LEAST, Math.min(1, wanted));
  }

  /** What is seen: {camera, x, y, zoom}, the last picture's camera and how it is moved; or null. */
  get placement() {
    if (!this.bitmap || !this.scene) return null;
    const { camera } = this.bitmap;
    const shift = this.scene.camera.shiftFrom(camera, this.aspect);
    return { camera, ...(shift ?? { x: 0.5, y: 0.5, zoom: 1 }) };
  }

  /** Draws the last picture, moved to where the camera is now: pans and zooms are seen at once. */
  draw() {
    const { width, height } = this.canvas;
    this.context.clearRect(0, 0, width, height);
    if (!this.placement) return;
    const { x, y, zoom } = this.placement;
    const { image } = this.bitmap;
    const drawnHeight = height * zoom;
    const drawnWidth = (drawnHeight * image.width) / image.height;
    this.context.imageSmoothingQuality = 'high';
    this.context.drawImage(
      image, x * width - drawnWidth / 2, y * height - drawnHeight / 2, drawnWidth, drawnHeight,
    );
  }
}
