// Uploads files one after the other, each with a card that shows its progress.
import { element } from './dom.js';
import { errorDetails, isAbort } from './errors.js';
import { Eta } from './eta.js';
import { rememberName } from './names.js';
import { announce } from './notices.js';
import { bytesText } from './text.js';

const DIGEST_AT_MOST = 256 * 1024 * 1024; // larger files are not read into memory to be asked for
const POLL_MS = 250;

export class Uploads {
  /** @param onTree called with the description of each tree when it is ready */
  constructor(api, { list, chosenBuild, onTree }) {
    this.api = api;
    this.list = list;
    this.chosenBuild = chosenBuild;
    this.onTree = onTree;
    this.last = Promise.resolve();
  }

  add(files) {
    const build = this.chosenBuild();
    for (const file of files) this.addOne(file, build);
  }

  addOne(file, build) {
    const card = new Card(this.list, file, () => this.addOne(file, build));
    this.last = this.last.then(() => this.run(file, build, card));
  }

  async run(file, build, card) {
    try {
      card.signal.throwIfAborted();
      const tree = await this.treeOf(file, build, card);
      rememberName(tree.mesh.sha256, file.name);
      card.remove();
      announce(`${file.name} is ready`);
      this.onTree(tree);
    } catch (error) {
      if (isAbort(error)) card.remove();
      else card.fail(error);
    }
  }

  async treeOf(file, build, card) {
    let tree = await this.find(file, build, card);
    if (!tree) {
      const sending = `sending ${bytesText(file.size)}`;
      card.begin(sending);
      tree = await this.api.upload(file, build, (part) => card.progress(part), card.signal);
    }
    if (tree.state !== 'ready') card.begin('building');
    while (tree.state !== 'ready') {
      card.progress(tree.progress);
      tree = await this.api.tree(tree.id, POLL_MS, card.signal);
    }
    return tree;
  }

  /** The server's tree of these bytes, or null. Browsers compute hashes only on secure pages. */
  async find(file, build, card) {
    if (!globalThis.crypto?.subtle || file.size > DIGEST_AT_MOST) return null;
    card.words('looking whether the server has it');
    const digest = new Uint8Array(await crypto.subtle.digest('SHA-256', await file.arrayBuffer()));
    const sha256 = [...digest].map((byte) => byte.toString(16).padStart(2, '0')).join('');
    // For an unknown mesh the list is empty; asking for the tree would be an error in the console.
    const { trees } = await this.api.treesOfMesh(sha256, card.signal);
    return trees.find((tree) => tree.id === `${sha256}-${build}`) ?? null;
  }
}

class Card {
  constructor(list, file, onAgain) {
    this.file = file;
    this.onAgain = onAgain;
    this.abort = new AbortController();
    this.text = element('span', { className: 'quiet', textContent: 'waiting' });
    this.bar = element('progress', { ariaLabel: `Progress of ${file.name}` });
    this.close = this.button(`Stop ${file.name}`, '×', () => this.stop());
    this.item = element(
      'li', {}, element('span', { className: 'name', textContent: file.name }), this.text, this.bar,
      this.close,
    );
    list.append(this.item);
  }

  get signal() {
    return this.abort.signal;
  }

  stop() {
    this.abort.abort();
    this.remove(); // also one that still waits for its turn
  }

  button(label, textContent, onClick) {
    const words = { ariaLabel: label, title: label, textContent };
    const button = element('button', { type: 'button', ...words });
    button.addEventListener('click', onClick);
    return button;
  }

  /** The bar shows activity only. */
  words(text) {
    this.text.textContent = text;
    this.bar.removeAttribute('value');
  }

  begin(what) {
    this.what = what;
    this.eta = new Eta();
    this.progress(0);
  }

  progress(part) {
    this.text.textContent = `${this.what} · ${this.eta.text(part)}`;
    this.bar.value = part;
  }

  fail(error) {
    this.bar.remove();
    this.item.className = 'failed';
    this.text.textContent = `${error.code ?? error.name}: ${error.message}`;
    this.item.append(element('small', { textContent: errorDetails(error) }));
    this.close.ariaLabel = this.close.title = 'Dismiss';
    // What is wrong with the file stays wrong.
    if (error.status && !error.retryAfterMs) return;
    const again = this.button(`Try ${this.file.name} again`, 'Try again', () => {
      this.remove();
      this.onAgain();
    });
    again.className = 'again';
    this.item.append(again);
  }

  remove() {
    this.item.remove();
  }
}

/** Files dropped anywhere on the page; `veil` is shown while something hangs over it. */
export function acceptDrops(veil, onFiles) {
  const hasFiles = (event) => event.dataTransfer?.types.includes('Files');
  addEventListener('dragover', (event) => {
    if (!hasFiles(event)) return;
    event.preventDefault();
    veil.hidden = false;
  });
  addEventListener('dragleave', (event) => {
    if (event.relatedTarget === null) veil.hidden = true;
  });
  addEventListener('drop', (event) => {
    veil.hidden = true;
    if (!hasFiles(event)) return;
    event.preventDefault();
    onFiles([...event.dataTransfer.files]);
  });
}
