// SPDX-License-Identifier: Apache-2.0
// Lines over the picture: the ray that was shot, and the cells that it passes through. They are
// drawn by the page, with the camera of the picture below.
import { add, scale } from './vector.js';

// Pairs of corners of a box (camera.js), which differ in one bit.
const EDGES = [0, 1, 2, 3, 4, 5, 6, 7].flatMap((corner) =>
  [1, 2, 4].filter((bit) => !(corner & bit)).map((bit) => [corner, corner | bit]),
);

export class Overlay {
  /** @param marker element that is put where the ray hits */
  constructor(canvas, marker) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d');
    this.marker = marker;
    this.ray = null; // {origin, direction}
    this.point = null;
    this.cells = [];
    this.placement = null;
  }

  /** @param hit its point, or null */
  setRay(ray, point) {
    this.ray = ray;
    this.point = point;
    this.cells = [];
    this.draw();
  }

  /** Cells as ray_cells.js gives them. */
  setCells(cells) {
    this.cells = cells;
    this.draw();
  }

  /** Picture.placement of the picture below, and that picture's width over height. */
  follow(placement, aspect) {
    this.placement = placement;
    this.aspect = aspect;
    this.draw();
  }

  /** A function from points of the mesh to [x, y, depth], as OrbitCamera.projector. */
  projector() {
    const { camera, x, y, zoom } = this.placement;
    const project = camera.projector(this.aspect);
    return (point) => {
      const [across, down, depth] = project(point);
      return [x + (across - 0.5) * zoom, y + (down - 0.5) * zoom, depth];
    };
  }

  draw() {
    const { canvas, context } = this;
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * ratio);
    const height = Math.round(canvas.clientHeight * ratio);
    // Setting the size clears the canvas, but costs more.
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
    context.clearRect(0, 0, width, height);
    this.marker.hidden = true;
    if (!this.placement || !this.ray) return;
    this.nearest = this.placement.camera.radius * 1e-5;
    this.project = this.projector();
    if (this.point) this.placeMarker(this.project(this.point));
    const style = getComputedStyle(canvas);
    context.lineWidth = 1.2 * ratio;
    context.strokeStyle = style.getPropertyValue('--cell-line');
    context.beginPath();
    for (const { min, max } of this.cells) this.box(min, max);
    context.stroke();
    context.lineWidth = 2 * ratio;
    context.strokeStyle = style.getPropertyValue('--ray-line');
    context.beginPath();
    this.line(this.ray.origin, this.end());
    context.stroke();
  }

  /** Where the drawn ray ends: at its hit, or as far away as makes no difference. */
  end() {
    const { origin, direction } = this.ray;
    const { radius, distance } = this.placement.camera;
    const far = 8 * radius + distance;
    return this.point ?? add(origin, scale(direction, far));
  }

  box(min, max) {
    const corner = (bits) => min.map((low, axis) => (bits >> axis & 1 ? max[axis] : low));
    for (const [a, b] of EDGES) this.line(corner(a), corner(b));
  }

  /** Adds a line of the mesh's space to the path; what is behind the eye is cut off. */
  line(a, b) {
    const depths = [this.project(a)[2], this.project(b)[2]];
    if (Math.max(...depths) <= this.nearest) return;
    const cut = (point, depth, other, otherDepth) => {
      if (depth > this.nearest) return point;
      const part = (this.nearest - otherDepth) / (depth - otherDepth);
      return other.map((x, axis) => x + (point[axis] - x) * part * 0.999);
    };
    const ends = [cut(a, depths[0], b, depths[1]), cut(b, depths[1], a, depths[0])];
    const [[x0, y0], [x1, y1]] = ends.map((point) => this.project(point));
    this.context.moveTo(x0 * this.canvas.width, y0 * this.canvas.height);
    this.context.lineTo(x1 * this.canvas.width, y1 * this.canvas.height);
  }

  placeMarker([x, y, depth]) {
    this.marker.hidden = !(depth > 0);
    this.marker.style.left = `${100 * x}%`;
    this.marker.style.top = `${100 * y}%`;
  }
}
