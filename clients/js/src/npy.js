// SPDX-License-Identifier: Apache-2.0
// @ts-check
// The .npy format as the service uses it: versions 1 to 3, C order, little-endian numbers, plain or
// packed structured elements.
// Source: numpy.lib.format, "Format Version 1.0" to "3.0".

const MAGIC = [0x93, 0x4e, 0x55, 0x4d, 0x50, 0x59]; // \x93NUMPY
const ALIGNMENT = 64; // of the data, as numpy writes it

if (new Uint8Array(new Uint16Array([1]).buffer)[0] !== 1) {
  throw new Error('kdray: this machine is big-endian; the client supports little-endian ones');
}

/** @typedef {Float32Array | Float64Array | Int32Array | Uint32Array | Int8Array | Uint8Array} Column */
/** @typedef {new (length: number) => Column} ColumnType */

/**
 * One number type: `make` is the array that its numbers are decoded into. The service's 8-byte
 * integers are row and triangle numbers and counts below 2^31, so their low halves suffice.
 * @type {Record<string, {bytes: number, make: any, view: any, viewBytes: number}>}
 */
const TYPES = {
  f4: { bytes: 4, make: Float32Array, view: Float32Array, viewBytes: 4 },
  f8: { bytes: 8, make: Float64Array, view: Float64Array, viewBytes: 8 },
  i4: { bytes: 4, make: Int32Array, view: Int32Array, viewBytes: 4 },
  i8: { bytes: 8, make: Int32Array, view: Int32Array, viewBytes: 4 },
  u4: { bytes: 4, make: Uint32Array, view: Uint32Array, viewBytes: 4 },
  u8: { bytes: 8, make: Uint32Array, view: Uint32Array, viewBytes: 4 },
  b1: { bytes: 1, make: Uint8Array, view: Uint8Array, viewBytes: 1 },
  i1: { bytes: 1, make: Int8Array, view: Int8Array, viewBytes: 1 },
  u1: { bytes: 1, make: Uint8Array, view: Uint8Array, viewBytes: 1 },
};

/**
 * A field of an element: `width` numbers from byte `offset` on.
 * @typedef {{name: string, type: string, offset: number, width: number}} Field
 */

/**
 * An array in the form of a .npy file. `start` is a multiple of 8.
 * @typedef {{buffer: ArrayBuffer, start: number, shape: number[], fields: Field[], structured: boolean, stride: number}} Npy
 */

/**
 * A .npy file with rows of `columns` numbers: a body for the service.
 * @param {Float32Array | Float64Array} numbers
 * @param {number} columns
 * @returns {Uint8Array<ArrayBuffer>}
 */
export function encodeRows(numbers, columns) {
  const type = numbers instanceof Float32Array ? '<f4' : '<f8';
  const rows = numbers.length / columns;
  const text = `{'descr': '${type}', 'fortran_order': False, 'shape': (${rows}, ${columns}), }`;
  const headerBytes = Math.ceil((10 + text.length + 1) / ALIGNMENT) * ALIGNMENT;
  const bytes = new Uint8Array(headerBytes + numbers.byteLength);
  bytes.fill(0x20, 0, headerBytes);
  bytes.set(MAGIC);
  bytes.set([1, 0, (headerBytes - 10) & 0xff, (headerBytes - 10) >> 8], 6);
  for (let i = 0; i < text.length; ++i) bytes[10 + i] = text.charCodeAt(i);
  bytes[headerBytes - 1] = 0x0a;
  bytes.set(new Uint8Array(numbers.buffer, numbers.byteOffset, numbers.byteLength), headerBytes);
  return bytes;
}

/**
 * Reads the header and checks the length. Throws an Error for bytes that are not such a file.
 * @param {ArrayBuffer} buffer
 * @returns {Npy}
 */
export function decode(buffer) {
  const bytes = new Uint8Array(buffer);
  if (bytes.length < 10 || MAGIC.some((byte, i) => bytes[i] !== byte)) {
    throw new Error('the answer is not a .npy array');
  }
  const view = new DataView(buffer);
  const long = bytes[6] >= 2;
  const textStart = long ? 12 : 10;
  let start = textStart + (long ? view.getUint32(8, true) : view.getUint16(8, true));
  const header = new TextDecoder().decode(bytes.subarray(textStart, start));
  const [, shapeText] = find(header, /'shape':\s*\(([^)]*)\)/);
  const shape = shapeText.split(',').filter((part) => part.trim()).map(Number);
  if (!/'fortran_order':\s*False/.test(header)) throw new Error('the array is not in C order');
  const { fields, structured } = fieldsOf(header);
  const last = fields[fields.length - 1];
  const stride = last.offset + last.width * TYPES[last.type].bytes;
  const count = shape.reduce((product, length) => product * length, 1);
  if (buffer.byteLength - start !== count * stride) {
    throw new Error(`the array has ${buffer.byteLength - start} bytes of ${count * stride}`);
  }
  if (start % 8) [buffer, start] = [buffer.slice(start), 0];
  return { buffer, start, shape, fields, structured, stride };
}

/** @param {string} header @returns {{fields: Field[], structured: boolean}} */
function fieldsOf(header) {
  const plain = /'descr':\s*'([^']*)'/.exec(header);
  if (plain) {
    return { fields: [{ name: '', type: typeOf(plain[1]), offset: 0, width: 1 }], structured: false };
  }
  const [, list] = find(header, /'descr':\s*\[(.*)\]/);
  const fields = [];
  let offset = 0;
  for (const found of list.matchAll(/\('(\w+)',\s*'([^']*)'(?:,\s*\((\d+),?\))?\)/g)) {
    const [name, type, width] = [found[1], typeOf(found[2]), Number(found[3] ?? 1)];
    fields.push({ name, type, offset, width });
    offset += width * TYPES[type].bytes;
  }
  if (!fields.length) throw new Error(`the array has no field: ${list}`);
  return { fields, structured: true };
}

/** @param {string} descr such as "<f4" */
function typeOf(descr) {
  const type = descr.slice(1);
  if (!'<|'.includes(descr[0]) || !(type in TYPES)) {
    throw new Error(`the array's elements have the type ${descr}, which the service does not use`);
  }
  return type;
}

/** @param {string} text @param {RegExp} pattern */
function find(text, pattern) {
  const found = pattern.exec(text);
  if (!found) throw new Error(`the header of the .npy array is not readable: ${text}`);
  return found;
}

/**
 * An empty column for `count` elements of a field.
 * @param {Field} field
 * @param {number} count
 * @returns {Column}
 */
export function makeColumn(field, count) {
  return new TYPES[field.type].make(count * field.width);
}

/**
 * Copies a field of all elements into `column`, from element `first` on.
 * @param {Npy} array
 * @param {Field} field
 * @param {Column} column
 * @param {number} first
 */
export function copyColumn(array, field, column, first) {
  const { buffer, start, stride } = array;
  const { view: View, viewBytes, bytes } = TYPES[field.type];
  const { offset, width } = field;
  if (stride === width * bytes && bytes === viewBytes) {
    column.set(new View(buffer, start), first * width);
    return;
  }
  const aligned = stride % viewBytes === 0 && offset % viewBytes === 0;
  if (!aligned) throw new Error(`the field ${field.name} of the array is not aligned`);
  const numbers = new View(buffer, start);
  const [step, skip] = [stride / viewBytes, bytes / viewBytes];
  let out = first * width;
  for (let row = offset / viewBytes; row < numbers.length; row += step) {
    for (let i = 0; i < width; ++i) column[out++] = numbers[row + i * skip];
  }
}

/**
 * An array without fields as one typed array.
 * @param {Npy} array
 * @returns {Column}
 */
export function plainArray(array) {
  const [field] = array.fields;
  if (array.structured) throw new Error('the answer is a structured array');
  const count = array.shape.reduce((product, length) => product * length, 1);
  const column = makeColumn(field, count);
  copyColumn(array, field, column, 0);
  return column;
}
