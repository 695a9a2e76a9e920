// SPDX-License-Identifier: Apache-2.0
// The service's HTTP contract as functions. URLs are relative to the page, so that it also works
// where a proxy puts the service under a path of its own.
import { ApiError, ConnectionError, isAbort } from './errors.js';

const TOKEN_KEY = 'kdray-token';

export class Api {
  /**
   * @param askForToken asks the user for a token; called on 401
   * @param onLost called when there was no answer
   */
  constructor(askForToken, onLost) {
    this.base = new URL('.', document.baseURI);
    this.askForToken = askForToken;
    this.onLost = onLost;
    this.token = sessionStorage.getItem(TOKEN_KEY) || '';
  }

  url(path, query = {}) {
    const url = new URL(path, this.base);
    // Commas stay readable: the query is also shown to people, in the curl command.
    url.search = new URLSearchParams(query).toString().replaceAll('%2C', ',');
    return url;
  }

  headers() {
    return this.token ? { Authorization: `Bearer ${this.token}` } : {};
  }

  /** Repeats the request with a new token if the token was missing or invalid. */
  async fetch(path, { query, ...options } = {}) {
    for (;;) {
      const sent = this.token;
      const response = await this.send(this.url(path, query), options);
      if (response.ok) return response;
      const error = await errorOf(response);
      if (error.isOutage) this.onLost();
      if (error.status !== 401) throw error;
      await this.renewToken(sent);
    }
  }

  async send(url, options) {
    return this.answered(() =>
      fetch(url, { ...options, headers: { ...options.headers, ...this.headers() } }),
    );
  }

  /** What `work` gives; a ConnectionError if the network failed. */
  async answered(work) {
    try {
      return await work();
    } catch (error) {
      if (isAbort(error)) throw error;
      this.onLost();
      throw new ConnectionError();
    }
  }

  /** One dialog for all requests that got 401 at the same time. */
  async renewToken(refused) {
    if (this.token !== refused) return;
    this.asking ??= this.askForToken().finally(() => (this.asking = null));
    this.token = await this.asking;
    sessionStorage.setItem(TOKEN_KEY, this.token);
  }

  async json(path, options) {
    const response = await this.fetch(path, options);
    return this.answered(() => response.json());
  }

  info() {
    return this.json('v1');
  }

  trees(after) {
    return this.json('v1/trees', { query: after ? { after } : {} });
  }

  treesOfMesh(sha256, signal) {
    return this.json('v1/trees', { query: { mesh: sha256 }, signal });
  }

  tree(id, waitMs = 0, signal) {
    return this.json(treePath(id), { query: waitMs ? { wait_ms: waitMs } : {}, signal });
  }

  anotherBuild(sha256, build) {
    const query = { mesh: sha256, build, wait_ms: 100 };
    return this.json('v1/trees', { method: 'POST', query });
  }

  deleteTree(id) {
    return this.fetch(treePath(id), { method: 'DELETE' });
  }

  /** A picture's bytes with the headers of the answer. */
  async render(id, query, options) {
    const response = await this.fetch(`${treePath(id)}/render.png`, { query, ...options });
    const blob = await this.answered(() => response.blob());
    return { blob, headers: response.headers };
  }

  async meshFile(id) {
    const response = await this.fetch(`${treePath(id)}/mesh`);
    return this.answered(() => response.blob());
  }

  /** Boxes of the nodes at this depth, and of the leaves above it. */
  async cells(id, depth, signal) {
    return (await this.json(`${treePath(id)}/cells`, { query: { depth }, signal })).cells;
  }

  /** The hit of one ray, or null, with the precision that was used. */
  async closestHit(id, ray, query, signal) {
    const path = `${treePath(id)}/rays/closest`;
    const response = await this.fetch(path, rayRequest(ray, query, signal));
    const [hit] = (await this.answered(() => response.json())).results;
    return { hit, precision: response.headers.get('Kdray-Precision') };
  }

  async countHits(id, ray, signal) {
    return (await this.json(`${treePath(id)}/rays/count`, rayRequest(ray, {}, signal))).results[0];
  }

  measureTradeoff(id, signal) {
    const options = { method: 'POST', query: { wait_ms: 0 }, signal };
    return this.json(`${treePath(id)}/tradeoff`, options);
  }

  tradeoff(id, waitMs, signal) {
    return this.json(`${treePath(id)}/tradeoff`, { query: { wait_ms: waitMs }, signal });
  }

  forgetTradeoff(id) {
    return this.fetch(`${treePath(id)}/tradeoff`, { method: 'DELETE' });
  }

  /**
   * POST of a file. XMLHttpRequest, because fetch does not report the progress of an upload.
   * @param options.digest the SHA-256 in base64, if it is known: a proxy before several servers
   *     finds the mesh's server by it
   */
  async upload(file, build, options) {
    for (;;) {
      const sent = this.token;
      try {
        return await this.uploadOnce(file, build, options);
      } catch (error) {
        if (error instanceof ConnectionError) this.onLost();
        if (error.status !== 401) throw error;
        await this.renewToken(sent);
      }
    }
  }

  uploadOnce(file, build, { digest, onProgress, signal }) {
    return new Promise((resolve, reject) => {
      const request = new XMLHttpRequest();
      request.open('POST', this.url('v1/trees', { build, wait_ms: 0 }));
      for (const [name, value] of Object.entries(this.headers()))
        request.setRequestHeader(name, value);
      request.setRequestHeader('Content-Type', 'application/octet-stream');
      if (digest) request.setRequestHeader('Content-Digest', `sha-256=:${digest}:`);
      request.upload.onprogress = (event) => onProgress(event.loaded / event.total);
      request.onerror = () => reject(new ConnectionError());
      request.onabort = () => reject(new DOMException('The upload was stopped.', 'AbortError'));
      request.onload = () => {
        const body = parseJson(request.responseText);
        if (request.status < 300) resolve(body);
        else reject(new ApiError(request.status, body, (name) => request.getResponseHeader(name)));
      };
      signal.addEventListener('abort', () => request.abort());
      request.send(file);
    });
  }
}

export const treePath = (id) => `v1/trees/${id}`;

export const rayBody = ({ origin, direction }) =>
  JSON.stringify({ rays: [[...origin, ...direction]] });

const rayRequest = (ray, query, signal) => ({
  method: 'POST',
  query,
  signal,
  headers: { 'Content-Type': 'application/json' },
  body: rayBody(ray),
});

/** "queue;dur=0.1, trace;dur=23" as {queue: 0.1, trace: 23}, in milliseconds. */
export function serverTiming(headers) {
  const header = headers.get('Server-Timing') ?? '';
  const entries = header.split(',').map((entry) => entry.trim().split(';dur='));
  return Object.fromEntries(entries.map(([name, duration]) => [name, Number(duration)]));
}

async function errorOf(response) {
  const text = await response.text().catch(() => '');
  return new ApiError(response.status, parseJson(text), (name) => response.headers.get(name));
}

function parseJson(text) {
  try {
    return JSON.parse(text) ?? {};
  } catch {
    return {};
  }
}
