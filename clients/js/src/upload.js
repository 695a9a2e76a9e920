// SPDX-License-Identifier: Apache-2.0
// @ts-check
// Uploads: a mesh in any form as bytes, its tree id before it is sent, and the progress of sending.
import { plyOf } from './ply.js';

/** @typedef {import('./transport.js').Answer} Answer */
/** @typedef {(loaded: number, total: number) => void} OnBytes */

const CHUNK_BYTES = 256 * 1024;

/** @returns {boolean} Also true in Bun and Deno, which have Node's modules. */
const isNode = () => Boolean(/** @type {any} */ (globalThis).process?.versions?.node);

/** The name is a variable, so that bundlers for browsers leave the import alone. @param {string} name @returns {Promise<any>} */
const nodeModule = (name) => import(/* @vite-ignore */ /* webpackIgnore: true */ name);

/**
 * @param {import('../kdray.js').MeshSource} mesh
 * @returns {Promise<Blob | Uint8Array<ArrayBuffer>>}
 */
export async function bytesOf(mesh) {
  if (typeof mesh === 'string' || mesh instanceof URL) {
    if (!isNode()) throw new TypeError(`a path (${mesh}) needs Node; in a browser pass a File or bytes`);
    return (await nodeModule('node:fs/promises')).readFile(mesh);
  }
  if (mesh instanceof Blob) return mesh;
  if (mesh instanceof ArrayBuffer) return new Uint8Array(mesh);
  if (ArrayBuffer.isView(mesh)) {
    return new Uint8Array(/** @type {ArrayBuffer} */ (mesh.buffer), mesh.byteOffset, mesh.byteLength);
  }
  if (mesh?.vertices && mesh.faces) return plyOf(mesh.vertices, mesh.faces);
  throw new TypeError('a mesh is a path, a Blob, bytes, or an object with vertices and faces');
}

/** @param {Blob | Uint8Array} bytes */
export const sizeOf = (bytes) => (bytes instanceof Blob ? bytes.size : bytes.byteLength);

/**
 * The header with which a proxy before several servers finds the one that has the tree (RFC 9530).
 * Not from pages: it is no header that every server lets pages of other origins send.
 * @param {string | undefined} sha256
 */
export function digestHeader(sha256) {
  if (!sha256 || !isNode()) return undefined;
  const bytes = sha256.match(/../g)?.map((digits) => String.fromCharCode(parseInt(digits, 16)));
  return `sha-256=:${btoa((bytes ?? []).join(''))}:`;
}

/**
 * Lower-case hexadecimal digits; undefined in pages without HTTPS, where browsers have no hash.
 * @param {Blob | Uint8Array<ArrayBuffer>} bytes
 * @returns {Promise<string | undefined>}
 */
export async function sha256Of(bytes) {
  const crypto = globalThis.crypto ?? (isNode() ? (await nodeModule('node:crypto')).webcrypto : undefined);
  if (!crypto?.subtle) return undefined;
  const data = bytes instanceof Blob ? await bytes.arrayBuffer() : bytes;
  const digest = new Uint8Array(await crypto.subtle.digest('SHA-256', data));
  return Array.from(digest, (byte) => byte.toString(16).padStart(2, '0')).join('');
}

/**
 * The options of a request that sends `bytes` and reports its progress: by XMLHttpRequest in pages,
 * because fetch does not report the progress of an upload there; by a stream in Node.
 *
 * A refusal in the middle of a stream is mostly lost: Node's fetch meets the closed connection
 * before it reads the answer. So every other try sends the bytes as a whole, and gets the reason.
 * @param {Blob | Uint8Array<ArrayBuffer>} bytes
 * @param {OnBytes | undefined} onBytes
 * @returns {import('./transport.js').RequestOptions}
 */
export function sending(bytes, onBytes) {
  if (onBytes && typeof XMLHttpRequest !== 'undefined') {
    return { body: bytes, send: (url, init) => sendByXhr(url, init, onBytes) };
  }
  if (onBytes && isNode()) {
    return { body: (attempt) => (attempt % 2 ? bytes : streamOf(bytes, onBytes)) };
  }
  return { body: bytes };
}

/** @param {Blob | Uint8Array<ArrayBuffer>} bytes @param {OnBytes} onBytes */
function streamOf(bytes, onBytes) {
  const total = sizeOf(bytes);
  let sent = 0;
  return new ReadableStream({
    // Called when the chunk before was taken, so `sent` is what the connection has accepted.
    async pull(controller) {
      onBytes(sent, total);
      if (sent === total) return controller.close();
      const end = Math.min(sent + CHUNK_BYTES, total);
      const part = bytes.slice(sent, end);
      controller.enqueue(part instanceof Blob ? new Uint8Array(await part.arrayBuffer()) : part);
      sent = end;
    },
  });
}

/**
 * @param {string} url
 * @param {RequestInit} init
 * @param {OnBytes} onBytes
 * @returns {Promise<Answer>}
 */
function sendByXhr(url, init, onBytes) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    const abort = () => request.abort();
    request.open(init.method ?? 'POST', url);
    request.responseType = 'arraybuffer';
    new Headers(init.headers).forEach((value, name) => request.setRequestHeader(name, value));
    request.upload.onprogress = (event) => onBytes(event.loaded, event.total);
    request.onerror = () => reject(new TypeError('the connection failed'));
    request.onabort = () => reject(init.signal?.reason);
    request.onload = () =>
      resolve({ status: request.status, headers: headersOf(request), bytes: request.response });
    request.onloadend = () => init.signal?.removeEventListener('abort', abort);
    init.signal?.addEventListener('abort', abort, { once: true });
    request.send(/** @type {XMLHttpRequestBodyInit} */ (init.body));
  });
}

/** @param {XMLHttpRequest} request */
function headersOf(request) {
  const headers = new Headers();
  for (const line of request.getAllResponseHeaders().trim().split('\r\n')) {
    const colon = line.indexOf(':');
    if (colon > 0) headers.append(line.slice(0, colon), line.slice(colon + 1).trim());
  }
  return headers;
}
