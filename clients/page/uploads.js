// Uploads files one after the other, each with a card that shows its progress.
import { rememberName } from './names.js';
import { problemMore } from './panels.js';
import { bytesText, element } from './text.js';

const DIGEST_AT_MOST = 256 * 1024 * 1024; // larger files are not read into memory to be asked for

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
    for (const file of files) {
      const card = new Card(this.list, file);
      this.last = this.last.then(() => this.run(file, build, card));
    }
  }

  async run(file, build, card) {
    try {
      const tree = await this.treeOf(file, build, card);
      rememberName(tree.id.slice(0, 64), file.name);
      card.remove();
      this.onTree(tree);
    } catch (error) {
      card.fail(error);
    }
  }

  async treeOf(file, build, card) {
    const known = await this.find(file, build, card);
    let tree = known;
    if (!tree) {
      card.show(`sending ${bytesText(file.size)}`, 0);
      tree = await this.api.upload(file, build, (part) =>
        card.show(`sending ${bytesText(file.size)}`, part),
      );
    }
    while (tree.state !== 'ready') {
      card.show('building', tree.progress);
      tree = await this.api.tree(tree.id, 250);
    }
    return tree;
  }

  /** The server's tree of these bytes, or null. Browsers compute hashes only on secure pages. */
  async find(file, build, card) {
    if (!globalThis.crypto?.subtle || file.size > DIGEST_AT_MOST) return null;
    card.show('looking whether the server has it');
    const digest = new Uint8Array(await crypto.subtle.digest('SHA-256', await file.arrayBuffer()));
    const sha256 = [...digest].map((byte) => byte.toString(16).padStart(2, '0')).join('');
    try {
      return await this.api.tree(`${sha256}-${build}`);
    } catch (error) {
      if (error.status) return null; // not there, or failed before: the upload says what today
      throw error;
    }
  }
}

class Card {
  constructor(list, file) {
    this.words = element('span', { className: 'quiet', textContent: 'waiting' });
    this.bar = element('progress', { ariaLabel: `Progress of ${file.name}` });
    this.item = element(
      'li', {}, element('span', { className: 'name', textContent: file.name }), this.words, this.bar,
    );
    list.append(this.item);
  }

  /** Without `part` the bar shows activity only. */
  show(words, part) {
    this.words.textContent = words;
    if (part === undefined) this.bar.removeAttribute('value');
    else this.bar.value = part;
  }

  fail(error) {
    this.bar.remove();
    this.item.className = 'failed';
    this.words.textContent = `${error.code ?? error.name}: ${error.message}`;
    this.item.append(element('small', { textContent: problemMore(error) }));
    const close = element('button', { type: 'button', ariaLabel: 'Dismiss', textContent: '×' });
    close.addEventListener('click', () => this.remove());
    this.item.append(close);
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
