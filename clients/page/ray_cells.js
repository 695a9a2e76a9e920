// SPDX-License-Identifier: Apache-2.0
// The cells of a tree that a ray passes through.

/**
 * Cells with the interval [from, to] in which the ray is in them, in the order of `from`. Cells
 * that it only touches are left out, unless they are flat.
 * @param cells as the contract has them
 * @param ray {origin, direction}; its interval is [0, infinity)
 */
export function cellsAlong(cells, { origin, direction }) {
  const found = [];
  for (const cell of cells) {
    const interval = intervalIn(cell, origin, direction);
    if (interval) found.push({ ...cell, ...interval });
  }
  return found.sort((a, b) => a.from - b.from || a.to - b.to);
}

/** The slab test; an axis that the ray does not move along only decides. */
function intervalIn({ min, max }, origin, direction) {
  let from = 0;
  let to = Infinity;
  let isFlat = false;
  for (let axis = 0; axis < 3; ++axis) {
    if (min[axis] === max[axis]) isFlat = true;
    if (direction[axis] === 0) {
      if (origin[axis] < min[axis] || origin[axis] > max[axis]) return null;
      continue;
    }
    const a = (min[axis] - origin[axis]) / direction[axis];
    const b = (max[axis] - origin[axis]) / direction[axis];
    from = Math.max(from, Math.min(a, b));
    to = Math.min(to, Math.max(a, b));
  }
  return from < to || (isFlat && from === to) ? { from, to } : null;
}

/**
 * The depth at which to ask for cells: the one that is shown, else the greatest at which there are
 * at most `most` cells, whatever the tree's shape.
 */
export function depthForRay(tree, shownDepth, most) {
  if (shownDepth !== null) return shownDepth;
  if (tree.leaves <= most) return Math.min(tree.max_depth, 255);
  return Math.min(tree.max_depth, Math.floor(Math.log2(most)));
}
