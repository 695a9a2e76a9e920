// SPDX-License-Identifier: Apache-2.0
// The trade-off as a plot: rays a second to the right, inaccuracy upwards. A colour for each
// precision, a shape for each build.
import { element, svg } from './dom.js';
import { millionsText } from './text.js';

const WIDTH = 290;
const HEIGHT = 220;
const PLOT = { left: 38, right: 8, top: 8, bottom: 30 };
const ZERO_LANE = 26; // at the bottom: no logarithm shows a zero
const PRECISIONS = ['fast', 'watertight', 'double', 'exact'];
const SIZE = 4;

const rate = (part) => (part ? part.rate : null);

/** What may stand on the vertical axis: words and a value of each row; null if there is none. */
export const ACCURACIES = {
  error: { words: 'Error of t (99.9 %)', of: (row) => row.t_error.p999 },
  leaks: { words: 'Leaks', of: (row) => rate(row.leaks) },
  missed: { words: 'Missed hits', of: (row) => rate(row.missed_hits) },
  extra: { words: 'Extra hits', of: (row) => rate(row.extra_hits) },
};

const SHAPES = {
  circle: (x, y) => svg('circle', { cx: x, cy: y, r: SIZE }),
  square: (x, y) => path(x, y, 'M-3.6 -3.6H3.6V3.6H-3.6Z'),
  diamond: (x, y) => path(x, y, 'M0 -5L5 0L0 5L-5 0Z'),
  up: (x, y) => path(x, y, 'M0 -4.8L4.6 3.4H-4.6Z'),
  down: (x, y) => path(x, y, 'M0 4.8L4.6 -3.4H-4.6Z'),
  cross: (x, y) => path(x, y, 'M-4.6 -1.5H-1.5V-4.6H1.5V-1.5H4.6V1.5H1.5V4.6H-1.5V1.5H-4.6Z'),
};
const SHAPE_NAMES = Object.keys(SHAPES);

const path = (x, y, d) => svg('path', { d, transform: `translate(${x} ${y})` });

/** Fills a <figure>. */
export function showPlot(figure, results, accuracy) {
  const { words, of } = ACCURACIES[accuracy];
  const rows = results.filter((row) => of(row) !== null);
  const builds = [...new Set(results.map((row) => row.build))];
  const shapeOf = (build) => SHAPES[SHAPE_NAMES[builds.indexOf(build) % SHAPE_NAMES.length]];
  const across = logScale(rows.map((row) => row.aimed.rays_per_s), [PLOT.left, WIDTH - PLOT.right]);
  const bottom = HEIGHT - PLOT.bottom - ZERO_LANE;
  const upwards = logScale(rows.map(of).filter((value) => value > 0), [bottom, PLOT.top]);
  const y = (value) => (value > 0 ? upwards.at(value) : HEIGHT - PLOT.bottom - ZERO_LANE / 2);
  const marks = rows.map((row) => {
    const mark = shapeOf(row.build)(across.at(row.aimed.rays_per_s), y(of(row)));
    const speed = millionsText(row.aimed.rays_per_s);
    const title = `${row.build} ${row.precision}: ${speed} rays/s, ${of(row)}`;
    return svg('g', { class: `mark p-${row.precision}` }, svg('title', {}, title), mark);
  });
  const label = `Aimed rays a second against: ${words}. The table below has the numbers.`;
  const plot = svg(
    'svg',
    { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: 'img', 'aria-label': label },
    ...grid(across, upwards),
    ...marks,
  );
  const nothing = element('p', { className: 'quiet', textContent: 'Not known of this mesh.' });
  figure.replaceChildren(
    ...(rows.length > 0 ? [plot] : [nothing]),
    precisionKey(),
    buildKey(builds, shapeOf),
  );
}

function grid(across, upwards) {
  const right = WIDTH - PLOT.right;
  const floor = HEIGHT - PLOT.bottom;
  const text = (x, y, anchor, words) => svg('text', { x, y, 'text-anchor': anchor }, words);
  const line = (kind, x1, y1, x2, y2) => svg('line', { class: kind, x1, y1, x2, y2 });
  const columns = across.ticks.flatMap((value) => {
    const x = across.at(value);
    const label = text(x, floor + 12, 'middle', millionsText(value));
    return [line('grid', x, PLOT.top, x, floor), label];
  });
  const rows = upwards.ticks.flatMap((value) => {
    const y = upwards.at(value);
    const label = text(PLOT.left - 4, y + 3, 'end', value.toExponential(0));
    return [line('grid', PLOT.left, y, right, y), label];
  });
  return [
    ...columns,
    ...rows,
    line('axis', PLOT.left, floor, right, floor),
    text(PLOT.left - 4, floor - ZERO_LANE / 2 + 3, 'end', '0'),
    text((PLOT.left + right) / 2, floor + 26, 'middle', 'aimed rays a second'),
  ];
}

/** A logarithmic scale over all values, a little wider than they are. */
function logScale(values, [start, end]) {
  const given = values.length > 0 ? values : [1];
  let low = Math.log10(Math.min(...given)) - 0.15;
  let high = Math.log10(Math.max(...given)) + 0.15;
  if (high - low < 1) [low, high] = [(low + high) / 2 - 0.5, (low + high) / 2 + 0.5];
  const at = (value) => start + ((end - start) * (Math.log10(value) - low)) / (high - low);
  return { at, ticks: ticksBetween(low, high) };
}

/** Round values between two logarithms: powers of ten, with 2 and 5 between if there are few. */
function ticksBetween(low, high) {
  const digits = high - low < 2 ? [1, 2, 5] : [1];
  const every = Math.max(1, Math.ceil((high - low) / 6));
  const ticks = [];
  for (let power = Math.floor(low); power <= high; ++power) {
    if (power % every !== 0) continue;
    ticks.push(...digits.map((digit) => digit * 10 ** power));
  }
  return ticks.filter((value) => Math.log10(value) >= low && Math.log10(value) <= high);
}

function precisionKey() {
  const entries = PRECISIONS.map((name) =>
    element('li', {}, keyMark(`p-${name}`, SHAPES.circle), name),
  );
  return element('ul', { className: 'key', ariaLabel: 'Colours' }, ...entries);
}

function buildKey(builds, shapeOf) {
  const entries = builds.map((name) => element('li', {}, keyMark('p-any', shapeOf(name)), name));
  return element('ul', { className: 'key', ariaLabel: 'Shapes' }, ...entries);
}

const keyMark = (kind, shape) =>
  svg(
    'svg', { viewBox: '-6 -6 12 12', width: 11, height: 11, 'aria-hidden': 'true' },
    svg('g', { class: `mark ${kind}` }, shape(0, 0)),
  );
