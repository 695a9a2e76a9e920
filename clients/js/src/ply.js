// SPDX-License-Identifier: Apache-2.0
// @ts-check
// A mesh given as arrays, as the bytes of a binary PLY file. The same arrays give the same bytes,
// so they give the same tree id.
import { asRows } from './rows.js';

const FACE_BYTES = 1 + 3 * 4; // the number of corners, then their indices

/**
 * Float32Array vertices are stored as floats, all others as doubles.
 * @param {import('../kdray.js').NumberRows} vertices
 * @param {import('../kdray.js').NumberRows} faces
 * @returns {Uint8Array<ArrayBuffer>}
 */
export function plyOf(vertices, faces) {
  const positions = asRows(vertices, [3], 'vertices');
  const triangles = asRows(faces, [3], 'faces');
  for (let i = 0; i < triangles.numbers.length; ++i) {
    const index = triangles.numbers[i];
    if (!(Number.isInteger(index) && index >= 0 && index < positions.count)) {
      const place = `face ${Math.floor(i / 3)} has the vertex ${index}`;
      throw new RangeError(`${place}; allowed are 0 to ${positions.count - 1}`);
    }
  }
  const type = positions.numbers instanceof Float32Array ? 'float' : 'double';
  const header = new TextEncoder().encode(
    [
      'ply',
      'format binary_little_endian 1.0',
      `element vertex ${positions.count}`,
      ...['x', 'y', 'z'].map((axis) => `property ${type} ${axis}`),
      `element face ${triangles.count}`,
      'property list uchar uint vertex_indices',
      'end_header\n',
    ].join('\n'),
  );
  const { buffer, byteOffset, byteLength } = positions.numbers;
  const facesStart = header.length + byteLength;
  const bytes = new Uint8Array(facesStart + triangles.count * FACE_BYTES);
  bytes.set(header);
  bytes.set(new Uint8Array(buffer, byteOffset, byteLength), header.length);
  const view = new DataView(bytes.buffer);
  for (let face = 0; face < triangles.count; ++face) {
    const at = facesStart + face * FACE_BYTES;
    view.setUint8(at, 3);
    for (let corner = 0; corner < 3; ++corner) {
      view.setUint32(at + 1 + corner * 4, triangles.numbers[face * 3 + corner], true);
    }
  }
  return bytes;
}
