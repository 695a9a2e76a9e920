// SPDX-License-Identifier: Apache-2.0
// Meshes, random numbers, and brute force over all triangles in double: the oracle.

/** Mulberry32: the same numbers in every run. $KDRAY_SEED overrides the seed. */
export function makeRandom(seed = Number(process.env.KDRAY_SEED ?? 20240517)) {
  let state = seed >>> 0;
  return () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let x = Math.imul(state ^ (state >>> 15), 1 | state);
    x = (x + Math.imul(x ^ (x >>> 7), 61 | x)) ^ x;
    return ((x ^ (x >>> 14)) >>> 0) / 2 ** 32;
  };
}

/** A closed sphere of radius 1 from `rows` x `columns` quads; corners run counter-clockwise from outside. */
export function sphere(rows = 8, columns = 12) {
  const vertices = [[0, 0, 1]];
  for (let row = 1; row < rows; ++row) {
    for (let column = 0; column < columns; ++column) {
      const [theta, phi] = [(row / rows) * Math.PI, (column / columns) * 2 * Math.PI];
      vertices.push([Math.sin(theta) * Math.cos(phi), Math.sin(theta) * Math.sin(phi), Math.cos(theta)]);
    }
  }
  const last = vertices.push([0, 0, -1]) - 1;
  const at = (row, column) => 1 + (row - 1) * columns + (column % columns);
  const faces = [];
  for (let column = 0; column < columns; ++column) {
    faces.push([0, at(1, column), at(1, column + 1)]);
    for (let row = 1; row < rows - 1; ++row) {
      const [a, b] = [at(row, column), at(row, column + 1)];
      const [c, d] = [at(row + 1, column), at(row + 1, column + 1)];
      faces.push([a, c, d], [a, d, b]);
    }
    faces.push([at(rows - 1, column), last, at(rows - 1, column + 1)]);
  }
  return { vertices, faces };
}

export const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const plus = (a, b, t = 1) => [a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) =>
  [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

const corners = ({ vertices, faces }, face) => faces[face].map((index) => vertices[index]);

/** All hits of a ray, by t, then by triangle. Möller and Trumbore, 1997, in double. */
export function allHits(mesh, [ox, oy, oz, dx, dy, dz, tMin = 0, tMax = Infinity]) {
  const hits = [];
  const direction = [dx, dy, dz];
  for (let triangle = 0; triangle < mesh.faces.length; ++triangle) {
    const [a, b, c] = corners(mesh, triangle);
    const [ab, ac] = [minus(b, a), minus(c, a)];
    const p = cross(direction, ac);
    const determinant = dot(ab, p);
    if (determinant === 0) continue;
    const s = minus([ox, oy, oz], a);
    const u = dot(s, p) / determinant;
    const q = cross(s, ab);
    const v = dot(direction, q) / determinant;
    const t = dot(ac, q) / determinant;
    if (u >= 0 && v >= 0 && u + v <= 1 && t >= tMin && t <= tMax) {
      hits.push({ t, triangle, u, v, side: determinant > 0 ? 1 : -1 });
    }
  }
  return hits.sort((a, b) => a.t - b.t || a.triangle - b.triangle);
}

/** The distance from a point to the nearest of many points of the mesh's triangles, refined: slow and plain. */
export function distanceTo(mesh, point) {
  let best = Infinity;
  for (let face = 0; face < mesh.faces.length; ++face) {
    best = Math.min(best, distanceToTriangle(point, ...corners(mesh, face)));
  }
  return best;
}

/** The least distance over the plane's foot, if it is inside, and the three edges. */
function distanceToTriangle(p, a, b, c) {
  const [ab, ac, ap] = [minus(b, a), minus(c, a), minus(p, a)];
  const normal = cross(ab, ac);
  const squared = dot(normal, normal);
  const v = dot(cross(ap, ac), normal) / squared;
  const w = dot(cross(ab, ap), normal) / squared;
  if (v >= 0 && w >= 0 && v + w <= 1) return Math.abs(dot(ap, normal)) / Math.sqrt(squared);
  return Math.min(distanceToEdge(p, a, b), distanceToEdge(p, b, c), distanceToEdge(p, c, a));
}

function distanceToEdge(p, a, b) {
  const [ab, ap] = [minus(b, a), minus(p, a)];
  const t = Math.min(1, Math.max(0, dot(ap, ab) / dot(ab, ab)));
  return Math.hypot(...minus(p, plus(a, ab, t)));
}

/** Rays as rows of 6 from around the mesh to points near it; some miss. */
export function randomRays(count, random = makeRandom()) {
  const point = (size) => [0, 0, 0].map(() => (random() * 2 - 1) * size);
  return Array.from({ length: count }, () => {
    const origin = point(3);
    return [...origin, ...minus(point(1.2), origin)];
  });
}

export function randomPoints(count, size, random = makeRandom()) {
  return Array.from({ length: count }, () => [0, 0, 0].map(() => (random() * 2 - 1) * size));
}
