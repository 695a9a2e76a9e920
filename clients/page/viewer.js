// SPDX-License-Identifier: Apache-2.0
// Puts the page together: which tree is shown, what the buttons do, and what the address says.
import { Address } from './address.js';
import { Api } from './api.js';
import { parseNumbers } from './camera.js';
import { copyText, hitCommand, renderCommand } from './commands.js';
import { Connection } from './connection.js';
import { addOptions, byId, saveBlob } from './dom.js';
import { Eta } from './eta.js';
import { Inspector } from './inspector.js';
import { closeMenus } from './menus.js';
import { nameOf, rememberName } from './names.js';
import { announce, report, showLost, showProblem, showToast, trying } from './notices.js';
import { Previews } from './previews.js';
import * as rayPanel from './ray_panel.js';
import { Settings } from './settings.js';
import { Stage } from './stage.js';
import { Tabs } from './tabs.js';
import { shortId, trianglesText } from './text.js';
import { askForToken } from './token_dialog.js';
import { TradeoffPanel } from './tradeoff_panel.js';
import { TreeList } from './tree_list.js';
import { showTree } from './tree_panel.js';
import { guessUpAxis } from './up_axis.js';
import { Uploads } from './uploads.js';

const LIST_EVERY_MS = 15000;
const BUILDING_LIST_EVERY_MS = 1500;
const BUILD_POLL_MS = 500;

let chosen = null; // the description of the tree in the picture
let choices = 0; // counts calls of choose: the last one wins
let maxCells = 0; // in a picture
let restoring = 0; // calls of restore() under way
let hasPictureFailed = false;

const connection = new Connection('readyz', connectionChanged);
const api = new Api(
  () => askForToken(byId('token-dialog'), byId('token')),
  () => connection.lost(),
);
const settings = new Settings(settingsChanged);
const stage = new Stage(api, {
  query: () => settings.query(stage.camera.upAxis),
  shot: trying(shoot),
  surfaceAt: trying(surfaceAt),
  shown: pictureShown,
  actions: keyActions(),
  onError: pictureFailed,
});
const inspector = new Inspector(api, { panel: rayPanel, overlay: stage.overlay, onError: report });
const tradeoff = new TradeoffPanel(api, { onError: report, onChange: () => writeAddress() });
const list = new TreeList(api, new Previews(api, () => stage.isIdle), (id) => choose(id));
const uploads = new Uploads(api, connection, {
  onTree: trying((tree) => Promise.all([choose(tree.id), list.load()])),
});
const tabs = new Tabs(byId('tabs'), () => writeAddress());
const address = new Address(trying(restore));

// ---- The picture ----

function settingsChanged({ moving = false, isChoice = false }) {
  if (!chosen) return;
  if (isChoice) writeAddress({ isStep: true });
  stage.refresh({ moving });
  shootAgain();
}

function pictureFailed(error) {
  hasPictureFailed = true;
  report(error);
}

function pictureShown({ stage: quality, isSettled }) {
  if (hasPictureFailed) showProblem(null);
  hasPictureFailed = false;
  if (quality === 'rough') return;
  writeAddress();
  if (isSettled) inspector.changeDepth(settings.cellsDepth).catch(report);
}

function reset(view) {
  stage.frame(view);
  stage.refresh();
}

function setUpAxis(axis) {
  stage.camera.upAxis = axis;
  showCamera();
  reset();
  writeAddress({ isStep: true });
}

function setProjection() {
  stage.camera.projection = byId('projection').value;
  stage.refresh();
  writeAddress({ isStep: true });
}

/** Puts the camera's choices into the fields. */
function showCamera() {
  byId('projection').value = stage.camera.projection;
  byId(`up-${stage.camera.upAxis}`).checked = true;
}

function stepCells(step) {
  const deepest = Number(byId('cells').max);
  const depth = Math.max(-1, Math.min(deepest, (settings.cellsDepth ?? -1) + step));
  settings.cellsDepth = depth < 0 ? null : depth;
  settingsChanged({ moving: true });
}

function keyActions() {
  return {
    Home: () => reset(),
    0: () => reset(),
    '[': () => stepCells(-1),
    ']': () => stepCells(1),
    f: trying(toggleFullScreen),
    s: trying(savePicture),
  };
}

function toggleFullScreen() {
  return document.fullscreenElement
    ? document.exitFullscreen()
    : byId('view').requestFullscreen();
}

function savePicture() {
  return chosen && stage.save(`${nameOf(chosen.id) ?? shortId(chosen.id)}-${settings.mode}`);
}

// ---- The tree ----

/** @param values of an address to restore, besides the tree; without, the mesh is framed */
async function choose(id, values = null, { isStep = true } = {}) {
  const choice = ++choices;
  const tree = await trying(() => whenReady(id, choice))();
  if (!tree || choice !== choices) return;
  const isOther = chosen?.id !== tree.id;
  const isOtherMesh = chosen?.mesh.sha256 !== tree.mesh.sha256;
  chosen = tree;
  stage.choose(tree);
  if (isOtherMesh || (values && values.ray !== rayText())) inspector.clear();
  const isRestored = values && stage.camera.restore(values);
  if (!isRestored && isOtherMesh) {
    stage.camera.upAxis = guessUpAxis(tree.mesh);
    stage.frame();
  }
  if (!values && isOther) writeAddress({ isStep });
  showChosen(values);
  stage.refresh();
  await followLink(values);
  shootAgain();
}

async function whenReady(id, choice) {
  let tree = await api.tree(id);
  const eta = new Eta();
  while (tree.state !== 'ready' && choice === choices) {
    byId('status').textContent = `building · ${eta.text(tree.progress)}`;
    tree = await api.tree(id, BUILD_POLL_MS);
  }
  return tree;
}

function showChosen(values) {
  showTree(chosen);
  showCamera();
  list.choose(chosen?.id ?? null);
  byId('empty').hidden = Boolean(chosen);
  byId('corner').hidden = !chosen;
  tradeoff.choose(chosen, { isLikely: Boolean(values?.measured) });
  const words = chosen ? trianglesText(chosen.mesh.triangles) : '';
  stage.canvas.ariaLabel = chosen ? `Picture of a mesh with ${words}` : 'No tree chosen';
  document.title = chosen ? `${nameOf(chosen.id) ?? shortId(chosen.id)} · kdray` : 'kdray';
  if (!chosen) return;
  announce(`${nameOf(chosen.id) ?? 'Mesh'}, ${words}`);
  settings.limitCells(chosen.tree, maxCells);
}

/** What else than tree and camera a link restores. */
async function followLink(values) {
  if (!values) return;
  const numbers = parseNumbers(values.ray, 6);
  if (numbers && !inspector.shot) {
    const ray = { origin: numbers.slice(0, 3), direction: numbers.slice(3) };
    await trying(shootRay)(ray);
  }
  tabs.show(values.panel);
}

async function deleteChosen() {
  if (!confirm('Delete this tree? The mesh is deleted with its last tree.')) return;
  const { id } = chosen;
  await api.deleteTree(id);
  chosen = null;
  stage.choose(null);
  inspector.clear();
  list.remove(id);
  showChosen();
  address.clear();
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
  const blob = await api.meshFile(chosen.id);
  saveBlob(blob, nameOf(chosen.id) ?? `${chosen.id.slice(0, 12)}.${chosen.mesh.format}`);
}

// ---- Rays ----

/** The click's tab comes forward: there is the answer. */
async function shoot(ray) {
  await shootRay(ray);
  tabs.show('ray');
  writeAddress();
}

function shootRay(ray) {
  return inspector.shoot(chosen, ray, settings.precisionQuery(), settings.cellsDepth);
}

/** The last ray with another precision, or in another tree. */
function shootAgain() {
  const { shot } = inspector;
  if (shot && !inspector.hasShot(chosen, settings.precisionQuery())) trying(shootRay)(shot.ray);
}

/** The last ray as links have it; undefined without. */
function rayText() {
  const ray = inspector.shot?.ray;
  return ray && [...ray.origin, ...ray.direction].join();
}

async function surfaceAt(ray) {
  const { hit } = await api.closestHit(chosen.id, ray, { fields: 'point' });
  return hit?.point ?? null;
}

// ---- The address, links and commands ----

function currentValues() {
  return {
    tree: chosen.id,
    name: nameOf(chosen.id),
    ...settings.values(),
    ...stage.camera.parameters(),
    ray: rayText(),
    panel: tabs.chosen === tabs.tabs[0].dataset.tab ? null : tabs.chosen,
    measured: tradeoff.result ? 1 : null,
  };
}

function writeAddress(options) {
  // While it is restored, it says more than is shown.
  if (chosen && restoring === 0) address.write(currentValues(), options);
}

async function restore(values) {
  if (values.name && !nameOf(values.tree)) rememberName(values.tree.slice(0, 64), values.name);
  ++restoring;
  try {
    settings.restore(values);
    await choose(values.tree, values);
  } finally {
    --restoring;
  }
}

function copyLink() {
  writeAddress();
  return copyText(location.href, 'Link');
}

function copyRenderCommand() {
  if (!chosen) return showToast('No tree chosen');
  const camera = stage.camera.parameters();
  const query = { ...settings.query(stage.camera.upAxis), ...camera, ...stage.picture.size() };
  return copyText(renderCommand(api, chosen.id, query), 'Command');
}

function copyHitCommand() {
  const { tree, ray, query } = inspector.shot;
  return copyText(hitCommand(api, tree.id, ray, query), 'Command');
}

// ---- The server ----

function connectionChanged(isLost) {
  showLost(isLost);
  announce(isLost ? 'The server cannot be reached' : 'The server is back');
  if (isLost) return;
  if (isStarted) trying(() => list.load())();
  else start();
  stage.picture.retry();
}

function offer(info) {
  byId('version').textContent = info.version;
  settings.offerPrecisions(info.precisions);
  addOptions(byId('build'), info.builds);
  addOptions(byId('rebuild'), info.builds);
  uploads.offerFormats(info.formats);
  uploads.maxBytes = info.limits.max_upload_bytes;
  inspector.precisions = info.precisions.filter((name) => name !== 'auto');
  maxCells = info.limits.max_picture_cells;
}

let isStarted = false;

const start = trying(async () => {
  const info = await api.info();
  isStarted = true;
  offer(info);
  await list.load();
  const values = address.values();
  if (values) await restore(values);
  const first = list.firstReady();
  if (!chosen && first) await choose(first.id, null, { isStep: false });
});

// ---- Wiring ----

const on = (id, type, work) => byId(id).addEventListener(type, trying(work));

function wirePicture() {
  on('projection', 'change', setProjection);
  for (const axis of ['y', 'z']) on(`up-${axis}`, 'change', () => setUpAxis(axis));
  on('side', 'change', () => {
    reset(byId('side').value);
    byId('side').value = '';
  });
  on('reset', 'click', () => reset());
  on('save', 'click', savePicture);
  on('full', 'click', toggleFullScreen);
  byId('full').hidden = !document.fullscreenEnabled;
  closeMenus(document.querySelectorAll('details.menu'));
}

function wireRest() {
  on('more', 'click', () => list.more());
  on('delete', 'click', deleteChosen);
  on('rebuild', 'change', rebuild);
  on('download', 'click', downloadMesh);
  on('share', 'click', copyLink);
  on('curl', 'click', copyRenderCommand);
  on('hit-curl', 'click', copyHitCommand);
  on('clear-ray', 'click', () => {
    inspector.clear();
    writeAddress();
  });
  on('show-cost', 'click', () => {
    settings.mode = 'cost';
    settingsChanged({ isChoice: true });
  });
  on('help', 'click', () => byId('help-dialog').showModal());
  on('problem-close', 'click', () => showProblem(null));
  keepListFresh();
}

/** Progress in the list is looked at more often. */
function keepListFresh() {
  setTimeout(async () => {
    if (document.visibilityState === 'visible' && !connection.isLost)
      await trying(() => list.load())();
    keepListFresh();
  }, list.isBuilding ? BUILDING_LIST_EVERY_MS : LIST_EVERY_MS);
}

wirePicture();
wireRest();
start();
