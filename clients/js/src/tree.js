// SPDX-License-Identifier: Apache-2.0
// @ts-check
// A tree of a server: ray and point queries, renders, scans, cells, the trade-off.
import { arrayOf, pngOf } from './picture.js';
import { columnsOf, hitsOf, pairsOf, valuesOf } from './queries.js';
import { asRows } from './rows.js';
import { beamRays, hitBeams, hitPixels } from './scan.js';
import { wireFields } from './transport.js';

/** @typedef {import('../kdray.js').NumberRows} NumberRows */
/** @typedef {import('../kdray.js').RayOptions} RayOptions */
/** @typedef {import('../kdray.js').PointOptions} PointOptions */

const RAY_FIELDS = ['t', 'triangle', 'u', 'v'];
const POINT_FIELDS = ['distance', 'point', 'triangle', 'u', 'v'];
const MEASURE_WAIT_MS = 250; // between two looks at a measurement

/** @param {NumberRows} rays @param {RayOptions} options */
const rayRows = (rays, { columns }) => asRows(rays, [6, 8], 'rays', columns);

/** @param {NumberRows} points */
const pointRows = (points, what = 'points') => asRows(points, [3], what);

export class Tree {
  /**
   * @param {import('./client.js').Client} client
   * @param {import('../kdray.js').TreeDescription} description
   */
  constructor(client, description) {
    this.client = client;
    this.description = description;
  }

  get id() {
    return this.description.id;
  }

  /** @internal */
  get path() {
    return `v1/trees/${this.id}`;
  }

  /** @param {{signal?: AbortSignal}} [options] */
  async refresh({ signal } = {}) {
    this.description = await this.client.transport.json('GET', this.path, { signal });
    return this;
  }

  /** @param {NumberRows} rays @param {RayOptions & {fields?: string[]}} [options] @returns {Promise<any>} */
  async closest(rays, options = {}) {
    return columnsOf(this.client, `${this.path}/rays/closest`, rayRows(rays, options), options, RAY_FIELDS);
  }

  /** @param {NumberRows} rays @param {RayOptions} [options] */
  async any(rays, options = {}) {
    return valuesOf(this.client, `${this.path}/rays/any`, rayRows(rays, options), options);
  }

  /** @param {NumberRows} rays @param {RayOptions} [options] */
  async count(rays, options = {}) {
    return valuesOf(this.client, `${this.path}/rays/count`, rayRows(rays, options), options);
  }

  /** @param {NumberRows} rays @param {RayOptions & {fields?: string[], maxHits?: number}} [options] @returns {Promise<any>} */
  async all(rays, options = {}) {
    return hitsOf(this.client, `${this.path}/rays/all`, rayRows(rays, options), options, RAY_FIELDS);
  }

  /** @param {NumberRows} points @param {PointOptions & {fields?: string[]}} [options] @returns {Promise<any>} */
  async closestPoints(points, options = {}) {
    return columnsOf(this.client, `${this.path}/points/closest`, pointRows(points), options, POINT_FIELDS);
  }

  /** @param {NumberRows} points @param {PointOptions} [options] */
  async signedDistance(points, options = {}) {
    return valuesOf(this.client, `${this.path}/points/signed-distance`, pointRows(points), options);
  }

  /** @param {NumberRows} points @param {PointOptions} [options] */
  async inside(points, options = {}) {
    return valuesOf(this.client, `${this.path}/points/inside`, pointRows(points), options);
  }

  /** @param {NumberRows} from @param {NumberRows} to @param {import('../kdray.js').VisibilityOptions} [options] */
  async visibility(from, to, options = {}) {
    const sets = /** @type {const} */ ([pointRows(from, 'from'), pointRows(to, 'to')]);
    return pairsOf(this.client, `${this.path}/visibility`, ...sets, options);
  }

  /** @param {import('../kdray.js').RenderOptions} [options] */
  async render(options = {}) {
    return pngOf(this.client, this.path, options);
  }

  /** @param {import('../kdray.js').RenderOptions} [options] */
  async renderArray(options = {}) {
    return arrayOf(this.client, this.path, options);
  }

  /** @param {import('../kdray.js').RenderFields} [fields] */
  renderUrl(fields = {}) {
    return this.client.transport.url(`${this.path}/render.png`, wireFields({ ...fields }));
  }

  /** @param {import('../kdray.js').ScanOptions} [options] */
  async scan(options = {}) {
    const fields = { ...options, projection: 'spherical', mode: 'position' };
    const image = await arrayOf(this.client, this.path, /** @type {any} */ (fields));
    const positions = { data: /** @type {Float64Array} */ (image.data), shape: image.shape };
    return { ...hitPixels(positions), precision: image.precision };
  }

  /** @param {import('../kdray.js').BeamOptions} options */
  async scanBeams(options) {
    const { eye, target = this.middle(), up = [0, 1, 0], elevationsDeg, ...others } = options;
    const { hFovDeg = 360, width = 1024, ...query } = others;
    if (!(Number.isInteger(width) && width > 0)) {
      throw new RangeError(`width is ${width}; it must be an integer above 0`);
    }
    const rays = beamRays({ eye, target, up, elevationsDeg, hFovDeg, width });
    const hits = await this.closest(rays, { ...query, fields: ['t', 'triangle', 'point'] });
    return { ...hitBeams(hits, width), precision: hits.precision };
  }

  /** @internal @returns {[number, number, number]} */
  middle() {
    const bounds = this.description.mesh.bounds;
    if (!bounds) throw new Error('the bounds of the mesh are not known yet: refresh() the tree, or give a target');
    const { min, max } = bounds;
    return [(min[0] + max[0]) / 2, (min[1] + max[1]) / 2, (min[2] + max[2]) / 2];
  }

  /**
   * @param {{onProgress?: (fraction: number) => void, signal?: AbortSignal}} [options]
   * @returns {Promise<import('../kdray.js').Tradeoff>}
   */
  async tradeoff({ onProgress, signal } = {}) {
    const path = `${this.path}/tradeoff`;
    let answer = await this.client.transport.json('POST', path, { query: { wait_ms: 0 }, signal });
    for (;;) {
      onProgress?.(answer.progress);
      if (answer.state === 'measured') return answer;
      answer = await this.client.transport.json('GET', path, { query: { wait_ms: MEASURE_WAIT_MS }, signal });
    }
  }

  /** @param {number} depth @param {{signal?: AbortSignal}} [options] @returns {Promise<import('../kdray.js').Cell[]>} */
  async cells(depth, { signal } = {}) {
    const answer = await this.client.transport.json('GET', `${this.path}/cells`, { query: { depth }, signal });
    return answer.cells;
  }

  /** @param {{signal?: AbortSignal}} [options] */
  async mesh({ signal } = {}) {
    const { bytes } = await this.client.transport.request('GET', `${this.path}/mesh`, { signal });
    return new Uint8Array(bytes);
  }

  /** @param {{signal?: AbortSignal}} [options] @returns {Promise<void>} */
  async delete({ signal } = {}) {
    await this.client.transport.request('DELETE', this.path, { signal });
  }
}
