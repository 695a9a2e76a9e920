// SPDX-License-Identifier: Apache-2.0
// @ts-check
// A server: uploads, its trees, its limits.
import { KdrayError } from './errors.js';
import { Transport } from './transport.js';
import { Tree } from './tree.js';
import { bytesOf, digestHeader, sending, sha256Of, sizeOf } from './upload.js';

const BUILD_WAIT_MS = 30_000;
const PROGRESS_WAIT_MS = 250; // between two looks at a build, for a bar that moves

export class Client {
  /**
   * @param {string | URL} url
   * @param {import('../kdray.js').ClientOptions} [options]
   */
  constructor(url = 'http://127.0.0.1:8080', options = {}) {
    /** @internal */
    this.transport = new Transport(url, options);
    /** @internal */
    this.parallel = options.parallel ?? 4;
    if (!(Number.isInteger(this.parallel) && this.parallel > 0)) {
      throw new RangeError(`parallel is ${this.parallel}; it must be an integer above 0`);
    }
    /** @internal @type {Promise<import('../kdray.js').Capabilities> | undefined} */
    this.known = undefined;
  }

  /** @returns {Promise<import('../kdray.js').Capabilities>} */
  capabilities() {
    // A failure is not kept: the next call asks again. No signal, because several calls share it.
    this.known ??= this.transport.json('GET', 'v1').catch((/** @type {unknown} */ error) => {
      this.known = undefined;
      throw error;
    });
    return this.known;
  }

  /**
   * @param {import('../kdray.js').MeshSource} mesh
   * @param {import('../kdray.js').UploadOptions} [options]
   * @returns {Promise<Tree>}
   */
  async upload(mesh, { build = 'auto', onProgress, signal } = {}) {
    signal?.throwIfAborted();
    const bytes = await bytesOf(mesh);
    const total = sizeOf(bytes);
    const sha256 = await sha256Of(bytes);
    let description = sha256 && (await this.find(`${sha256}-${build}`, signal));
    if (description) {
      onProgress?.({ phase: 'upload', fraction: 1, loaded: total, total });
    } else {
      const onBytes = onProgress && ((/** @type {number} */ loaded) =>
        onProgress({ phase: 'upload', fraction: total ? loaded / total : 1, loaded, total }));
      description = await this.transport.json('POST', 'v1/trees', {
        query: { build, wait_ms: onProgress ? 0 : BUILD_WAIT_MS },
        type: 'application/octet-stream',
        digest: digestHeader(sha256),
        signal,
        ...sending(bytes, onBytes),
      });
      onBytes?.(total);
    }
    return this.built(description, { onProgress, signal });
  }

  /**
   * The description of a tree that the server has. undefined if it has none, or if its build failed:
   * another upload tries again.
   * @internal
   * @param {string} id
   * @param {AbortSignal} [signal]
   */
  async find(id, signal) {
    try {
      return await this.transport.json('GET', `v1/trees/${encodeURIComponent(id)}`, { signal });
    } catch (error) {
      if (error instanceof KdrayError && (error.status === 404 || error.status === 422)) return undefined;
      throw error;
    }
  }

  /**
   * Waits for a build.
   * @internal
   * @param {import('../kdray.js').TreeDescription} description
   * @param {{onProgress?: (progress: import('../kdray.js').Progress) => void, signal?: AbortSignal}} options
   */
  async built(description, { onProgress, signal }) {
    onProgress?.({ phase: 'build', fraction: description.progress });
    while (description.state !== 'ready') {
      description = await this.transport.json('GET', `v1/trees/${description.id}`, {
        query: { wait_ms: onProgress ? PROGRESS_WAIT_MS : BUILD_WAIT_MS },
        signal,
      });
      onProgress?.({ phase: 'build', fraction: description.progress });
    }
    return new Tree(this, description);
  }

  /**
   * @param {string} sha256
   * @param {import('../kdray.js').Build} build
   * @param {Omit<import('../kdray.js').UploadOptions, 'build'>} [options]
   */
  async rebuild(sha256, build, { onProgress, signal } = {}) {
    const description = await this.transport.json('POST', 'v1/trees', {
      query: { mesh: sha256, build, wait_ms: onProgress ? 0 : BUILD_WAIT_MS },
      signal,
    });
    return this.built(description, { onProgress, signal });
  }

  /** @param {string} id @param {{signal?: AbortSignal}} [options] */
  async tree(id, { signal } = {}) {
    return new Tree(this, await this.transport.json('GET', `v1/trees/${encodeURIComponent(id)}`, { signal }));
  }

  /**
   * @param {{mesh?: string, signal?: AbortSignal}} [options]
   * @returns {AsyncGenerator<Tree, void, undefined>}
   */
  async *trees({ mesh, signal } = {}) {
    let after;
    do {
      const page = await this.transport.json('GET', 'v1/trees', { query: { mesh, after }, signal });
      for (const description of page.trees) yield new Tree(this, description);
      after = page.next ?? undefined;
    } while (after !== undefined);
  }
}
