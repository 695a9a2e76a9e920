// SPDX-License-Identifier: Apache-2.0
// @ts-check
// Rays and points as callers give them: a flat typed array, or a list of rows.

/**
 * Rows of `columns` numbers, one row after the other.
 * @typedef {{numbers: Float32Array | Float64Array, columns: number, count: number}} Rows
 */

/**
 * A Float32Array stays one, and is sent as <f4; everything else is sent as <f8.
 * @param {unknown} input a typed array of numbers, a flat list of numbers, or a list of rows
 * @param {number[]} widths the numbers of columns that a row may have; the first one is that of flat input
 * @param {string} what the name for error texts: rays, points
 * @param {number} [columns] of flat input
 * @returns {Rows}
 */
export function asRows(input, widths, what, columns = widths[0]) {
  if (!widths.includes(columns)) {
    throw new RangeError(`columns is ${columns}; ${what} have ${widths.join(' or ')}`);
  }
  if (ArrayBuffer.isView(input) && !(input instanceof DataView)) {
    const array = /** @type {any} */ (input);
    const isFloat = array instanceof Float32Array || array instanceof Float64Array;
    return flat(isFloat ? array : Float64Array.from(array, Number), columns, what);
  }
  if (!Array.isArray(input)) {
    throw new TypeError(`${what} must be a typed array or a list of rows`);
  }
  if (typeof input[0] === 'number') return flat(numbersOf(input, what), columns, what);
  return ofRows(input, widths, what);
}

/**
 * @param {Float32Array | Float64Array} numbers
 * @param {number} columns
 * @param {string} what
 */
function flat(numbers, columns, what) {
  const count = numbers.length / columns;
  if (!Number.isInteger(count)) {
    throw new RangeError(`${what} have ${numbers.length} numbers, which are no whole rows of ${columns}`);
  }
  return { numbers, columns, count };
}

/** @param {any[]} rows @param {number[]} widths @param {string} what @returns {Rows} */
function ofRows(rows, widths, what) {
  const columns = rows.length ? rows[0]?.length : widths[0];
  if (!widths.includes(columns)) {
    throw new RangeError(`row 0 of ${what} has ${columns} columns; allowed are ${widths.join(' or ')}`);
  }
  const numbers = new Float64Array(rows.length * columns);
  rows.forEach((row, i) => {
    if (row?.length !== columns) {
      throw new RangeError(`row ${i} of ${what} has ${row?.length} columns, row 0 has ${columns}`);
    }
    numbers.set(ArrayBuffer.isView(row) ? /** @type {any} */ (row) : numbersOf(row, what), i * columns);
  });
  return { numbers, columns, count: rows.length };
}

/** null and texts would silently become 0 or NaN. @param {ArrayLike<any>} list @param {string} what */
function numbersOf(list, what) {
  return Float64Array.from(list, (value) => {
    if (typeof value !== 'number') {
      throw new TypeError(`${what} contain ${JSON.stringify(value) ?? typeof value}, which is not a number`);
    }
    return value;
  });
}

/** @param {Rows} rows @param {number} first @param {number} end @returns {Rows} */
export function slice({ numbers, columns }, first, end) {
  const part = numbers.subarray(first * columns, end * columns);
  return { numbers: part, columns, count: end - first };
}

/** Both in the wider type of the two. @param {Rows} a @param {Rows} b @returns {[Rows, Rows]} */
export function sameType(a, b) {
  if (a.numbers.constructor === b.numbers.constructor) return [a, b];
  const wide = (/** @type {Rows} */ rows) => ({ ...rows, numbers: Float64Array.from(rows.numbers) });
  return [wide(a), wide(b)];
}
