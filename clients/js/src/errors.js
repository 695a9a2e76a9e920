// SPDX-License-Identifier: Apache-2.0
// @ts-check
// The two ways in which a request fails. Invalid arguments are TypeError or RangeError, and an
// aborted signal throws its reason, as everywhere in JavaScript.

/** @param {ArrayBuffer} bytes @returns {any} An empty object for bytes that are not JSON. */
function parseJson(bytes) {
  try {
    return JSON.parse(new TextDecoder().decode(bytes)) ?? {};
  } catch {
    return {};
  }
}

/** The server refused the request; the fields are those of its problem+json. */
export class KdrayError extends Error {
  /**
   * @param {number} status
   * @param {any} problem
   * @param {string | null} requestId
   */
  constructor(status, problem, requestId) {
    const reason = problem.detail || problem.title || 'the answer gives no reason';
    const line = problem.line === undefined ? '' : ` (line ${problem.line})`;
    super(`${problem.code ?? `HTTP ${status}`}: ${reason}${line}`);
    this.name = 'KdrayError';
    this.status = status;
    /** @type {string | undefined} */
    this.code = problem.code;
    /** @type {string | undefined} */
    this.detail = problem.detail;
    /** @type {string | undefined} */
    this.parameter = problem.parameter;
    /** @type {number | undefined} */
    this.limit = problem.limit;
    /** @type {number | undefined} */
    this.actual = problem.actual;
    /** @type {number | undefined} */
    this.line = problem.line;
    /** @type {string | undefined} */
    this.requestId = problem.request_id ?? requestId ?? undefined;
  }

  /**
   * @param {{status: number, bytes: ArrayBuffer, headers: Headers}} answer
   * @returns {KdrayError}
   */
  static of({ status, bytes, headers }) {
    return new KdrayError(status, parseJson(bytes), headers.get('X-Request-Id'));
  }
}

/** There was no answer, or it broke off, in every try. */
export class ConnectionError extends Error {
  /** @param {string} url @param {unknown} cause @param {string | null} [requestId] */
  constructor(url, cause, requestId) {
    const reason = innermost(cause);
    super(`no answer from ${url}${reason && `: ${reason}`}`, { cause });
    this.name = 'ConnectionError';
    /** @type {string | undefined} Servers that the request reached have it in their logs. */
    this.requestId = requestId ?? undefined;
  }
}

/** fetch says only "fetch failed"; what failed is in its cause. @param {any} error */
function innermost(error) {
  while (error?.cause) error = error.cause;
  return error?.code ?? error?.message ?? '';
}
