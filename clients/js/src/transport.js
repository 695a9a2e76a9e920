// SPDX-License-Identifier: Apache-2.0
// @ts-check
// Requests: the token, retries that are safe, cancellation, and the server's reasons as errors.
//
// By the contract every request may be repeated: queries change nothing, an upload is named by its
// content, and what DELETE forgets stays forgotten. So a request is sent again after a broken
// connection, and after an answer that only asks to wait.
import { ConnectionError, KdrayError } from './errors.js';

const FIRST_PAUSE_MS = 100;
const LONGEST_PAUSE_MS = 10_000;
const TRACEPARENT = /^00-(?!0{32})[0-9a-f]{32}-(?!0{16})[0-9a-f]{16}-[0-9a-f]{2}$/;

/** @typedef {{status: number, headers: Headers, bytes: ArrayBuffer}} Answer */
/**
 * `body` is a function where each try needs its own (a stream); it gets the number of the try, from
 * 0. `digest` is the value of Content-Digest. `send` replaces fetch.
 * @typedef {{
 *   query?: Record<string, unknown>,
 *   body?: BodyInit | null | ((attempt: number) => BodyInit),
 *   type?: string,
 *   accept?: string,
 *   digest?: string,
 *   signal?: AbortSignal,
 *   allow?: number[],
 *   send?: (url: string, init: RequestInit) => Promise<Answer>,
 * }} RequestOptions
 */

export class Transport {
  /**
   * @param {string | URL} url
   * @param {import('../kdray.js').ClientOptions} options
   */
  constructor(url, { token, retries = 4, fetch: ownFetch, traceparent } = {}) {
    this.base = new URL(url);
    this.base.pathname = this.base.pathname.replace(/\/*$/, '/'); // a proxy may add a path
    this.token = token;
    this.retries = retries;
    if (typeof traceparent === 'string' && !TRACEPARENT.test(traceparent)) {
      throw new TypeError(
        `the traceparent '${traceparent}' is invalid; it has the form 00-TRACE-SPAN-FLAGS with 32, ` +
          '16 and 2 lower-case hexadecimal digits',
      );
    }
    this.traceparent = traceparent;
    this.fetch = ownFetch ?? globalThis.fetch.bind(globalThis);
  }

  /** @param {string} path @param {Record<string, unknown>} [query] */
  url(path, query = {}) {
    const url = new URL(path, this.base);
    url.search = queryText(query);
    return url.href;
  }

  /**
   * The answer, if its status is 2xx or in `allow`; otherwise throws KdrayError, ConnectionError
   * or the signal's reason.
   * @param {string} method
   * @param {string} path relative to the server's root
   * @param {RequestOptions} [options]
   * @returns {Promise<Answer>}
   */
  async request(method, path, options = {}) {
    const { signal, allow = [], send = this.send.bind(this) } = options;
    const url = this.url(path, options.query);
    const headers = await this.headers(options);
    for (let attempt = 0; ; ++attempt) {
      signal?.throwIfAborted();
      const last = attempt >= this.retries;
      const body = typeof options.body === 'function' ? options.body(attempt) : options.body;
      /** @type {Answer} */
      let answer;
      const own = linkedTo(signal);
      try {
        answer = await send(url, initOf(method, headers, body, own.signal));
      } catch (error) {
        signal?.throwIfAborted();
        if (last) throw new ConnectionError(url, error, headers.get('X-Request-Id'));
        await pause(pauseMs(attempt), signal);
        continue;
      } finally {
        own.unlink();
      }
      const { status } = answer;
      if ((status >= 200 && status < 300) || allow.includes(status)) return answer;
      // Also a DELETE whose first answer was lost has reached its aim.
      if (method === 'DELETE' && status === 404 && attempt > 0) return answer;
      const problem = KdrayError.of(answer);
      if (last || !mayPass(problem)) throw problem;
      await pause(pauseMs(attempt, answer.headers.get('Retry-After')), signal);
    }
  }

  /** @param {string} method @param {string} path @param {RequestOptions} [options] @returns {Promise<any>} */
  async json(method, path, options) {
    const { bytes } = await this.request(method, path, { accept: 'application/json', ...options });
    try {
      return JSON.parse(new TextDecoder().decode(bytes));
    } catch (error) {
      throw new Error(`the answer of ${this.url(path)} is not JSON; is this kdrayd?`, { cause: error });
    }
  }

  /** Of all repetitions of a request: its id stays. @param {RequestOptions} options */
  async headers({ type, accept, digest }) {
    const token = typeof this.token === 'function' ? await this.token() : this.token;
    const headers = new Headers();
    if (type) headers.set('Content-Type', type);
    if (accept) headers.set('Accept', accept);
    if (digest) headers.set('Content-Digest', digest);
    if (token) headers.set('Authorization', `Bearer ${token}`);
    headers.set('X-Request-Id', newRequestId());
    const trace = typeof this.traceparent === 'function' ? this.traceparent() : this.traceparent;
    if (trace && TRACEPARENT.test(trace)) headers.set('traceparent', trace); // tracing fails nothing
    return headers;
  }

  /** With the whole body, so that a break in it counts as a broken connection. @param {string} url @param {RequestInit} init @returns {Promise<Answer>} */
  async send(url, init) {
    const response = await this.fetch(url, init);
    return { status: response.status, headers: response.headers, bytes: await response.arrayBuffer() };
  }
}

/** crypto.randomUUID is missing in pages without TLS, and Math.random is enough for a log. */
function newRequestId() {
  const digits = () => Math.floor(Math.random() * 2 ** 24).toString(16).padStart(6, '0');
  return `kdray-${digits()}${digits()}`;
}

/**
 * @param {string} method
 * @param {Headers} headers
 * @param {BodyInit | null | undefined} body
 * @param {AbortSignal | undefined} signal
 */
function initOf(method, headers, body, signal) {
  /** @type {RequestInit & {duplex?: 'half'}} */
  const init = { method, headers, body, signal };
  if (body instanceof ReadableStream) init.duplex = 'half'; // what fetch requires of streams
  return init;
}

/**
 * A signal for one request. fetch in Node 18 leaves its listeners on a signal, which would gather on
 * one that many requests share.
 * @param {AbortSignal} [signal]
 */
function linkedTo(signal) {
  const own = new AbortController();
  const abort = () => own.abort(signal?.reason);
  if (signal?.aborted) abort();
  signal?.addEventListener('abort', abort, { once: true });
  return { signal: own.signal, unlink: () => signal?.removeEventListener('abort', abort) };
}

/**
 * Whether the same request may succeed later. deadline_exceeded is left to the caller: another try
 * would take as long.
 * @param {KdrayError} problem
 */
function mayPass({ status, code }) {
  return status === 503 || code === 'tree_building' || status === 429 || status === 502;
}

/** @param {number} attempt @param {string | null} [retryAfter] in seconds */
function pauseMs(attempt, retryAfter) {
  const growing = FIRST_PAUSE_MS * 2 ** attempt * (0.5 + Math.random() / 2);
  const asked = Number(retryAfter ?? 0) * 1000 || 0; // a date, from a proxy, counts as nothing
  return Math.min(Math.max(growing, asked), LONGEST_PAUSE_MS);
}

/**
 * Throws the signal's reason when it is aborted meanwhile.
 * @param {number} milliseconds
 * @param {AbortSignal} [signal]
 * @returns {Promise<void>}
 */
export function pause(milliseconds, signal) {
  return new Promise((resolve, reject) => {
    const abort = () => {
      clearTimeout(timer);
      reject(signal?.reason);
    };
    const timer = setTimeout(() => {
      signal?.removeEventListener('abort', abort);
      resolve();
    }, milliseconds);
    if (signal?.aborted) abort();
    else signal?.addEventListener('abort', abort, { once: true });
  });
}

/**
 * What `promise` gives; throws the signal's reason if it is aborted before. For work that several
 * callers share, which no single one may end.
 * @template Result
 * @param {Promise<Result>} promise
 * @param {AbortSignal} [signal]
 * @returns {Promise<Result>}
 */
export async function unlessAborted(promise, signal) {
  const own = linkedTo(signal);
  const aborted = new Promise((_, reject) => {
    const abort = () => reject(signal?.reason);
    if (own.signal.aborted) abort();
    else own.signal.addEventListener('abort', abort, { once: true });
  });
  try {
    return await /** @type {Promise<Result>} */ (Promise.race([promise, aborted]));
  } finally {
    own.unlink();
  }
}

/**
 * Options of JavaScript as fields of the contract: fovDeg is fov_deg, and absent values are left out.
 * @param {Record<string, unknown>} options
 * @returns {Record<string, unknown>}
 */
export function wireFields(options) {
  return Object.fromEntries(
    Object.entries(options)
      .filter(([, value]) => value !== undefined)
      .map(([name, value]) => [wireName(name), ArrayBuffer.isView(value) ? listOf(value) : value]),
  );
}

/** @param {string} name */
export const wireName = (name) => name.replace(/[A-Z]/g, (letter) => `_${letter.toLowerCase()}`);

/** JSON.stringify makes an object of a typed array. @param {any} view @returns {number[]} */
const listOf = (view) => Array.from(view);

/** @param {Record<string, unknown>} query */
function queryText(query) {
  return Object.entries(query)
    .filter(([, value]) => value !== undefined)
    .map(([name, value]) => `${name}=${encodeURIComponent(valueText(value)).replaceAll('%2C', ',')}`)
    .join('&');
}

/** Lists of objects (lights) are JSON text, other lists have commas. @param {unknown} value @returns {string} */
function valueText(value) {
  if (Array.isArray(value)) {
    const isPlain = value.every((element) => typeof element !== 'object');
    return isPlain && value.length ? value.map(valueText).join(',') : JSON.stringify(value);
  }
  if (value === Infinity) return 'inf';
  if (value === -Infinity) return '-inf';
  return String(value);
}
