// SPDX-License-Identifier: Apache-2.0
// Shoots a ray and finds out what there is to know of it: its hit at once, then the answers of
// every precision, the crossings, the group, and the cells on its way.
import { isAbort } from './errors.js';
import { cellsAlong, depthForRay } from './ray_cells.js';

const FIELDS = 't,triangle,u,v,normal,point,side';
const PRECISION_FIELDS = 't,triangle';
const MOST_CELLS = 2048; // some hundred kilobytes of JSON

export class Inspector {
  /**
   * @param panel shows what is found (ray_panel.js)
   * @param overlay draws ray and cells (overlay.js)
   * @param onError called with what a later request threw
   */
  constructor(api, { panel, overlay, onError }) {
    this.api = api;
    this.panel = panel;
    this.overlay = overlay;
    this.onError = onError;
    this.precisions = []; // names of those to compare
    this.shot = null; // {tree, ray, query, hit, depth of its cells}: the last one
    this.cellsOf = new Map(); // by tree and depth
  }

  /**
   * Answers the hit, or null; the rest follows by itself. A later call cancels an earlier one.
   * @param tree description
   * @param query {precision} or {}
   * @param cellsDepth of the cells in the picture, or null
   */
  async shoot(tree, ray, query, cellsDepth) {
    this.stop();
    this.abort = new AbortController();
    const { signal } = this.abort;
    const fullQuery = { fields: FIELDS, ...query };
    const { hit, precision } = await this.api.closestHit(tree.id, ray, fullQuery, signal);
    this.shot = { tree, ray, query: fullQuery, hit };
    this.overlay.setRay(ray, hit?.point ?? null);
    this.panel.showHit(hit, precision, tree);
    this.followUp(tree, ray, query, hit, cellsDepth, signal);
    return hit;
  }

  followUp(tree, ray, query, hit, cellsDepth, signal) {
    const parts = [
      this.compare(tree, ray, signal),
      this.findGroup(tree, ray, query, hit, signal),
      this.api.countHits(tree.id, ray, signal).then((number) => this.panel.showCrossings(number)),
      this.passCells(tree, ray, hit, cellsDepth, signal),
    ];
    for (const part of parts) {
      part.catch((error) => {
        if (!isAbort(error)) this.onError(error);
      });
    }
  }

  /** Not with the hit: at the first request of a group the server reads the mesh's file again. */
  async findGroup(tree, ray, query, hit, signal) {
    if (!hit || !tree.mesh.groups?.length) return;
    const answer = await this.api.closestHit(tree.id, ray, { ...query, fields: 'group' }, signal);
    this.panel.showGroup(tree.mesh.groups[answer.hit.group]);
  }

  async compare(tree, ray, signal) {
    const answers = await Promise.all(
      this.precisions.map((precision) =>
        this.api.closestHit(tree.id, ray, { precision, fields: PRECISION_FIELDS }, signal),
      ),
    );
    this.panel.showPrecisions(
      this.precisions.map((precision, i) => ({ precision, hit: answers[i].hit })),
    );
  }

  /** Finds the ray's cells anew, after the depth in the picture has changed. */
  async passCells(tree, ray, hit, cellsDepth, signal = this.abort.signal) {
    const depth = depthForRay(tree.tree, cellsDepth, MOST_CELLS);
    if (depth === this.shot.depth) return;
    this.shot.depth = depth;
    const cells = cellsAlong(await this.cells(tree.id, depth, signal), ray);
    if (signal.aborted) return;
    this.panel.showCells(cells, depth, tree.tree.build, hit);
    this.overlay.setCells(cells);
  }

  async cells(id, depth, signal) {
    const key = `${id} ${depth}`;
    if (!this.cellsOf.has(key)) {
      const cells = await this.api.cells(id, depth, signal);
      if (this.cellsOf.size >= 4) this.cellsOf.delete(this.cellsOf.keys().next().value);
      this.cellsOf.set(key, cells);
    }
    return this.cellsOf.get(key);
  }

  async changeDepth(cellsDepth) {
    if (!this.shot) return;
    const { tree, ray, hit } = this.shot;
    await this.passCells(tree, ray, hit, cellsDepth);
  }

  /** Whether the last ray was shot so. */
  hasShot(tree, query) {
    return this.shot?.tree.id === tree.id && this.shot.query.precision === query.precision;
  }

  stop() {
    this.abort?.abort();
  }

  clear() {
    this.stop();
    this.shot = null;
    this.overlay.setRay(null, null);
    this.panel.clear();
  }
}
