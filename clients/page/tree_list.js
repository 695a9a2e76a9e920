// The trees that the server has, newest first, page by page.
import { showTrees } from './panels.js';

export class TreeList {
  /** @param onChoose called with the id of a tree that was clicked */
  constructor(api, moreButton, onChoose) {
    this.api = api;
    this.moreButton = moreButton;
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

  firstReady() {
    return this.trees.find((tree) => tree.state === 'ready');
  }

  show() {
    this.moreButton.hidden = !this.next;
    showTrees(this.trees, this.chosenId, this.onChoose);
  }
}
