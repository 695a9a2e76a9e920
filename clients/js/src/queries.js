// SPDX-License-Identifier: Apache-2.0
// @ts-check
// Batches of rows to one endpoint, and their answers as columns.
import { inParallel, partsOf, rowsOfARequest } from './batches.js';
import { copyColumn, decode, encodeRows, makeColumn, plainArray } from './npy.js';
import { sameType, slice } from './rows.js';
import { unlessAborted, wireFields, wireName } from './transport.js';

/** @typedef {import('./client.js').Client} Client */
/** @typedef {import('./rows.js').Rows} Rows */
/** @typedef {import('./npy.js').Npy} Npy */
/** @typedef {import('./npy.js').Column} Column */

/** What the headers say of a whole batch. @typedef {{precision: any, invalid: number, offset?: number}} Report */
/** @typedef {{array: Npy, headers: Headers, first: number}} Part */

const NPY = 'application/x-npy';

/** Options of the client, which the server does not know. @param {Record<string, any>} options */
function split({ signal, batchRows, columns, ...fields }) {
  if (fields.fields !== undefined) fields.fields = namesOf(fields.fields).map(wireName);
  return { signal, batchRows, query: wireFields(fields) };
}

/** A list, or names with commas between them, as in the contract. @param {string[] | string} fields @returns {string[]} */
const namesOf = (fields) => (typeof fields === 'string' ? fields.split(',') : fields);

/**
 * @param {Client} client
 * @param {string} path
 * @param {Record<string, unknown>} query
 * @param {Uint8Array<ArrayBuffer>} body
 * @param {AbortSignal} signal
 */
async function ask(client, path, query, body, signal) {
  const options = { query, body, type: NPY, accept: NPY, signal };
  const { bytes, headers } = await client.transport.request('POST', path, options);
  return { array: decode(bytes), headers };
}

/**
 * Sends the rows, in parts, and hands each part's answer to `take` as it arrives.
 * @template Result
 * @param {Client} client
 * @param {string} path
 * @param {Rows} rows
 * @param {Record<string, any>} options
 * @param {(part: Part) => Result} take
 * @param {boolean} [perRow] whether the answer has one element per row
 * @returns {Promise<{results: Result[], report: Report, truncated: number}>}
 */
async function batch(client, path, rows, options, take, perRow = true) {
  const { signal, batchRows, query } = split(options);
  const { limits } = await unlessAborted(client.capabilities(), signal);
  const parts = partsOf(rows.count, rowsOfARequest(limits, batchRows));
  const answers = await inParallel(parts, client.parallel, signal, async ({ first, end }, stop) => {
    const part = slice(rows, first, end);
    const body = encodeRows(part.numbers, part.columns);
    const { array, headers } = await ask(client, path, query, body, stop);
    expectRows(array, part.count, perRow);
    return { result: take({ array, headers, first }), headers };
  });
  const headers = answers.map((answer) => answer.headers);
  return {
    results: answers.map((answer) => answer.result),
    report: reportOf(headers),
    truncated: sum(headers, 'Kdray-Truncated'),
  };
}

/** An answer of another length would shift all rows after it. @param {Npy} array @param {number} count @param {boolean} perRow */
function expectRows({ shape }, count, perRow) {
  if (perRow && shape[0] !== count) throw new Error(`the answer has ${shape[0]} rows for ${count}`);
}

/** @param {Headers[]} headers @param {string} name */
const sum = (headers, name) =>
  headers.reduce((total, one) => total + Number(one.get(name) ?? 0), 0);

/** @param {Headers[]} headers @returns {Report} */
function reportOf(headers) {
  const offset = headers[0].get('Kdray-Offset');
  return {
    precision: headers[0].get('Kdray-Precision'),
    invalid: sum(headers, 'Kdray-Invalid'),
    ...(offset === null ? {} : { offset: Number(offset) }),
  };
}

/**
 * One value per row.
 * @param {Client} client
 * @param {string} path
 * @param {Rows} rows
 * @param {Record<string, any>} options
 */
export async function valuesOf(client, path, rows, options) {
  /** @type {Column | undefined} */
  let values;
  const { report } = await batch(client, path, rows, options, ({ array, first }) => {
    values ??= makeColumn(array.fields[0], rows.count);
    copyColumn(array, array.fields[0], values, first);
  });
  return { count: rows.count, values: /** @type {any} */ (values), ...report };
}

/**
 * One element of several fields per row, as a column for each field.
 * @param {Client} client
 * @param {string} path
 * @param {Rows} rows
 * @param {Record<string, any>} options
 * @param {string[]} defaults the fields that the server answers without the option
 */
export async function columnsOf(client, path, rows, options, defaults) {
  const names = namesOf(options.fields ?? defaults);
  /** @type {Record<string, Column>} */
  const columns = {};
  const { report } = await batch(client, path, rows, options, ({ array, first }) => {
    fieldsOf(array, names).forEach((field, i) => {
      columns[names[i]] ??= makeColumn(field, rows.count);
      copyColumn(array, field, columns[names[i]], first);
    });
  });
  return { count: rows.count, ...report, ...columns };
}

/**
 * The fields of an answer. A single field makes a plain array, whose vectors are its last dimension.
 * @param {Npy} array
 * @param {string[]} names
 */
function fieldsOf(array, names) {
  if (array.structured) return array.fields;
  const width = array.shape[1] ?? 1;
  array.stride *= width;
  return [{ ...array.fields[0], name: names[0], width }];
}

/**
 * All hits as columns, with the column `ray` of row numbers.
 * @param {Client} client
 * @param {string} path
 * @param {Rows} rows
 * @param {Record<string, any>} options
 * @param {string[]} defaults
 */
export async function hitsOf(client, path, rows, options, defaults) {
  const names = ['ray', ...namesOf(options.fields ?? defaults)];
  const { results, report, truncated } = await batch(client, path, rows, options, (part) => part, false);
  const count = results.reduce((total, { array }) => total + array.shape[0], 0);
  /** @type {Record<string, Column>} */
  const columns = {};
  names.forEach((name, i) => {
    columns[name] = makeColumn(results[0].array.fields[i], count);
    let at = 0;
    for (const { array } of results) {
      copyColumn(array, array.fields[i], columns[name], at);
      at += array.shape[0];
    }
  });
  let at = 0;
  for (const { array, first } of results) {
    for (const end = at + array.shape[0]; at < end; ++at) columns.ray[at] += first;
  }
  return { count, rays: rows.count, truncated, ...report, ...columns };
}

/**
 * The pairs of two sets as a matrix of bytes, a row for each point of the first set.
 * @param {Client} client
 * @param {string} path
 * @param {Rows} fromRows
 * @param {Rows} toRows
 * @param {Record<string, any>} options
 */
export async function pairsOf(client, path, fromRows, toRows, options) {
  const [from, to] = sameType(fromRows, toRows);
  const { signal, batchRows, query } = split(options);
  const { limits } = await unlessAborted(client.capabilities(), signal);
  const most = rowsOfARequest(limits, batchRows);
  const across = partsOf(to.count, most);
  const widest = Math.max(1, ...across.map(({ first, end }) => end - first));
  const down = partsOf(from.count, Math.max(1, Math.floor(most / widest)));
  const tiles = down.flatMap((rows) => across.map((columns) => ({ rows, columns })));
  const visible = new Uint8Array(from.count * to.count);
  const headers = await inParallel(tiles, client.parallel, signal, async ({ rows, columns }, stop) => {
    const [a, b] = [slice(from, rows.first, rows.end), slice(to, columns.first, columns.end)];
    const body = encodeRows(joined(a.numbers, b.numbers), 3);
    const answer = await ask(client, path, { ...query, from_count: a.count }, body, stop);
    const bytes = plainArray(answer.array);
    for (let row = 0; row < a.count; ++row) {
      const part = bytes.subarray(row * b.count, (row + 1) * b.count);
      visible.set(part, (rows.first + row) * to.count + columns.first);
    }
    return answer.headers;
  });
  // A point is in many parts, so the counts of the parts do not add up.
  const invalid = invalidPoints(from, false) + invalidPoints(to, query.to_directions === true);
  return { from: from.count, to: to.count, visible, ...reportOf(headers), invalid };
}

/** @param {Float32Array | Float64Array} a @param {Float32Array | Float64Array} b of the same type */
function joined(a, b) {
  const both = new (/** @type {any} */ (a.constructor))(a.length + b.length);
  both.set(a);
  both.set(b, a.length);
  return both;
}

/** @param {Rows} points @param {boolean} areDirections */
function invalidPoints({ numbers, count }, areDirections) {
  let invalid = 0;
  for (let i = 0; i < count; ++i) {
    const point = numbers.subarray(i * 3, i * 3 + 3);
    const isInvalid = !point.every(Number.isFinite) || (areDirections && !point.some(Boolean));
    if (isInvalid) ++invalid;
  }
  return invalid;
}
