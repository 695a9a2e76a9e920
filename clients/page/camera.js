// SPDX-License-Identifier: Apache-2.0
// A camera that circles a target: moved by the mouse, sent in render requests. Right-handed,
// pictures have row 0 at the top, as in the service's contract.
import { add, cross, dot, length, normalize, scale, sub } from './vector.js';

const RADIANS = Math.PI / 180;
const STEEPEST = 89.9 * RADIANS; // at 90 degrees "up" would have no direction in the picture

const FOV_DEG = 40; // as in the contract, when a link does not say it
const MARGIN = 1.08; // of a framed mesh, so that it does not touch the picture's border

/** For each up axis: what is up, where the front is (azimuth 0), and what is to its right. */
export const FRAMES = {
  y: { up: [0, 1, 0], front: [0, 0, 1], right: [1, 0, 0] },
  z: { up: [0, 0, 1], front: [0, -1, 0], right: [1, 0, 0] },
};

/** Azimuth and elevation of the views, in degrees; names as in the contract. */
const VIEWS = {
  start: [30, 20],
  iso: [45, Math.atan(Math.SQRT1_2) / RADIANS],
  front: [0, 0],
  back: [180, 0],
  left: [-90, 0],
  right: [90, 0],
  top: [0, 90],
  bottom: [0, -90],
};

export class OrbitCamera {
  constructor() {
    this.upAxis = 'y';
    this.fovDeg = FOV_DEG;
    this.projection = 'perspective';
    this.frame([-1, -1, -1], [1, 1, 1]);
  }

  /** The mesh's box, which scales zooming and places the orthographic eye. */
  measure(min, max) {
    this.center = scale(add(min, max), 0.5);
    this.radius = length(sub(max, min)) / 2 || 1;
  }

  /** Shows the whole box from the side that `view` names, as near as it fits. */
  frame(min, max, aspect = 1, view = 'start') {
    this.measure(min, max);
    this.target = this.center;
    [this.azimuth, this.elevation] = VIEWS[view].map((degrees) => degrees * RADIANS);
    this.orbit(0, 0); // keeps the elevation within its bounds
    const { forward, right, up } = this.axes;
    const slope = Math.tan((this.fovDeg / 2) * RADIANS);
    const needed = corners(min, max).map((corner) => {
      const offset = sub(corner, this.center);
      const half = Math.max(Math.abs(dot(offset, up)), Math.abs(dot(offset, right)) / aspect);
      const nearer = this.projection === 'orthographic' ? 0 : dot(offset, forward);
      return half / slope - nearer;
    });
    this.distance = (Math.max(...needed) || this.radius) * MARGIN;
  }

  /** Unit vector from the target to the eye. */
  get direction() {
    const { up, front, right } = FRAMES[this.upAxis];
    const flat = add(scale(front, Math.cos(this.azimuth)), scale(right, Math.sin(this.azimuth)));
    return add(scale(flat, Math.cos(this.elevation)), scale(up, Math.sin(this.elevation)));
  }

  get up() {
    return FRAMES[this.upAxis].up;
  }

  get slope() {
    return Math.tan((this.fovDeg / 2) * RADIANS);
  }

  /** Height of the view at the target, in mesh units. */
  get viewHeight() {
    return 2 * this.distance * this.slope;
  }

  get eye() {
    // An orthographic eye stands outside the mesh however far one has zoomed in: nothing before it
    // is seen.
    const away =
      this.projection === 'orthographic'
        ? 2 * this.radius + length(sub(this.target, this.center))
        : this.distance;
    return add(this.target, scale(this.direction, away));
  }

  /** Unit vectors of the picture: forward, right, and up, which is against its rows. */
  get axes() {
    const forward = scale(this.direction, -1);
    const right = normalize(cross(forward, this.up));
    return { forward, right, up: cross(right, forward) };
  }

  /** Turns by angles in radians: positive moves the eye to its right and up. */
  orbit(azimuth, elevation) {
    this.azimuth = (this.azimuth + azimuth) % (2 * Math.PI);
    this.elevation = Math.max(-STEEPEST, Math.min(STEEPEST, this.elevation + elevation));
  }

  /** Moves eye and target by parts of the picture's height, to its right and up. */
  pan(right, up) {
    const axes = this.axes;
    const shift = add(scale(axes.right, right), scale(axes.up, up));
    this.target = add(this.target, scale(shift, this.viewHeight));
  }

  /**
   * Multiplies the distance by `factor`. What lies in the target's plane at `place`, in [0, 1] of
   * the picture, stays there.
   */
  zoom(factor, { x, y } = { x: 0.5, y: 0.5 }, aspect = 1) {
    const height = this.viewHeight;
    const distance = this.distance * factor;
    this.distance = Math.max(this.radius * 1e-4, Math.min(this.radius * 1e3, distance));
    const change = height - this.viewHeight;
    const axes = this.axes;
    const aside = add(scale(axes.right, (x - 0.5) * aspect), scale(axes.up, 0.5 - y));
    this.target = add(this.target, scale(aside, change));
  }

  /**
   * Moves the target along the view to the depth of `point`; the picture stays as it is. Zooming
   * then ends at that depth, and does not pass through a surface there.
   */
  focus(point) {
    const { forward } = this.axes;
    if (this.projection === 'orthographic') {
      this.target = add(this.target, scale(forward, dot(sub(point, this.target), forward)));
      return;
    }
    const { eye } = this;
    const depth = dot(sub(point, eye), forward);
    if (!(depth > this.radius * 1e-4)) return;
    this.target = add(eye, scale(forward, depth));
    this.distance = depth;
  }

  /** Makes `point` what the camera circles, and the middle of the picture. */
  pivot(point) {
    this.focus(point);
    this.target = point;
  }

  /** The ray through a point of the picture: x, y in [0, 1], y down; direction of unit length. */
  ray(x, y, aspect) {
    const { forward, right, up } = this.axes;
    const across = (2 * x - 1) * aspect;
    const upwards = 1 - 2 * y;
    if (this.projection === 'orthographic') {
      const half = this.viewHeight / 2;
      const offset = add(scale(right, across * half), scale(up, upwards * half));
      return { origin: add(this.eye, offset), direction: forward };
    }
    const aside = add(scale(right, across * this.slope), scale(up, upwards * this.slope));
    return { origin: this.eye, direction: normalize(add(forward, aside)) };
  }

  /**
   * A function from points of the mesh to [x, y, depth]: x, y in [0, 1] of the picture as for
   * ray(), depth along the view. Only points of positive depth are in the picture.
   */
  projector(aspect) {
    const { forward, right, up } = this.axes;
    const { eye, slope } = this;
    const orthographicHalf = this.projection === 'orthographic' ? this.viewHeight / 2 : null;
    return (point) => {
      const offset = sub(point, eye);
      const depth = dot(offset, forward);
      const half = orthographicHalf ?? depth * slope;
      return [
        (dot(offset, right) / (half * aspect) + 1) / 2,
        (1 - dot(offset, up) / half) / 2,
        depth,
      ];
    };
  }

  /**
   * How a picture of `seen` has to be moved to resemble this camera's: {x, y, zoom}, the place of
   * its middle and its scale. Null if no shift does it.
   */
  shiftFrom(seen, aspect) {
    if (seen.projection !== this.projection) return null;
    const [x, y, depth] = this.projector(aspect)(seen.target);
    if (!(depth > 0)) return null;
    const isParallel = this.projection === 'orthographic';
    const zoom = isParallel ? seen.viewHeight / this.viewHeight : seen.distance / depth;
    return { x, y, zoom };
  }

  /** The camera's part of a render request. */
  parameters() {
    // Ten digits of the distance, so that a mesh far from the origin turns smoothly too.
    const largest = Math.max(...this.target.map(Math.abs));
    const digits = Math.min(17, 10 + Math.max(0, Math.ceil(Math.log10(largest / this.distance))));
    const vectorText = (vector) => vector.map((x) => numberText(x, digits)).join(',');
    const parameters = {
      eye: vectorText(this.eye),
      target: vectorText(this.target),
      up: this.up.join(),
      projection: this.projection,
    };
    if (this.projection === 'orthographic') parameters.view_height = numberText(this.viewHeight);
    else parameters.fov_deg = numberText(this.fovDeg);
    return parameters;
  }

  /** Reads parameters(); only eye and target are required. False if they are invalid. */
  restore(parameters) {
    const eye = parseNumbers(parameters.eye, 3);
    const target = parseNumbers(parameters.target, 3);
    const up = parseNumbers(parameters.up ?? '0,1,0', 3);
    if (!eye || !target || !up || length(sub(eye, target)) === 0) return false;
    this.upAxis = Math.abs(up[2]) > Math.abs(up[1]) ? 'z' : 'y';
    const fovDeg = Number(parameters.fov_deg);
    this.fovDeg = fovDeg > 0 && fovDeg < 180 ? fovDeg : FOV_DEG;
    this.projection =
      parameters.projection === 'orthographic' ? 'orthographic' : 'perspective';
    const { up: axis, front, right } = FRAMES[this.upAxis];
    const direction = normalize(sub(eye, target));
    this.target = target;
    this.azimuth = Math.atan2(dot(direction, right), dot(direction, front));
    this.elevation = Math.asin(Math.max(-1, Math.min(1, dot(direction, axis))));
    this.orbit(0, 0);
    const height = Number(parameters.view_height);
    this.distance =
      this.projection === 'orthographic' && height > 0
        ? height / (2 * this.slope)
        : length(sub(eye, target));
    return true;
  }

  clone() {
    return Object.assign(new OrbitCamera(), this);
  }
}

/** Not all digits: URLs stay readable. */
export const numberText = (number, digits = 10) => String(Number(number.toPrecision(digits)));

/** `count` numbers between commas; null for any other text. */
export function parseNumbers(text, count) {
  const numbers = String(text).split(',').map(Number);
  return numbers.length === count && numbers.every(Number.isFinite) ? numbers : null;
}

export function corners(min, max) {
  return [0, 1, 2, 3, 4, 5, 6, 7].map((bits) =>
    min.map((low, axis) => (bits >> axis & 1 ? max[axis] : low)),
  );
}
