// SPDX-License-Identifier: Apache-2.0
// Small pictures of trees: requested one at a time, when they come into sight, and only while the
// large picture needs nothing.
import { OrbitCamera } from './camera.js';
import { element } from './dom.js';
import { guessUpAxis } from './up_axis.js';

const WIDTH = 96;
const HEIGHT = 72;
const AGAIN_MS = 200;

export class Previews {
  /** @param isIdle whether the server has nothing more urgent to do for this page */
  constructor(api, isIdle) {
    this.api = api;
    this.isIdle = isIdle;
    this.urls = new Map(); // by mesh: the builds of a mesh look the same
    this.waiting = []; // {tree, image}
    this.observer = new IntersectionObserver((entries) => this.seen(entries));
    this.trees = new WeakMap();
  }

  /** An element that fills itself; it says nothing that the words beside it do not say. */
  image(tree) {
    const size = { width: WIDTH / 2, height: HEIGHT / 2 };
    const image = element('img', { alt: '', ...size });
    const known = this.urls.get(tree.mesh.sha256);
    if (known) {
      image.src = known;
    } else if (tree.state === 'ready') {
      this.trees.set(image, tree);
      this.observer.observe(image);
    }
    return element('span', { className: 'preview' }, image);
  }

  seen(entries) {
    for (const { isIntersecting, target } of entries) {
      if (!isIntersecting) continue;
      this.observer.unobserve(target);
      this.waiting.push({ tree: this.trees.get(target), image: target });
    }
    this.work();
  }

  async work() {
    if (this.isWorking) return;
    this.isWorking = true;
    while (this.waiting.length > 0) {
      if (!this.isIdle()) {
        await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
        continue;
      }
      const { tree, image } = this.waiting.shift();
      if (image.isConnected) await this.fill(tree, image);
    }
    this.isWorking = false;
  }

  async fill(tree, image) {
    const { sha256 } = tree.mesh;
    try {
      if (!this.urls.has(sha256)) this.urls.set(sha256, await this.request(tree));
      image.src = this.urls.get(sha256);
    } catch {
      // A list without this picture is still a list; the problem shows when the tree is chosen.
    }
  }

  async request(tree) {
    const camera = new OrbitCamera();
    camera.upAxis = guessUpAxis(tree.mesh);
    camera.frame(tree.mesh.bounds.min, tree.mesh.bounds.max, WIDTH / HEIGHT);
    const size = { width: WIDTH, height: HEIGHT };
    const query = { ...camera.parameters(), ...size, background: 'transparent', samples: 8 };
    const { blob } = await this.api.render(tree.id, query, { priority: 'low' });
    return URL.createObjectURL(blob);
  }
}
