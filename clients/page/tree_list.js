// SPDX-License-Identifier: Apache-2.0
// The trees that the server has, newest first, page by page, with small pictures.
import { byId, element } from './dom.js';
import { nameOf } from './names.js';
import { bytesText, shortId, trianglesText } from './text.js';

export class TreeList {
  /**
   * @param previews gives a small picture of a tree (previews.js)
   * @param onChoose called with the id of a tree that was clicked
   */
  constructor(api, previews, onChoose) {
    this.api = api;
    this.previews = previews;
    this.onChoose = onChoose;
    this.trees = [];  // descriptions of all loaded pages
    this.next = null;  // cursor after the last of them
    this.chosenId = null;
  }

  /** Requests the first page again; further pages that were loaded stay as they are. */
  async load() {
    const page = await this.api.trees();
    const fresh = new Set(page.trees.map((tree) => tree.id));
    const older = page.next ? this.trees.filter((tree) => !fresh.has(tree.id)) : [];
    this.trees = [...page.trees, ...older];
    if (older.length === 0) this.next = page.next;
    this.show();
  }

  async more() {
    const page = await this.api.trees(this.next);
    const known = new Set(this.trees.map((tree) => tree.id));
    this.trees.push(...page.trees.filter((tree) => !known.has(tree.id)));
    this.next = page.next;
    this.show();
  }

  choose(id) {
    this.chosenId = id;
    this.show();
  }

  remove(id) {
    this.trees = this.trees.filter((tree) => tree.id !== id);
    this.choose(null);
  }

  get isBuilding() {
    return this.trees.some((tree) => tree.state === 'building');
  }

  firstReady() {
    return this.trees.find((tree) => tree.state === 'ready');
  }

  show() {
    // Made anew only if something changed: elements that stay keep the focus and do not flicker.
    const facts = this.trees.map(({ id, state, progress }) => [id, nameOf(id), state, progress]);
    const signature = JSON.stringify([this.chosenId, this.next, facts]);
    if (signature === this.signature) return;
    this.signature = signature;
    byId('more').hidden = !this.next;
    const items = this.trees.map((tree) => this.item(tree));
    if (items.length === 0)
      items.push(element('li', { className: 'quiet', textContent: 'None yet.' }));
    const focused = document.activeElement?.dataset.tree;
    byId('trees').replaceChildren(...items);
    if (focused) byId('trees').querySelector(`[data-tree="${focused}"]`)?.focus();
  }

  item(tree) {
    const name = nameOf(tree.id);
    const facts = [
      tree.mesh.triangles === undefined
        ? bytesText(tree.mesh.bytes)
        : trianglesText(tree.mesh.triangles),
      tree.tree?.build,
    ];
    const title = { className: name ? 'name' : 'name id', textContent: name ?? shortId(tree.id) };
    const words = element(
      'span', { className: 'words' },
      element('span', title),
      element('span', { className: 'quiet', textContent: facts.filter(Boolean).join(' · ') }),
    );
    const button = element('button', { type: 'button', title: tree.id });
    button.append(this.previews.image(tree), words);
    if (tree.state === 'building')
      words.append(element('progress', { value: tree.progress, ariaLabel: 'Building' }));
    button.dataset.tree = tree.id;
    button.ariaCurrent = String(tree.id === this.chosenId);
    button.addEventListener('click', () => this.onChoose(tree.id));
    return element('li', {}, button);
  }
}
