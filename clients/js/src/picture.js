// SPDX-License-Identifier: Apache-2.0
// @ts-check
// Renders: a PNG as bytes, or the pixels as a typed array.
import { decode, plainArray } from './npy.js';
import { wireFields } from './transport.js';

/** @param {Headers} headers @param {string} name */
function numberOf(headers, name) {
  const text = headers.get(name);
  return text === null ? undefined : Number(text);
}

/** @param {Headers} headers */
function reportOf(headers) {
  const range = headers.get('Kdray-Depth-Range')?.split(',').map(Number);
  return {
    precision: /** @type {any} */ (headers.get('Kdray-Precision')),
    samples: numberOf(headers, 'Kdray-Samples') ?? 1,
    noise: numberOf(headers, 'Kdray-Noise'),
    stopped: /** @type {any} */ (headers.get('Kdray-Stopped')),
    depthRange: /** @type {[number, number] | undefined} */ (range),
  };
}

/**
 * @param {import('./client.js').Client} client
 * @param {string} path
 * @param {import('../kdray.js').RenderOptions} options
 */
async function ask(client, path, { signal, ...fields }) {
  const body = JSON.stringify(wireFields(fields));
  return client.transport.request('POST', path, { body, type: 'application/json', signal });
}

/**
 * @param {import('./client.js').Client} client
 * @param {string} path of the tree
 * @param {import('../kdray.js').RenderOptions} options
 */
export async function pngOf(client, path, options) {
  const { bytes, headers } = await ask(client, `${path}/render.png`, options);
  return {
    bytes: new Uint8Array(bytes),
    type: /** @type {const} */ ('image/png'),
    blob: () => new Blob([bytes], { type: 'image/png' }),
    ...reportOf(headers),
  };
}

/**
 * @param {import('./client.js').Client} client
 * @param {string} path of the tree
 * @param {import('../kdray.js').RenderOptions} options
 */
export async function arrayOf(client, path, options) {
  const { bytes, headers } = await ask(client, `${path}/render.npy`, options);
  const array = decode(bytes);
  const data = /** @type {Float32Array | Float64Array | Int32Array} */ (plainArray(array));
  return { data, shape: array.shape, ...reportOf(headers) };
}
