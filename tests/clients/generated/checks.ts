// SPDX-License-Identifier: Apache-2.0
// Shared by the tests of generated clients.

export function check(holds: boolean, what: string) {
  if (!holds) throw new Error(what);
}

/** "640x480" of a PNG. */
export async function pngSize(png: Blob | undefined) {
  if (!png) return 'no picture';
  const view = new DataView(await png.arrayBuffer());
  return `${view.getUint32(16)}x${view.getUint32(20)}`;
}

/** Rays as rows of 6, as .npy. */
export function raysAsNpy(numbers: number[]) {
  const text = `{'descr': '<f8', 'fortran_order': False, 'shape': (${numbers.length / 6}, 6), }`;
  const magic = Uint8Array.from([0x93, ...Buffer.from('NUMPY'), 1, 0, 118, 0]);
  return new Blob([magic, text.padEnd(117), '\n', new Float64Array(numbers)]);
}
