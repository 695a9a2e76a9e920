// The words around the picture: the list of trees, what is known of the chosen one, and ray hits.
import { nameOf } from './names.js';
import {
  bytesText, countText, element, fillFacts, millisecondsText, pointText, shortId, shortNumber,
  trianglesText,
} from './text.js';

const byId = (id) => document.getElementById(id);

export function showTrees(trees, chosenId, onChoose) {
  const items = trees.map((tree) => {
    const name = nameOf(tree.id);
    const facts = [
      tree.mesh.triangles === undefined ? bytesText(tree.mesh.bytes) : trianglesText(tree.mesh.triangles),
      tree.tree?.build,
    ];
    const button = element(
      'button',
      { type: 'button', title: tree.id },
      element('span', { className: name ? 'name' : 'name id', textContent: name ?? shortId(tree.id) }),
      element('span', { className: 'quiet', textContent: facts.filter(Boolean).join(' · ') }),
    );
    if (name) button.append(element('span', { className: 'quiet id', textContent: shortId(tree.id) }));
    if (tree.state === 'building')
      button.append(element('progress', { value: tree.progress, ariaLabel: 'Building' }));
    button.ariaCurrent = String(tree.id === chosenId);
    button.addEventListener('click', () => onChoose(tree.id));
    return element('li', {}, button);
  });
  if (items.length === 0) items.push(element('li', { className: 'quiet', textContent: 'None yet.' }));
  byId('trees').replaceChildren(...items);
}

export function showTree(tree) {
  byId('tree').hidden = !tree;
  if (!tree) return;
  byId('tree-name').textContent = nameOf(tree.id) ?? 'Mesh';
  byId('tree-id').textContent = tree.id;
  fillFacts(byId('mesh-facts'), meshFacts(tree.mesh));
  fillFacts(byId('health-facts'), healthFacts(tree.mesh.health));
  fillFacts(byId('tree-facts'), treeFacts(tree.tree));
  showHistogram(tree.tree?.leaf_histogram);
  byId('plan').textContent = tree.plan || '–';
}

function meshFacts(mesh) {
  const size = mesh.bounds && mesh.bounds.max.map((x, axis) => x - mesh.bounds.min[axis]);
  return [
    ['Triangles', countText(mesh.triangles)],
    ['Vertices', countText(mesh.vertices)],
    ['Faces dropped', mesh.dropped ? countText(mesh.dropped) : null],
    ['File', `${mesh.format ?? ''} ${bytesText(mesh.bytes)}`],
    ['From', mesh.bounds ? pointText(mesh.bounds.min) : null],
    ['To', mesh.bounds ? pointText(mesh.bounds.max) : null],
    ['Size', size ? pointText(size) : null],
  ];
}

function healthFacts(health) {
  if (!health) return [];
  const some = (number) => (number > 0 ? countText(number) : null);
  const mark = (good, text) => element('span', { className: good ? 'good' : 'warn', textContent: text });
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

function treeFacts(tree) {
  if (!tree) return [];
  return [
    ['Build', tree.build],
    ['Nodes', countText(tree.nodes)],
    ['Leaves', `${countText(tree.leaves)} (${countText(tree.empty_leaves)} empty)`],
    ['References', countText(tree.references)],
    ['Depth', countText(tree.max_depth)],
    ['Largest leaf', countText(tree.max_leaf)],
    ['Memory', bytesText(tree.bytes)],
    ['SAH cost', shortNumber(tree.sah_cost)],
    ['Read in', millisecondsText(tree.parse_ms)],
    ['Built in', millisecondsText(tree.build_ms)],
  ];
}

/** Entry 65 counts all leaves with more than 64 triangles. */
const leafText = (triangles) => (triangles > 64 ? 'more than 64' : String(triangles));

function showHistogram(leaves) {
  const figure = byId('leaves');
  figure.hidden = !leaves?.length || leaves.length < 2;
  if (figure.hidden) return;
  const most = Math.max(...leaves);
  const bars = leaves.map((number, triangles) => {
    const bar = element('span', {
      title: `${countText(number)} leaves with ${leafText(triangles)} triangles`,
    });
    bar.style.height = `${(100 * number) / most}%`;
    return bar;
  });
  byId('leaf-bars').replaceChildren(...bars);
  const peak = leaves.indexOf(most);
  byId('leaf-bars').ariaLabel =
    `From 0 to ${leafText(leaves.length - 1)} triangles; most leaves, ${countText(most)}, have ${leafText(peak)}.`;
}

/** `hit` as the service answers it; undefined hides the panel. */
export function showHit(hit) {
  byId('hit').hidden = hit === undefined;
  if (hit === undefined) return;
  if (hit === null) {
    fillFacts(byId('hit-facts'), [['Result', 'meets nothing']]);
    return;
  }
  fillFacts(byId('hit-facts'), [
    ['Triangle', countText(hit.triangle)],
    ['Distance t', shortNumber(hit.t, 9)],
    ['Point', pointText(hit.point, 6)],
    ['Normal', pointText(hit.normal)],
    ['u, v', `${shortNumber(hit.u)}, ${shortNumber(hit.v)}`],
  ]);
}

let toastTimer;
export function showToast(text) {
  byId('toast').textContent = text;
  byId('toast').hidden = false;
  clearTimeout(toastTimer);
  toastTimer = setTimeout(() => (byId('toast').hidden = true), 2200);
}

/** An ApiError or another error, until dismissed; null takes it away. */
export function showProblem(error) {
  byId('problem').hidden = !error;
  if (!error) return;
  byId('problem-code').textContent = error.code ?? error.name;
  byId('problem-detail').textContent = error.message;
  byId('problem-more').textContent = problemMore(error);
}

/** Where to look further: line, parameter, request id. */
export function problemMore(error) {
  return [
    error.line && `line ${error.line}`,
    error.parameter && `parameter ${error.parameter}`,
    error.requestId && `request ${error.requestId}`,
  ].filter(Boolean).join(' · ');
}
