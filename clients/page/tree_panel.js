// SPDX-License-Identifier: Apache-2.0
// What is known of the chosen tree and its mesh.
import { byId, element, fillFacts } from './dom.js';
import { showHistogram } from './histogram.js';
import { nameOf } from './names.js';
import { bytesText, countText, millisecondsText, pointText, shortNumber } from './text.js';

/** `tree` as the service describes it; null shows nothing. */
export function showTree(tree) {
  byId('about').hidden = !tree;
  byId('no-tree').hidden = Boolean(tree);
  if (!tree) return;
  byId('tree-name').textContent = nameOf(tree.id) ?? 'Mesh without a name';
  byId('tree-id').textContent = tree.id;
  fillFacts(byId('mesh-facts'), meshFacts(tree.mesh));
  fillFacts(byId('health-facts'), healthFacts(tree.mesh.health));
  showGroups(tree.mesh.groups ?? []);
  fillFacts(byId('tree-facts'), treeFacts(tree.tree));
  showHistogram(byId('leaves'), tree.tree?.leaf_histogram ?? []);
  byId('plan').textContent = tree.plan || '–';
}

function meshFacts(mesh) {
  const size = mesh.bounds && mesh.bounds.max.map((x, axis) => x - mesh.bounds.min[axis]);
  return [
    ['Triangles', countText(mesh.triangles)],
    ['Vertices', countText(mesh.vertices)],
    ['Faces dropped', mesh.dropped ? countText(mesh.dropped) : null],
    ['File', `${mesh.format?.toUpperCase() ?? ''} ${bytesText(mesh.bytes)}`],
    ['Size', size ? size.map((x) => shortNumber(x)).join(' × ') : null],
    ['From', mesh.bounds ? pointText(mesh.bounds.min) : null],
    ['To', mesh.bounds ? pointText(mesh.bounds.max) : null],
    ['Area', mesh.area === undefined ? null : shortNumber(mesh.area, 5)],
    ['Volume', mesh.volume === undefined ? null : shortNumber(mesh.volume, 5)],
  ];
}

function healthFacts(health) {
  if (!health) return [];
  const some = (number) => (number > 0 ? countText(number) : null);
  const mark = (isGood, textContent) =>
    element('span', { className: isGood ? 'good' : 'warn', textContent });
  return [
    ['Surface', health.closed ? mark(true, 'closed') : mark(false, 'not closed')],
    ['Open edges', some(health.open_edges)],
    ['Non-manifold edges', some(health.non_manifold_edges)],
    ['Without area', some(health.degenerate)],
    ['Duplicates', some(health.duplicate)],
    ['Concave polygons', some(health.concave)],
    ['Resolution', shortNumber(health.coordinate_resolution, 3)],
  ];
}

function showGroups(groups) {
  byId('groups').hidden = groups.length === 0;
  byId('groups-title').textContent = `Groups (${countText(groups.length)})`;
  byId('group-names').replaceChildren(
    ...groups.map((name) => element('li', { textContent: name || 'without a name' })),
  );
}

function treeFacts(tree) {
  if (!tree) return [];
  return [
    ['Build', tree.build],
    ['Nodes', countText(tree.nodes)],
    ['Leaves', countText(tree.leaves)],
    ['Empty leaves', countText(tree.empty_leaves)],
    ['References', countText(tree.references)],
    ['Depth', countText(tree.max_depth)],
    ['Largest leaf', countText(tree.max_leaf)],
    ['Memory', bytesText(tree.bytes)],
    ['SAH cost', shortNumber(tree.sah_cost)],
    ['Read in', millisecondsText(tree.parse_ms)],
    ['Built in', millisecondsText(tree.build_ms)],
  ];
}
