// Puts the page together: which tree is shown, how, and what the buttons do.
import { Api, treePath } from './api.js';
import { OrbitCamera } from './camera.js';
import { copyText, hitCommand, renderCommand } from './commands.js';
import { attachControls } from './controls.js';
import { nameOf } from './names.js';
import { showHit, showProblem, showToast, showTree } from './panels.js';
import { Picture } from './picture.js';
import { element, millisecondsText, trianglesText } from './text.js';
import { askForToken } from './token_dialog.js';
import { TreeList } from './tree_list.js';
import { acceptDrops, Uploads } from './uploads.js';

const LIST_EVERY_MS = 15000;
// Of the contract, which names them; `position` has no picture.
const MODES = ['shaded', 'normal', 'depth', 'triangle', 'ambient-occlusion', 'cost'];
const DEEPEST_CELLS = 24; // a slider with more steps cannot be aimed; deeper cells are specks

const byId = (id) => document.getElementById(id);
const canvas = byId('canvas');
const camera = new OrbitCamera();
const api = new Api(() => askForToken(byId('token-dialog'), byId('token')));
const picture = new Picture(canvas, api, { onShown: pictureShown, onError: showProblem });
const list = new TreeList(api, byId('more'), (id) => choose(id));

let chosen = null; // the description of the tree in the picture
let lastHit = null; // {ray, query, point}: the last click
let shownCamera = null; // of the picture on the canvas, which may lag behind `camera`

// ---- The picture ----

function renderQuery() {
  const query = { mode: byId('mode').value, ...precisionQuery() };
  if (Number(byId('cells').value) >= 0) query.cells_depth = byId('cells').value;
  return query;
}

function precisionQuery() {
  const precision = byId('precision').value;
  return precision === 'auto' ? {} : { precision };
}

function refresh({ moving = false } = {}) {
  if (!chosen) return;
  // The page's own background shows through.
  const query = { ...renderQuery(), background: 'transparent' };
  picture.show({ id: chosen.id, camera, query }, { moving });
}

function pictureShown({ camera: seen, width, height, quality, precision, traceMs, totalMs }) {
  shownCamera = seen;
  showProblem(null);
  placeMarker();
  const parts = [
    `${width} × ${height}`,
    precision,
    `traced in ${millisecondsText(traceMs)}`,
    `here after ${millisecondsText(totalMs)}`,
  ];
  byId('status').textContent = parts.filter(Boolean).join(' · ');
  canvas.dataset.quality = quality;
  if (quality !== 'moving') history.replaceState(null, '', `#${link()}`);
}

function frameChosen() {
  const { min, max } = chosen.mesh.bounds;
  camera.frame(min, max, picture.aspect);
}

// ---- The tree ----

async function choose(id, { keepCamera = false } = {}) {
  try {
    await showWhenReady(id, keepCamera);
  } catch (error) {
    showProblem(error);
  }
}

async function showWhenReady(id, keepCamera) {
  let tree = await api.tree(id);
  while (tree.state !== 'ready') {
    byId('status').textContent = `building, ${Math.round(100 * tree.progress)} %`;
    tree = await api.tree(id, 1000);
  }
  const isOtherMesh = chosen?.mesh.sha256 !== tree.mesh.sha256;
  chosen = tree;
  if (isOtherMesh) {
    clearHit();
    if (!keepCamera) frameChosen();
  }
  camera.measure(tree.mesh.bounds.min, tree.mesh.bounds.max);
  showChosen();
  refresh();
}

function showChosen() {
  showTree(chosen);
  list.choose(chosen?.id ?? null);
  byId('empty').hidden = Boolean(chosen);
  canvas.ariaLabel = chosen
    ? `Picture of a mesh with ${trianglesText(chosen.mesh.triangles)}`
    : 'No tree chosen';
  document.title = chosen ? `kdray · ${byId('tree-name').textContent}` : 'kdray';
  if (!chosen) return;
  byId('cells').max = Math.min(chosen.tree.max_depth, DEEPEST_CELLS);
  showCellsDepth();
}

function showCellsDepth() {
  const depth = Number(byId('cells').value);
  byId('cells-depth').value = depth < 0 ? 'off' : depth;
}

async function deleteChosen() {
  if (!confirm('Forget this tree? The mesh goes with its last tree.')) return;
  const { id } = chosen;
  await api.deleteTree(id);
  chosen = null;
  picture.show(null);
  clearHit();
  list.remove(id);
  showChosen();
  history.replaceState(null, '', location.pathname);
  byId('status').textContent = '';
  showToast('Deleted');
}

async function rebuild() {
  const build = byId('rebuild').value;
  byId('rebuild').value = '';
  if (!build) return;
  const tree = await api.anotherBuild(chosen.mesh.sha256, build);
  await choose(tree.id);
  await list.load();
}

/** Fetched by script rather than by a plain link, which could not carry the token. */
async function downloadMesh() {
  const response = await api.fetch(`${treePath(chosen.id)}/mesh`);
  const href = URL.createObjectURL(await response.blob());
  const name = nameOf(chosen.id) ?? `${chosen.id.slice(0, 12)}.${chosen.mesh.format}`;
  element('a', { href, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(href), 60000);
}

// ---- Rays ----

async function shoot({ x, y }) {
  if (!chosen || !shownCamera) return;
  const ray = shownCamera.ray(x, y, picture.aspect);
  const query = { fields: 't,triangle,u,v,normal,point', ...precisionQuery() };
  const [hit] = (await api.closestHit(chosen.id, ray, query)).results;
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
  const place = lastHit?.point && shownCamera?.project(lastHit.point, picture.aspect);
  const marker = byId('marker');
  marker.hidden = !place;
  if (!place) return;
  marker.style.left = `${100 * place.x}%`;
  marker.style.top = `${100 * place.y}%`;
}

// ---- Links and commands ----

/** The fragment that restores tree, camera and choices. */
function link() {
  const parameters = { tree: chosen.id, ...renderQuery(), ...camera.parameters() };
  return new URLSearchParams(parameters).toString().replaceAll('%2C', ',');
}

/** Whether the page's address names a tree to show. */
async function openLink() {
  const parameters = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  if (!/^[0-9a-f]{64}-[a-z0-9.-]{1,63}$/.test(parameters.tree ?? '')) return false;
  for (const name of ['mode', 'precision']) chooseOption(byId(name), parameters[name]);
  const cells = byId('cells');
  cells.max = DEEPEST_CELLS; // until the tree's own depth is known
  cells.value = parameters.cells_depth ?? -1;
  const keepCamera = camera.restore(parameters);
  byId('up').value = camera.upAxis;
  byId('projection').value = camera.projection;
  await choose(parameters.tree, { keepCamera });
  return true;
}

/** Chooses an existing option; other values in a link are ignored. */
function chooseOption(select, value) {
  if ([...select.options].some((option) => option.value === value)) select.value = value;
}

function copyLink() {
  const url = new URL(location.href);
  url.hash = chosen ? link() : '';
  return copyText(String(url), 'Link');
}

function copyRenderCommand() {
  if (!chosen) return showToast('No tree chosen');
  const query = { ...renderQuery(), ...camera.parameters(), ...picture.size(1) };
  return copyText(renderCommand(api, chosen.id, query), 'Command');
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

const on = (id, type, work) => byId(id).addEventListener(type, trying(work));

function wireUploads() {
  const uploads = new Uploads(api, {
    list: byId('uploads'),
    chosenBuild: () => byId('build').value,
    onTree: trying((tree) => Promise.all([choose(tree.id), list.load()])),
  });
  acceptDrops(byId('drop'), (files) => uploads.add(files));
  on('choose', 'click', () => byId('file').click());
  on('file', 'change', () => {
    uploads.add([...byId('file').files]);
    byId('file').value = ''; // so that the same file can be chosen again
  });
}

function wirePicture() {
  const reset = () => {
    if (!chosen) return;
    frameChosen();
    refresh();
  };
  attachControls(canvas, camera, {
    moved: () => refresh({ moving: true }),
    clicked: trying(shoot),
    reset,
  });
  on('reset', 'click', reset);
  on('tools', 'submit', (event) => event.preventDefault());
  on('mode', 'change', () => refresh());
  on('precision', 'change', () => refresh());
  on('projection', 'change', () => {
    camera.projection = byId('projection').value;
    refresh();
  });
  on('up', 'change', () => {
    camera.upAxis = byId('up').value;
    if (chosen) frameChosen();
    refresh();
  });
  on('cells', 'input', () => {
    showCellsDepth();
    refresh();
  });
}

function wireRest() {
  on('more', 'click', () => list.more());
  on('delete', 'click', deleteChosen);
  on('rebuild', 'change', rebuild);
  on('download', 'click', downloadMesh);
  on('share', 'click', copyLink);
  on('curl', 'click', copyRenderCommand);
  on('hit-curl', 'click', () =>
    copyText(hitCommand(api, chosen.id, lastHit.ray, lastHit.query), 'Command'),
  );
  on('problem-close', 'click', () => showProblem(null));
  addEventListener('hashchange', trying(openLink));
  setInterval(() => {
    if (document.visibilityState === 'visible') trying(() => list.load())();
  }, LIST_EVERY_MS);
}

function fill(select, names) {
  const options = names.map((name) => element('option', { value: name, textContent: name }));
  select.append(...options);
}

/** The formats that the server reads, in the file chooser and for people. */
function offerFormats(formats) {
  byId('file').accept = formats.map((format) => `.${format}`).join();
  byId('formats').textContent = `: ${formats.join(', ').toUpperCase()}`;
}

async function start() {
  wireUploads();
  wirePicture();
  wireRest();
  fill(byId('mode'), MODES);
  await trying(async () => {
    const info = await api.info();
    byId('version').textContent = info.version;
    fill(byId('precision'), info.precisions);
    fill(byId('build'), info.builds);
    fill(byId('rebuild'), info.builds);
    offerFormats(info.formats);
    await list.load();
    const first = list.firstReady();
    if (!(await openLink()) && first) await choose(first.id);
  })();
}

start();
