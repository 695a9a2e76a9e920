// Keeps the canvas up to date. At most one request is in flight: small pictures while things move,
// then the full size, then the same with several rays a pixel.
import { serverTiming } from './api.js';

const STILL_AFTER_MS = 140;
const MOVING_FRAME_MS = 70; // the size of moving pictures is steered to take about that long
const LARGEST_SIDE = 2048;
const SMALLEST_SCALE = 0.12;
const FINE_SAMPLES = 8;
const SLOW_MS = 1500; // a full picture that took longer is not made finer

const QUALITY = { none: 0, moving: 1, full: 2, fine: 3 };
const QUALITY_NAMES = Object.keys(QUALITY);

export class Picture {
  /**
   * @param onShown called with {camera, width, height, precision, traceMs, totalMs, quality}
   * @param onError called with what the request threw
   */
  constructor(canvas, api, { onShown, onError }) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d');
    this.api = api;
    this.onShown = onShown;
    this.onError = onError;
    this.scene = null; // {id, camera, query}
    this.version = 0; // counts changes of the scene
    this.shown = { version: -1, quality: QUALITY.none };
    this.inFlight = null;
    this.movingScale = 0.4;
    this.canBeFine = true;
    new ResizeObserver(() => this.resize()).observe(canvas);
  }

  /** Width over height of the picture. */
  get aspect() {
    return this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
  }

  /** Shows `scene`: {id, camera, query}, or null for nothing. */
  show(scene, { moving = false } = {}) {
    if (this.scene?.id !== scene?.id) this.clear();
    this.scene = scene && { ...scene, camera: scene.camera.clone() };
    this.version += 1;
    clearTimeout(this.stillTimer);
    this.moving = moving;
    if (moving) {
      this.stillTimer = setTimeout(() => {
        this.moving = false;
        this.next();
      }, STILL_AFTER_MS);
    }
    this.next();
  }

  clear() {
    this.bitmap = null;
    this.draw();
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(this.canvas.clientWidth * ratio);
    this.canvas.height = Math.round(this.canvas.clientHeight * ratio);
    this.draw();
    if (this.scene) this.show(this.scene, { moving: true });
  }

  /** Size in pixels of a request at this fraction of the full size. */
  size(part) {
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
      // A small picture is nearly there and better than none; a large one of yesterday is dropped,
      // and so is any of another tree.
      const stale = this.inFlight.version !== this.version;
      const dear = this.inFlight.quality > QUALITY.moving || this.inFlight.id !== this.scene?.id;
      if (stale && dear) this.inFlight.abort.abort();
      return;
    }
    const quality = this.wantedQuality();
    if (quality !== QUALITY.none) this.request(quality);
  }

  wantedQuality() {
    if (!this.scene || !this.canvas.width || !this.canvas.height) return QUALITY.none;
    const current = this.shown.version === this.version ? this.shown.quality : QUALITY.none;
    if (this.moving) return current === QUALITY.none ? QUALITY.moving : QUALITY.none;
    if (current < QUALITY.full) return QUALITY.full;
    return current < QUALITY.fine && this.canBeFine && this.isFineUseful()
      ? QUALITY.fine
      : QUALITY.none;
  }

  /** The other modes take one sample per pixel; more is an error. */
  takesSamples() {
    return !['depth', 'triangle', 'cost'].includes(this.scene.query.mode);
  }

  isFineUseful() {
    return this.takesSamples() && this.shown.totalMs < SLOW_MS;
  }

  async request(quality) {
    const { id, camera, query } = this.scene;
    const version = this.version;
    const size = this.size(quality === QUALITY.moving ? this.movingScale : 1);
    const abort = new AbortController();
    this.inFlight = { version, quality, id, abort };
    try {
      const parameters = { ...query, ...camera.parameters(), ...size };
      if (quality === QUALITY.fine) parameters.samples = FINE_SAMPLES;
      if (quality === QUALITY.moving && this.takesSamples()) parameters.samples = 1;
      const started = performance.now();
      const response = await this.api.render(id, parameters, abort.signal);
      const bitmap = await createImageBitmap(await response.blob());
      const totalMs = performance.now() - started;
      if (quality === QUALITY.moving) this.steer(totalMs);
      if (this.scene?.id === id) {
        this.bitmap = bitmap;
        this.draw();
        this.shown = { version, quality, totalMs };
        this.onShown({
          camera,
          ...size,
          quality: QUALITY_NAMES[quality],
          totalMs,
          precision: response.headers.get('Kdray-Precision'),
          traceMs: serverTiming(response).trace,
        });
      }
    } catch (error) {
      this.fail(error, version, quality);
    }
    this.inFlight = null;
    this.next();
  }

  fail(error, version, quality) {
    if (error.name === 'AbortError') return;
    // Asking the same again would give the same: this version counts as shown.
    this.shown = { version, quality: QUALITY.fine, totalMs: 0 };
    if (quality === QUALITY.fine) this.canBeFine = false;
    else this.onError(error);
  }

  /** Adapts the size of moving pictures to their speed. */
  steer(tookMs) {
    const factor = Math.sqrt(MOVING_FRAME_MS / Math.max(tookMs, 1));
    const scale = this.movingScale * Math.max(0.7, Math.min(1.15, factor));
    this.movingScale = Math.max(SMALLEST_SCALE, Math.min(1, scale));
  }

  draw() {
    const { width, height } = this.canvas;
    this.context.clearRect(0, 0, width, height);
    if (!this.bitmap) return;
    this.context.imageSmoothingQuality = 'high';
    this.context.drawImage(this.bitmap, 0, 0, width, height);
  }
}
