// SPDX-License-Identifier: Apache-2.0
// @ts-check
// Scans from one point: the pixels of a spherical image as points, or beams at given elevations.

/** @typedef {[number, number, number]} Vector */

/** @param {ArrayLike<number>} a @param {ArrayLike<number>} b @returns {Vector} */
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** @param {ArrayLike<number>} a @param {ArrayLike<number>} b */
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** @param {Vector} vector @param {string} what @returns {Vector} */
function unit(vector, what) {
  const length = Math.hypot(...vector);
  if (!(length > 0 && length < Infinity)) throw new RangeError(what);
  return [vector[0] / length, vector[1] / length, vector[2] / length];
}

/**
 * The hits among the pixels of an array of positions, whose misses are NaN.
 * @param {{data: Float64Array, shape: number[]}} image
 */
export function hitPixels({ data, shape: [height, width] }) {
  const pixels = new Uint32Array(width * height);
  let count = 0;
  for (let pixel = 0; pixel < pixels.length; ++pixel) {
    if (!Number.isNaN(data[pixel * 3])) pixels[count++] = pixel;
  }
  const points = new Float64Array(count * 3);
  for (let i = 0; i < count; ++i) points.set(data.subarray(pixels[i] * 3, pixels[i] * 3 + 3), i * 3);
  return { count, width, height, points, pixels: pixels.slice(0, count) };
}

/**
 * Rays as rows of 6: for each elevation, `width` azimuths at the middles of equal parts of hFovDeg.
 * The axes are those of the contract's spherical projection: f is the view without its component
 * along up, r = f x up.
 * @param {{eye: ArrayLike<number>, target: ArrayLike<number>, up: ArrayLike<number>,
 *   elevationsDeg: ArrayLike<number>, hFovDeg: number, width: number}} scan
 */
export function beamRays({ eye, target, up, elevationsDeg, hFovDeg, width }) {
  const u = unit([up[0], up[1], up[2]], 'up is 0, 0, 0 or not finite');
  const view = [target[0] - eye[0], target[1] - eye[1], target[2] - eye[2]];
  const along = dot(view, u);
  const f = unit(
    [view[0] - along * u[0], view[1] - along * u[1], view[2] - along * u[2]],
    'the view from eye to target is parallel to up, or not finite',
  );
  const r = cross(f, u);
  const rays = new Float64Array(elevationsDeg.length * width * 6);
  let at = 0;
  for (let beam = 0; beam < elevationsDeg.length; ++beam) {
    const elevation = (elevationsDeg[beam] * Math.PI) / 180;
    for (let column = 0; column < width; ++column) {
      const azimuth = (((column + 0.5) / width - 0.5) * hFovDeg * Math.PI) / 180;
      const [cosE, sinE] = [Math.cos(elevation), Math.sin(elevation)];
      const [toF, toR] = [cosE * Math.cos(azimuth), cosE * Math.sin(azimuth)];
      for (let axis = 0; axis < 3; ++axis) {
        rays[at + axis] = eye[axis];
        rays[at + 3 + axis] = toF * f[axis] + toR * r[axis] + sinE * u[axis];
      }
      at += 6;
    }
  }
  return rays;
}

/**
 * Only the beams that hit.
 * @param {{count: number, t: Float64Array, triangle: Int32Array, point: Float64Array}} hits
 * @param {number} width beams of one elevation
 */
export function hitBeams({ count, t, triangle, point }, width) {
  const rays = Uint32Array.from({ length: count }, (_, i) => i).filter((i) => triangle[i] >= 0);
  const points = new Float64Array(rays.length * 3);
  rays.forEach((ray, i) => points.set(point.subarray(ray * 3, ray * 3 + 3), i * 3));
  return {
    count: rays.length,
    points,
    ranges: Float64Array.from(rays, (ray) => t[ray]),
    triangles: Int32Array.from(rays, (ray) => triangle[ray]),
    beams: Uint32Array.from(rays, (ray) => Math.floor(ray / width)),
    columns: Uint32Array.from(rays, (ray) => ray % width),
  };
}
