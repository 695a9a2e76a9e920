// SPDX-License-Identifier: Apache-2.0
// The panel of one ray: its hit, what each precision answers, and its way through the tree's cells.
import { byId, element, fillFacts, fillTable, svg } from './dom.js';
import { announce } from './notices.js';
import { countText, pointText, shortNumber } from './text.js';

const STRIP_WIDTH = 280;
const STRIP_HEIGHT = 34;

// Of t: by so much the precisions that compute in float may place a hit before its cell.
const SLACK = 1e-6;

const SIDES = { 1: 'front', '-1': 'back' };

/** `hit` as the service answers it. */
export function showHit(hit, precision, tree) {
  byId('no-ray').hidden = true;
  byId('ray').hidden = false;
  for (const id of ['precisions', 'ray-cells']) byId(id).hidden = true;
  const hasGroups = Boolean(tree.mesh.groups?.length);
  const facts = hit ? hitFacts(hit, hasGroups) : [['Result', 'meets nothing']];
  fillFacts(byId('hit-facts'), [
    ...facts,
    ['Precision', precision],
    ['Crossings', later('crossings')],
  ]);
  announce(
    hit
      ? `The ray hits triangle ${countText(hit.triangle)} at distance ${shortNumber(hit.t)}`
      : 'The ray meets nothing',
  );
}

/** A value that follows. */
const later = (id) => element('span', { id, textContent: '…' });

function hitFacts(hit, hasGroups) {
  return [
    ['Triangle', countText(hit.triangle)],
    ['Side', SIDES[hit.side]],
    ['Group', hasGroups ? later('hit-group') : null],
    ['Distance t', shortNumber(hit.t, 9)],
    ['Point', pointText(hit.point, 6)],
    ['Normal', pointText(hit.normal)],
    ['u, v', `${shortNumber(hit.u)}, ${shortNumber(hit.v)}`],
  ];
}

/** The name of the group that the triangle belongs to; undefined if it belongs to none. */
export function showGroup(name) {
  byId('hit-group').textContent = name === undefined ? 'no group' : name || 'without a name';
}

/** How often the ray passes through the surface. */
export function showCrossings(number) {
  byId('crossings').textContent = countText(number);
}

/** @param answers {precision, hit} of each, hit null for a miss; compared with those of `exact` */
export function showPrecisions(answers) {
  const exact = answers.find(({ precision }) => precision === 'exact')?.hit;
  const mark = (differs, text) =>
    element('span', { className: differs ? 'warn' : '', textContent: text });
  const rows = answers.map(({ precision, hit }) => [
    precision,
    mark(hit?.triangle !== exact?.triangle, hit ? countText(hit.triangle) : 'miss'),
    hit ? String(Number(hit.t.toPrecision(12))) : '–',
    hit && exact && hit !== exact ? errorText(hit.t - exact.t) : '',
  ]);
  fillTable(byId('precision-table'), ['Precision', 'Triangle', 't', 'Error of t'], rows);
  byId('precisions').hidden = false;
}

const errorText = (difference) => (difference === 0 ? '0' : difference.toExponential(1));

/**
 * @param cells those on the ray's way, with the intervals in which it is in them
 * @param build of their tree
 */
export function showCells(cells, depth, build, hit) {
  const passed = cells.filter((cell) => isReached(cell, hit));
  const triangles = passed.reduce((sum, cell) => sum + cell.triangles, 0);
  byId('ray-cells').hidden = false;
  byId('ray-cells-words').textContent =
    `At depth ${depth} of ${build} the ray passes ${cellsText(passed.length)}` +
    (hit ? ` up to its hit, of ${countText(cells.length)} on its way.` : '.') +
    ` In them are ${countText(triangles)} triangles.`;
  byId('ray-cells-strip').replaceChildren(...(cells.length > 0 ? [strip(cells, hit)] : []));
}

const isReached = ({ from }, hit) => !hit || from <= hit.t * (1 + SLACK);

const cellsText = (number) => (number === 1 ? '1 cell' : `${countText(number)} cells`);

/** The ray from left to right: a bar for each cell, as high as its triangles, and the hit. */
function strip(cells, hit) {
  const start = cells[0].from;
  const end = Math.max(...cells.map(({ to }) => to));
  const x = (t) => (STRIP_WIDTH * (t - start)) / (end - start || 1);
  const most = Math.max(1, ...cells.map(({ triangles }) => triangles));
  const bars = cells.map((cell) => {
    const height = 2 + (STRIP_HEIGHT - 4) * Math.sqrt(cell.triangles / most);
    const left = x(cell.from);
    return svg(
      'rect',
      {
        class: isReached(cell, hit) ? '' : 'beyond',
        x: left,
        y: STRIP_HEIGHT - height,
        width: Math.max(0.5, x(cell.to) - left - 0.6),
        height,
      },
      svg('title', {}, cellTitle(cell)),
    );
  });
  const label = `The ray's way through ${cellsText(cells.length)}, from left to right`;
  const marks = hit
    ? [svg('line', { class: 'hit', x1: x(hit.t), x2: x(hit.t), y1: 0, y2: STRIP_HEIGHT })]
    : [];
  return svg(
    'svg',
    { viewBox: `0 0 ${STRIP_WIDTH} ${STRIP_HEIGHT}`, role: 'img', 'aria-label': label },
    ...bars,
    ...marks,
  );
}

function cellTitle({ depth, leaf, triangles, from, to }) {
  const kind = leaf ? 'leaf' : 'node';
  const interval = `t from ${shortNumber(from)} to ${shortNumber(to)}`;
  return `${kind} at depth ${depth}, ${countText(triangles)} triangles, ${interval}`;
}

export function clear() {
  byId('no-ray').hidden = false;
  byId('ray').hidden = true;
}
