// SPDX-License-Identifier: Apache-2.0
// @ts-check
// Many rows as several requests in parallel, their answers in the order of the rows. Answers do not
// depend on how rays are split, so the result is that of one request.

const MOST_ROWS = 1 << 18; // of a request: enough to fill the server, and some 6 MB of rays

/**
 * The parts [first, end) of `count` rows, of nearly equal size; one empty part for no rows, so that
 * the server still checks the options and names the types.
 * @param {number} count
 * @param {number} mostRows of a part
 * @returns {{first: number, end: number}[]}
 */
export function partsOf(count, mostRows) {
  const parts = Math.max(1, Math.ceil(count / mostRows));
  return Array.from({ length: parts }, (_, i) => ({
    first: Math.floor((count * i) / parts),
    end: Math.floor((count * (i + 1)) / parts),
  }));
}

/**
 * @param {{max_rays: number}} limits of the server
 * @param {number | undefined} wanted
 */
export function rowsOfARequest(limits, wanted = MOST_ROWS) {
  if (!(Number.isInteger(wanted) && wanted > 0)) {
    throw new RangeError(`batchRows is ${wanted}; it must be an integer above 0`);
  }
  return Math.min(wanted, Math.max(1, limits.max_rays));
}

/**
 * Runs `task` for every element, at most `parallel` at a time. Returns the results in the order of
 * the elements. The first failure aborts the signal of the others, and is thrown when they have ended.
 * @template Element, Result
 * @param {Element[]} elements
 * @param {number} parallel
 * @param {AbortSignal | undefined} signal
 * @param {(element: Element, signal: AbortSignal) => Promise<Result>} task
 * @returns {Promise<Result[]>}
 */
export async function inParallel(elements, parallel, signal, task) {
  signal?.throwIfAborted();
  const stop = new AbortController();
  const abort = () => stop.abort(signal?.reason);
  signal?.addEventListener('abort', abort, { once: true });
  /** @type {Result[]} */
  const results = new Array(elements.length);
  /** @type {{error: unknown} | undefined} */
  let failure;
  let next = 0;
  const work = async () => {
    while (next < elements.length && !failure) {
      const index = next++;
      try {
        results[index] = await task(elements[index], stop.signal);
      } catch (error) {
        failure ??= { error };
        stop.abort(error);
      }
    }
  };
  try {
    await Promise.all(Array.from({ length: Math.min(parallel, elements.length) }, work));
  } finally {
    signal?.removeEventListener('abort', abort);
  }
  if (failure) throw failure.error;
  return results;
}
