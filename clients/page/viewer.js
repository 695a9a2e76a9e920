// Puts the page together: which tree is shown, how, and what the buttons do.
import { Api, rayBody, treePath } from './api.js';
import { OrbitCamera } from './camera.js';
import { attachControls } from './controls.js';
import { showHit, showProblem, showToast, showTree, showTrees } from './panels.js';
import { Picture } from './picture.js';
import { element, millisecondsText, shellQuote } from './text.js';
import { acceptDrops, Uploads } from './uploads.js';

const LIST_EVERY_MS = 15000;
const MODES = ['shaded', 'normal', 'depth', 'triangle'];

const byId = (id) => document.getElementById(id);
const canvas = byId('canvas');
const camera = new OrbitCamera();
const api = new Api(askForToken);
const picture = new Picture(canvas, api, { onShown: pictureShown, onError: showProblem });

let trees = []; // descriptions of the pages of the list that were asked for
let nextPage = null;
let chosen = null; // the description of the tree in the picture
let lastHit = null; // {ray, query, point}: the last click
let shownCamera = null; // of the picture on the canvas, which may lag behind `camera`

// ---- What is shown ----

function renderQuery() {
  const query = { mode: byId('mode').value, background: 'transparent' };
  if (byId('precision').value !== 'auto') query.precision = byId('precision').value;
  if (Number(byId('cells').value) >= 0) query.cells_depth = byId('cells').value;
  return query;
}

function refresh({ moving = false } = {}) {
  if (!chosen) return;
  picture.show({ id: chosen.id, camera, query: renderQuery() }, { moving });
}

function pictureShown({ camera: seen, width, height, quality, precision, traceMs, totalMs }) {
  shownCamera = seen;
  showProblem(null);
  placeMarker();
  const parts = [`${width} × ${height}`, precision, `traced in ${millisecondsText(traceMs)}`,
    `here after ${millisecondsText(totalMs)}`];
  byId('status').textContent = parts.filter(Boolean).join(' · ');
  canvas.dataset.quality = quality;
  if (quality > 1) history.replaceState(null, '', `#${link()}`);
}

async function choose(id, { keepCamera = false } = {}) {
  try {
    let tree = await api.tree(id);
    while (tree.state !== 'ready') {
      byId('status').textContent = `building, ${Math.round(100 * tree.progress)} %`;
      tree = await api.tree(id, 1000);
    }
    const sameMesh = chosen?.mesh.sha256 === tree.mesh.sha256;
    chosen = tree;
    if (!sameMesh && !keepCamera) camera.frame(tree.mesh.bounds.min, tree.mesh.bounds.max);
    if (!sameMesh) clearHit();
  } catch (error) {
    showProblem(error);
    return;
  }
  // A camera that came with the link still needs the mesh's size, for zoom limits.
  const { min, max } = chosen.mesh.bounds;
  camera.measure(min, max);
  showChosen();
  refresh();
}

function showChosen() {
  showTree(chosen);
  showTrees(trees, chosen?.id, choose);
  byId('empty').hidden = Boolean(chosen);
  canvas.ariaLabel = chosen
    ? `Render of a mesh with ${chosen.mesh.triangles} triangles`
    : 'No tree chosen';
  document.title = chosen ? `kdray · ${byId('tree-name').textContent}` : 'kdray';
  if (!chosen) return;
  const depth = byId('cells');
  depth.max = Math.min(chosen.tree.max_depth, 24);
  showCellsDepth();
  byId('download').href = api.url(`${treePath(chosen.id)}/mesh`);
  byId('download').download = `${chosen.id.slice(0, 12)}.${chosen.mesh.format}`;
}

function showCellsDepth() {
  const depth = Number(byId('cells').value);
  byId('cells-depth').value = depth < 0 ? 'off' : depth;
}

// ---- The list ----

async function loadTrees() {
  try {
    const page = await api.trees();
    const fresh = new Set(page.trees.map((tree) => tree.id));
    // Pages further down were asked for once and are not asked for again with every refresh.
    trees = page.next ? [...page.trees, ...trees.filter((tree) => !fresh.has(tree.id))] : page.trees;
    if (trees.length === page.trees.length) nextPage = page.next;
    showList();
  } catch (error) {
    showProblem(error);
  }
}

async function loadMore() {
  const page = await api.trees(nextPage);
  const known = new Set(trees.map((tree) => tree.id));
  trees.push(...page.trees.filter((tree) => !known.has(tree.id)));
  nextPage = page.next;
  showList();
}

function showList() {
  byId('more').hidden = !nextPage;
  showTrees(trees, chosen?.id, choose);
}

async function deleteChosen() {
  const { id } = chosen;
  await api.deleteTree(id);
  trees = trees.filter((tree) => tree.id !== id);
  chosen = null;
  picture.show(null);
  clearHit();
  history.replaceState(null, '', location.pathname);
  byId('status').textContent = '';
  showChosen();
  showToast('Deleted');
}

async function rebuild(build) {
  const tree = await api.anotherBuild(chosen.mesh.sha256, build);
  await choose(tree.id);
  loadTrees();
}

// ---- Rays ----

async function shoot({ x, y }) {
  if (!chosen || !shownCamera) return;
  const ray = shownCamera.ray(x, y, picture.aspect);
  const query = { fields: 't,triangle,u,v,normal,point' };
  if (byId('precision').value !== 'auto') query.precision = byId('precision').value;
  const answer = await api.closestHit(chosen.id, ray, query);
  const hit = answer.results[0];
  lastHit = { ray, query, point: hit?.point };
  showHit(hit);
  placeMarker();
}

function clearHit() {
  lastHit = null;
  showHit(undefined);
  placeMarker();
}

function placeMarker() {
  const marker = byId('marker');
  const place = lastHit?.point && shownCamera?.project(lastHit.point, picture.aspect);
  marker.hidden = !place;
  if (!place) return;
  marker.style.left = `${100 * place.x}%`;
  marker.style.top = `${100 * place.y}%`;
}

// ---- Links and commands ----

/** The fragment that brings back tree, camera and choices. */
function link() {
  const { background, ...query } = renderQuery();
  const parameters = { tree: chosen.id, ...query, ...camera.parameters() };
  return new URLSearchParams(parameters).toString().replaceAll('%2C', ',');
}

async function openLink() {
  const parameters = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  if (!/^[0-9a-f]{64}-[a-z0-9.-]{1,63}$/.test(parameters.tree ?? '')) return false;
  for (const name of ['mode', 'precision', 'projection']) choice(byId(name), parameters[name]);
  const cells = byId('cells');
  if (parameters.cells_depth) cells.max = Math.max(cells.max, Number(parameters.cells_depth));
  cells.value = parameters.cells_depth ?? -1;
  const restored = camera.restore(parameters);
  byId('up').value = camera.upAxis;
  byId('projection').value = camera.projection;
  await choose(parameters.tree, { keepCamera: restored });
  return true;
}

/** Chooses an option that is there; anything else in a link is passed over. */
function choice(select, value) {
  if ([...select.options].some((option) => option.value === value)) select.value = value;
}

function curl(words) {
  const token = api.token ? ` -H "Authorization: Bearer $KDRAY_TOKEN"` : '';
  return `curl -sS${token} ${words.map(shellQuote).join(' ')}`;
}

function renderCommand() {
  const { width, height } = picture.size(1);
  const query = { ...renderQuery(), ...camera.parameters(), width, height };
  return curl(['-o', 'kdray.png', String(api.url(`${treePath(chosen.id)}/render.png`, query))]);
}

function hitCommand() {
  const url = String(api.url(`${treePath(chosen.id)}/rays/closest`, lastHit.query));
  return curl(['--data', rayBody(lastHit.ray), url]);
}

async function copy(text, what) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    // Plain http on another host has no clipboard: the old way, by a selection.
    const area = element('textarea', { value: text });
    document.body.append(area);
    area.select();
    document.execCommand('copy');
    area.remove();
  }
  showToast(`${what} copied`);
}

function askForToken() {
  const dialog = byId('token-dialog');
  byId('token').value = '';
  dialog.showModal();
  return new Promise((resolve) => {
    const closed = () => {
      if (!byId('token').value) return dialog.showModal(); // Escape: nothing works without it
      dialog.removeEventListener('close', closed);
      resolve(byId('token').value);
    };
    dialog.addEventListener('close', closed);
  });
}

// ---- Wiring ----

/** An event's work, whose failure is shown instead of lost in the console. */
const trying = (work) => async (event) => {
  try {
    await work(event);
  } catch (error) {
    showProblem(error);
  }
};

const onClick = (id, work) => byId(id).addEventListener('click', trying(work));
const onChange = (id, work) => byId(id).addEventListener('change', trying(work));

function fill(select, names, chosenName) {
  select.replaceChildren(...names.map((name) => element('option', { value: name, textContent: name })));
  if (chosenName) select.value = chosenName;
}

function wire() {
  const uploads = new Uploads(api, {
    list: byId('uploads'),
    chosenBuild: () => byId('build').value,
    onTree: (tree) => {
      choose(tree.id);
      loadTrees();
    },
  });
  acceptDrops(byId('drop'), (files) => uploads.add(files));
  onClick('choose', () => byId('file').click());
  onChange('file', () => {
    uploads.add([...byId('file').files]);
    byId('file').value = ''; // so that the same file can be chosen again
  });

  const reset = () => {
    if (!chosen) return;
    camera.frame(chosen.mesh.bounds.min, chosen.mesh.bounds.max);
    refresh();
  };
  attachControls(canvas, camera, {
    moved: () => refresh({ moving: true }),
    clicked: trying(shoot),
    reset,
  });
  onClick('reset', reset);
  byId('tools').addEventListener('submit', (event) => event.preventDefault());
  onChange('mode', () => refresh());
  onChange('precision', () => refresh());
  onChange('projection', () => {
    camera.projection = byId('projection').value;
    refresh();
  });
  onChange('up', () => {
    camera.upAxis = byId('up').value;
    refresh();
  });
  byId('cells').addEventListener('input', () => {
    showCellsDepth();
    refresh();
  });

  onClick('more', loadMore);
  onClick('delete', () => {
    if (chosen && confirm('Forget this tree? The mesh goes with its last tree.')) return deleteChosen();
  });
  onChange('rebuild', async () => {
    const build = byId('rebuild').value;
    byId('rebuild').value = '';
    if (build) await rebuild(build);
  });
  onClick('share', () => {
    const url = new URL(location.href);
    url.hash = chosen ? link() : '';
    return copy(String(url), 'Link');
  });
  onClick('curl', () => (chosen ? copy(renderCommand(), 'Command') : showToast('No tree chosen')));
  onClick('hit-curl', () => copy(hitCommand(), 'Command'));
  onClick('problem-close', () => showProblem(null));
  addEventListener('hashchange', trying(openLink));
  setInterval(() => document.visibilityState === 'visible' && loadTrees(), LIST_EVERY_MS);
}

async function start() {
  wire();
  fill(byId('mode'), MODES);
  fill(byId('precision'), ['auto']);
  try {
    const info = await api.info();
    byId('version').textContent = info.version;
    fill(byId('precision'), info.precisions ?? ['auto'], 'auto');
    fill(byId('build'), info.builds ?? ['auto'], 'auto');
    byId('rebuild').append(...[...byId('build').options].map((option) => option.cloneNode(true)));
  } catch (error) {
    showProblem(error);
  }
  await loadTrees();
  const opened = await openLink();
  const first = trees.find((tree) => tree.state === 'ready');
  if (!opened && first) await choose(first.id);
}

start();
