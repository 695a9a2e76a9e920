// SPDX-License-Identifier: Apache-2.0
// The leaves of a tree by their number of triangles, as bars.
import { svg } from './dom.js';
import { countText } from './text.js';

const WIDTH = 280;
const HEIGHT = 76;
const AXIS = 14; // below the bars
const LAST = 64; // the entry after it counts all leaves with more triangles

const leafText = (triangles) => (triangles > LAST ? `more than ${LAST}` : String(triangles));

/** Fills a <figure>, which is hidden if there is nothing to compare. */
export function showHistogram(figure, leaves) {
  figure.hidden = leaves.length < 2;
  if (figure.hidden) return;
  const most = Math.max(...leaves);
  const width = WIDTH / leaves.length;
  const bars = leaves.map((number, triangles) => bar(number, triangles, width, most));
  const every = [1, 2, 4, 8, 16].find((step) => leaves.length / step <= 9);
  const labels = [...leaves.keys()].filter((triangles) => triangles % every === 0);
  const plot = svg(
    'svg',
    { viewBox: `0 0 ${WIDTH} ${HEIGHT + AXIS}`, role: 'img', 'aria-label': summary(leaves, most) },
    ...bars,
    svg('line', { class: 'axis', x1: 0, x2: WIDTH, y1: HEIGHT, y2: HEIGHT }),
    ...labels.map((triangles) =>
      svg(
        'text',
        { x: (triangles + 0.5) * width, y: HEIGHT + 11, 'text-anchor': 'middle' },
        triangles > LAST ? `>${LAST}` : String(triangles),
      ),
    ),
  );
  figure.querySelector('svg')?.remove();
  figure.prepend(plot);
}

/** With room for a pointer above short bars: the number is in a tooltip. */
function bar(number, triangles, width, most) {
  const height = number > 0 ? Math.max(1, ((HEIGHT - 4) * number) / most) : 0;
  const gap = Math.min(1, width / 4);
  return svg(
    'g',
    { class: 'leaf-bar' },
    svg('title', {}, `${countText(number)} leaves with ${leafText(triangles)} triangles`),
    svg('rect', { class: 'touch', x: triangles * width, y: 0, width, height: HEIGHT }),
    svg('rect', { x: triangles * width, y: HEIGHT - height, width: width - gap, height }),
  );
}

function summary(leaves, most) {
  const largest = leafText(leaves.length - 1);
  const peak = leafText(leaves.indexOf(most));
  return `From 0 to ${largest} triangles; most leaves, ${countText(most)}, have ${peak}.`;
}
