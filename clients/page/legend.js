// SPDX-License-Identifier: Apache-2.0
// What the colours of a picture mean: the steps of mode cost, the distances of mode depth.
import { byId, element } from './dom.js';
import { shortNumber } from './text.js';

/** The contract's level of a cost: log2(1 + nodes visited + triangles tested) / 10. */
const COST_LEVELS = [0, 0.25, 0.5, 0.75, 1];
const costAt = (level) => Math.round(2 ** (10 * level) - 1);

/**
 * @param mode of the picture
 * @param depthRange the answer's Kdray-Depth-Range, or null
 */
export function showLegend(mode, depthRange) {
  const legend = byId('legend');
  const entries = entriesOf(mode, depthRange);
  legend.hidden = !entries;
  if (!entries) return;
  legend.className = `legend ${mode}`;
  byId('legend-title').textContent = entries.title;
  byId('legend-labels').replaceChildren(
    ...entries.labels.map((text) => element('span', { textContent: text })),
  );
}

function entriesOf(mode, depthRange) {
  if (mode === 'cost') {
    const labels = COST_LEVELS.map((level) => String(costAt(level)));
    labels[labels.length - 1] += '+';
    return { title: 'Nodes visited and triangles tested', labels };
  }
  if (mode === 'depth' && depthRange) {
    const [near, far] = depthRange.split(',').map(Number);
    return { title: 'Distance along the view', labels: [near, far].map((x) => shortNumber(x)) };
  }
  return null;
}
