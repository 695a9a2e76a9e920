// SPDX-License-Identifier: Apache-2.0
// Guesses which axis of a mesh points up: 'y' or 'z'. No format but glTF says it.

/** What most programs that write a format do. */
const HABITS = { glb: 'y', gltf: 'y', obj: 'y', ply: 'y', off: 'y', stl: 'z' };

const FLAT = 0.35; // of the smaller other side: terrain, plates
const ON_GROUND = 1e-3; // of the height

/** @param mesh the contract's description of a mesh */
export function guessUpAxis(mesh) {
  const habit = HABITS[mesh.format] ?? 'y';
  // The specification of glTF fixes y.
  if (!mesh.bounds || mesh.format === 'glb' || mesh.format === 'gltf') return habit;
  const { min, max } = mesh.bounds;
  const [x, y, z] = max.map((high, axis) => high - min[axis]);
  // What is flat lies on the ground.
  if (z < FLAT * Math.min(x, y)) return 'z';
  if (y < FLAT * Math.min(x, z)) return 'y';
  // What stands exactly on 0 in one of the two axes stands on it.
  const stands = (axis, height) => Math.abs(min[axis]) <= ON_GROUND * height && height > 0;
  if (stands(2, z) !== stands(1, y)) return stands(2, z) ? 'z' : 'y';
  return habit;
}
