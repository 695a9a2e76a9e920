// SPDX-License-Identifier: Apache-2.0
// What a request can end with, other than its answer.

/** The server's problem+json, or a substitute for an answer without one. */
export class ApiError extends Error {
  /** @param header gives the value of an answer's header, or null */
  constructor(status, problem, header) {
    super(problem.detail || problem.title || `HTTP ${status}`);
    this.status = status;
    this.code = problem.code || `HTTP ${status}`;
    this.line = problem.line;
    this.parameter = problem.parameter;
    this.requestId = problem.request_id || header('X-Request-Id');
    const seconds = Number(header('Retry-After'));
    this.retryAfterMs = seconds > 0 ? 1000 * seconds : null;
    // A proxy whose service is gone answers without a problem of ours.
    const isProxys = [502, 503, 504].includes(status) && !problem.code;
    this.isOutage = isProxys || this.code === 'draining';
  }
}

/** There was no answer. */
export class ConnectionError extends Error {
  constructor() {
    super('The server cannot be reached, or closed the connection.');
    this.code = 'no connection';
    this.isOutage = true;
  }
}

/** Whether it was the page itself that ended the request. */
export const isAbort = (error) => error.name === 'AbortError';

/** A file that the server would refuse after it was sent. */
export class TooLargeError extends Error {
  constructor(bytes, limit) {
    super(`The file has ${bytes} bytes; the server takes at most ${limit}.`);
    this.code = 'mesh_too_large';
    this.status = 413;
  }
}

/** What people look an error up by. The codes of the browser's own errors are numbers. */
export const errorName = (error) => (typeof error.code === 'string' ? error.code : error.name);

/** Where to look further: line, parameter, request id. */
export function errorDetails(error) {
  return [
    error.line && `line ${error.line}`,
    error.parameter && `parameter ${error.parameter}`,
    error.requestId && `request ${error.requestId}`,
  ].filter(Boolean).join(' · ');
}
