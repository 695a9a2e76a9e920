// SPDX-License-Identifier: Apache-2.0
// Uploads chosen and dropped files one after the other, each with a card that shows its progress.
import { byId } from './dom.js';
import { isAbort, TooLargeError } from './errors.js';
import { rememberName } from './names.js';
import { announce } from './notices.js';
import { bytesText } from './text.js';
import { UploadCard } from './upload_card.js';

const DIGEST_AT_MOST = 256 * 1024 * 1024; // larger files are not read into memory to be asked for
const POLL_MS = 250;
const RETRIES = 3; // a connection that breaks again and again is not a server that was gone

export class Uploads {
  /**
   * @param connection to wait for while the server is gone
   * @param onTree called with the description of each tree when it is ready
   */
  constructor(api, connection, { onTree }) {
    this.api = api;
    this.connection = connection;
    this.onTree = onTree;
    this.maxBytes = Infinity;
    this.last = Promise.resolve();
    for (const id of ['choose', 'choose-first'])
      byId(id).addEventListener('click', () => byId('file').click());
    byId('file').addEventListener('change', () => {
      this.add([...byId('file').files]);
      byId('file').value = ''; // so that the same file can be chosen again
    });
    acceptDrops(byId('drop'), (files) => this.add(files));
  }

  /** The formats that the server reads, in the file chooser and for people. */
  offerFormats(formats) {
    byId('file').accept = formats.map((format) => `.${format}`).join();
    byId('formats').textContent = formats.join(', ').toUpperCase();
  }

  add(files) {
    const build = byId('build').value;
    for (const file of files) this.addOne(file, build);
  }

  addOne(file, build) {
    const card = new UploadCard(byId('uploads'), file, () => this.addOne(file, build));
    this.last = this.last.then(() => this.run(file, build, card));
  }

  async run(file, build, card, retries = RETRIES) {
    try {
      card.signal.throwIfAborted();
      if (file.size > this.maxBytes) throw new TooLargeError(file.size, this.maxBytes);
      const tree = await this.treeOf(file, build, card);
      card.remove();
      announce(`${file.name} is ready`);
      this.onTree(tree);
    } catch (error) {
      if (isAbort(error)) return card.remove();
      if (!error.isOutage || retries === 0) return card.fail(error);
      // Safe to repeat: what the server has got meanwhile is not sent again.
      card.words('waiting for the server');
      await this.connection.back();
      await this.run(file, build, card, retries - 1);
    }
    return undefined;
  }

  async treeOf(file, build, card) {
    const digest = await this.digest(file, card);
    let tree = digest && (await this.find(digest, build, card));
    if (!tree) {
      card.begin(`sending ${bytesText(file.size)}`);
      tree = await this.api.upload(file, build, {
        digest: digest && btoa(String.fromCharCode(...digest)),
        onProgress: (part) => card.progress(part),
        signal: card.signal,
      });
    }
    rememberName(tree.mesh.sha256, file.name);
    if (tree.state !== 'ready') card.begin('building');
    while (tree.state !== 'ready') {
      card.progress(tree.progress);
      tree = await this.api.tree(tree.id, POLL_MS, card.signal);
    }
    return tree;
  }

  /** The SHA-256 of a file, or null. Browsers compute hashes only on secure pages. */
  async digest(file, card) {
    if (!globalThis.crypto?.subtle || file.size > DIGEST_AT_MOST) return null;
    card.words('looking whether the server has it');
    return new Uint8Array(await crypto.subtle.digest('SHA-256', await file.arrayBuffer()));
  }

  /** The server's tree of a mesh, or null. */
  async find(digest, build, card) {
    const sha256 = [...digest].map((byte) => byte.toString(16).padStart(2, '0')).join('');
    // For an unknown mesh the list is empty; asking for the tree would be an error in the console.
    const { trees } = await this.api.treesOfMesh(sha256, card.signal);
    return trees.find((tree) => tree.id === `${sha256}-${build}`) ?? null;
  }
}

/** Files dropped anywhere on the page; `veil` is shown while something hangs over it. */
function acceptDrops(veil, onFiles) {
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
