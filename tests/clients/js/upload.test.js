// SPDX-License-Identifier: Apache-2.0
// Uploads and the list of trees, against a real daemon.
import assert from 'node:assert/strict';
import { createHash } from 'node:crypto';
import { writeFile } from 'node:fs/promises';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { pathToFileURL } from 'node:url';
import { Client, KdrayError, plyOf } from '../../../clients/js/src/index.js';
import { startDaemon } from './daemon.js';
import * as shapes from './shapes.js';

const TOKEN = 'sesame-open-please-0123456789abcdef';
const mesh = shapes.sphere();
let daemon, client;

before(async () => {
  daemon = await startDaemon();
  client = new Client(daemon.url);
});
after(() => daemon.close());

const idOf = (bytes, build = 'auto') => `${createHash('sha256').update(bytes).digest('hex')}-${build}`;

/** A mesh that no other test uploads. */
const fresh = (name) => new TextEncoder().encode(`# ${name}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n`);

test('a mesh is a path, a file URL, a Blob, bytes, or arrays', async () => {
  const bytes = fresh('forms');
  const path = join(daemon.folder, 'forms.obj');
  await writeFile(path, bytes);
  const padded = new Uint8Array(bytes.length + 20);
  padded.set(bytes, 10);
  const forms = [path, pathToFileURL(path), new Blob([bytes]), bytes, Buffer.from(bytes),
    bytes.buffer.slice(0), padded.subarray(10, 10 + bytes.length)];
  for (const form of forms) assert.equal((await client.upload(form)).id, idOf(bytes));
  await assert.rejects(client.upload(join(daemon.folder, 'missing.obj')), { code: 'ENOENT' });
  await assert.rejects(client.upload(42), TypeError);
  await assert.rejects(client.upload({ vertices: [] }), TypeError);
});

test('arrays are stored without loss, as floats or as doubles', async () => {
  const tree = await client.upload(mesh);
  assert.equal(tree.id, idOf(plyOf(mesh.vertices, mesh.faces)));
  const { triangles, vertices, health, bounds } = tree.description.mesh;
  assert.deepEqual([triangles, vertices, health.closed], [mesh.faces.length, mesh.vertices.length, true]);
  assert.deepEqual(bounds.min[2], -1);
  const flat = { vertices: Float32Array.from(mesh.vertices.flat()), faces: Uint32Array.from(mesh.faces.flat()) };
  const floats = await client.upload(flat);
  assert.notEqual(floats.id, tree.id);
  assert.equal(floats.description.mesh.health.coordinate_resolution > health.coordinate_resolution, true);
  assert.deepEqual(await floats.mesh(), plyOf(flat.vertices, flat.faces));
  const far = mesh.vertices.length;
  assert.throws(() => plyOf(mesh.vertices, [[0, 1, far]]), /face 0 has the vertex/);
  assert.throws(() => plyOf(mesh.vertices, [[0, 1, 1.5]]), RangeError);
  assert.throws(() => plyOf(mesh.vertices, [[0, 1, -1]]), RangeError);
});

test('progress grows from 0 to 1, first of the upload, then of the build', async () => {
  const bytes = plyOf(...Object.values(shapes.sphere(200, 300)));
  const seen = [];
  const tree = await client.upload(bytes, { onProgress: (progress) => seen.push(progress) });
  assert.equal(tree.description.state, 'ready');
  const uploads = seen.filter(({ phase }) => phase === 'upload');
  assert.ok(uploads.length > 3, `${uploads.length} reports of ${bytes.length} bytes`);
  assert.deepEqual(uploads[0], { phase: 'upload', fraction: 0, loaded: 0, total: bytes.length });
  assert.equal(uploads[uploads.length - 1].fraction, 1);
  for (let i = 1; i < uploads.length; ++i) assert.ok(uploads[i].loaded >= uploads[i - 1].loaded);
  const builds = seen.slice(uploads.length);
  assert.ok(builds.every(({ phase }) => phase === 'build'));
  assert.equal(builds[builds.length - 1].fraction, 1);
});

test('a mesh that the server has is not sent again', async () => {
  const bytes = fresh('once');
  const methods = [];
  const counting = new Client(daemon.url, {
    fetch: (url, init) => {
      methods.push(init.method);
      return fetch(url, init);
    },
  });
  await counting.upload(bytes);
  assert.deepEqual(methods, ['GET', 'POST']);
  await counting.upload(bytes, { onProgress: () => {} });
  assert.deepEqual(methods, ['GET', 'POST', 'GET']);
});

test('another build of a mesh has its own tree and the same answers', async () => {
  const tree = await client.upload(mesh);
  const other = await client.rebuild(tree.description.mesh.sha256, 'kd-median');
  assert.ok(other.id.endsWith('-kd-median'));
  assert.equal(other.description.tree.build, 'kd-median');
  assert.equal((await client.upload(mesh, { build: 'kd-median' })).id, other.id);
  const rays = shapes.randomRays(100);
  assert.deepEqual(await other.closest(rays), await tree.closest(rays));
});

test('a mesh with an error is refused with the line, and may be tried again', async () => {
  const broken = new TextEncoder().encode('v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n');
  for (const options of [{}, { onProgress: () => {} }, {}]) {
    await assert.rejects(client.upload(broken, options), (error) => {
      assert.ok(error instanceof KdrayError);
      assert.deepEqual([error.status, error.code, error.line], [422, 'invalid_mesh', 4]);
      assert.match(error.message, /invalid_mesh: .*\(line 4\)/);
      return true;
    });
  }
});

test('a mesh above the limit is refused with the reason, streamed or not', async () => {
  const narrow = await startDaemon('--max-upload', '1KiB');
  try {
    for (const size of [5_000, 3_000_000]) {
      for (const options of [{}, { onProgress: () => {} }]) {
        const upload = new Client(narrow.url).upload(new Uint8Array(size).fill(0x20), options);
        await assert.rejects(upload, { status: 413, code: 'mesh_too_large' });
      }
    }
  } finally {
    await narrow.close();
  }
});

test('a token is sent with every request; without one the reason is unauthorized', async () => {
  const file = join(daemon.folder, 'token');
  await writeFile(file, `${TOKEN}\n`);
  const guarded = await startDaemon('--token-file', file);
  try {
    await assert.rejects(new Client(guarded.url).upload(mesh), { status: 401, code: 'unauthorized' });
    for (const token of [TOKEN, () => TOKEN, async () => TOKEN]) {
      const tree = await new Client(guarded.url, { token }).upload(mesh, { onProgress: () => {} });
      assert.equal((await tree.any([[0, 0, 5, 0, 0, -1]])).values[0], 1);
      assert.equal((await tree.render({ width: 8, height: 8 })).type, 'image/png');
    }
  } finally {
    await guarded.close();
  }
});

test('trees are listed page by page, described, and deleted', async () => {
  const own = await startDaemon();
  try {
    const lister = new Client(own.url, {
      fetch: (url, init) => fetch(String(url).replace(/trees\?/, 'trees?limit=2&').replace(/trees$/, 'trees?limit=2'), init),
    });
    const ids = [];
    for (let i = 0; i < 5; ++i) ids.unshift((await new Client(own.url).upload(fresh(`list ${i}`))).id);
    const listed = [];
    for await (const tree of lister.trees()) listed.push(tree.id);
    assert.deepEqual(listed, ids);
    const tree = await lister.tree(ids[2]);
    assert.equal((await tree.refresh()).description.state, 'ready');
    assert.equal((await tree.cells(0)).length, 1);
    await tree.delete();
    await assert.rejects(tree.delete(), { code: 'tree_not_found' });
    const mine = [];
    for await (const one of lister.trees({ mesh: ids[0].slice(0, 64) })) mine.push(one.id);
    assert.deepEqual(mine, [ids[0]]);
  } finally {
    await own.close();
  }
});
