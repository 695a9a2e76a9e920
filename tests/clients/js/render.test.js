// SPDX-License-Identifier: Apache-2.0
// Pictures, arrays, scans and the trade-off, against a real daemon and brute force.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Client } from '../../../clients/js/src/index.js';
import { startDaemon } from './daemon.js';
import * as shapes from './shapes.js';

const mesh = shapes.sphere();
let daemon, client, tree;

before(async () => {
  daemon = await startDaemon();
  client = new Client(daemon.url);
  tree = await client.upload(mesh);
});
after(() => daemon.close());

const close = (actual, expected, bound = 1e-9) =>
  assert.ok(Math.abs(actual - expected) <= bound, `${actual} is not ${expected}`);
const vector = (array, i) => [...array.subarray(i * 3, i * 3 + 3)];

test('a render is a PNG of the size that was asked, and says how it was made', async () => {
  const picture = await tree.render({ width: 80, height: 60, fovDeg: 30, background: 'transparent' });
  const view = new DataView(picture.bytes.buffer);
  assert.deepEqual([...picture.bytes.subarray(1, 4)], [...'PNG'].map((c) => c.charCodeAt(0)));
  assert.deepEqual([view.getUint32(16), view.getUint32(20)], [80, 60]);
  assert.equal(picture.stopped, 'done');
  assert.ok(picture.samples >= 1);
  const blob = picture.blob();
  assert.deepEqual([blob.type, blob.size], ['image/png', picture.bytes.length]);
  assert.deepEqual((await tree.render({ width: 8, height: 8, mode: 'depth' })).depthRange.length, 2);
});

test('the address of a render leads to the same picture', async () => {
  const fields = { width: 40, height: 30, lights: [{ direction: Float32Array.of(0, -1, -1), intensity: 0.5 }] };
  const fetched = await fetch(tree.renderUrl({ ...fields, lights: [{ direction: [0, -1, -1], intensity: 0.5 }] }));
  assert.equal(fetched.status, 200);
  const direct = await tree.render({ ...fields, lights: [{ direction: [0, -1, -1], intensity: 0.5 }] });
  assert.deepEqual(new Uint8Array(await fetched.arrayBuffer()), direct.bytes);
});

test('arrays have the types and shapes of their modes', async () => {
  const size = { width: 12, height: 10 };
  const table = [['depth', Float32Array, [10, 12]], ['triangle', Int32Array, [10, 12]],
    ['normal', Float32Array, [10, 12, 3]], ['cost', Int32Array, [10, 12, 2]],
    ['shaded', Float32Array, [10, 12, 4]], ['position', Float64Array, [10, 12, 3]]];
  for (const [mode, type, shape] of table) {
    const image = await tree.renderArray({ ...size, mode });
    assert.ok(image.data instanceof type, mode);
    assert.deepEqual(image.shape, shape, mode);
    assert.equal(image.data.length, shape.reduce((a, b) => a * b), mode);
  }
});

test('a matrix camera sees the triangles that its rays hit', async () => {
  const [width, height, f] = [24, 18, 20];
  // World to camera, x right, y down, z forward: from (0, 0, 4), looking along -z, as typed array.
  const extrinsic = Float64Array.of(1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 4, 0, 0, 0, 1);
  const image = await tree.renderArray({
    mode: 'triangle', width, height, intrinsic: [f, f, width / 2, height / 2], extrinsic, precision: 'double' });
  for (let j = 0; j < height; ++j) {
    for (let i = 0; i < width; ++i) {
      const direction = [(i + 0.5 - width / 2) / f, -(j + 0.5 - height / 2) / f, -1];
      const [hit] = shapes.allHits(mesh, [0, 0, 4, ...direction]);
      assert.equal(image.data[j * width + i], hit?.triangle ?? -1, `pixel ${i}, ${j}`);
    }
  }
});

test('a scan has the points of the pixels that hit, and nothing else', async () => {
  const [eye, width, height] = [[3, 0.5, 0.25], 32, 16];
  const scan = await tree.scan({ eye, target: [0, 0, 0], up: [0, 0, 1], width, height, vFovDeg: 90, hFovDeg: 120 });
  const whole = await tree.renderArray({
    eye, target: [0, 0, 0], up: [0, 0, 1], width, height, vFovDeg: 90, hFovDeg: 120, projection: 'spherical', mode: 'position' });
  const pixels = Array.from({ length: width * height }, (_, i) => i).filter((i) => !Number.isNaN(whole.data[i * 3]));
  assert.ok(pixels.length > 20 && pixels.length < 400);
  assert.deepEqual([...scan.pixels], pixels);
  assert.equal(scan.points.length, scan.count * 3);
  pixels.forEach((pixel, i) => assert.deepEqual(vector(scan.points, i), vector(whole.data, pixel)));
  // Every point is on the mesh, in the direction of its pixel.
  const distances = await tree.closestPoints(scan.points, { fields: ['distance'] });
  assert.ok(distances.distance.every((distance) => distance < 1e-7));
});

test('beams at the elevations of a spherical image hit its points', async () => {
  const camera = { eye: [3, 0.5, 0.25], target: [0, 0, 0.25], up: [0, 0, 2] };
  const [width, height] = [64, 8];
  const scan = await tree.scan({ ...camera, width, height, vFovDeg: 40, precision: 'double' });
  const elevationsDeg = Array.from({ length: height }, (_, j) => (0.5 - (j + 0.5) / height) * 40);
  const beams = await tree.scanBeams({ ...camera, elevationsDeg, width, precision: 'double', batchRows: 100 });
  assert.equal(beams.count, scan.count);
  assert.deepEqual([...beams.beams].map((beam, i) => beam * width + beams.columns[i]), [...scan.pixels]);
  for (let i = 0; i < beams.count; ++i) {
    vector(beams.points, i).forEach((value, axis) => close(value, scan.points[i * 3 + axis], 1e-9));
    close(beams.ranges[i], Math.hypot(...shapes.minus(vector(beams.points, i), camera.eye)), 1e-9);
  }
  await assert.rejects(tree.scanBeams({ eye: [0, 0, 5], target: [0, 0, 0], up: [0, 0, 1], elevationsDeg: [0] }), RangeError);
  const toMiddle = await tree.scanBeams({ eye: [5, 0, 0], elevationsDeg: [0], hFovDeg: 1, width: 1 });
  close(toMiddle.ranges[0], shapes.allHits(mesh, [5, 0, 0, -1, 0, 0])[0].t, 1e-6);
});

test('an aborted signal ends a long render', async () => {
  const render = tree.render({ width: 4000, height: 4000, samples: 1024, mode: 'ambient-occlusion', signal: AbortSignal.timeout(100) });
  const start = performance.now();
  await assert.rejects(render, { name: 'TimeoutError' });
  assert.ok(performance.now() - start < 2000);
  assert.equal((await tree.any([[0, 0, 5, 0, 0, -1]])).values[0], 1); // the server goes on
});

test('the trade-off is measured with progress, and can be cancelled', async () => {
  const small = await client.upload({ vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces: [[0, 1, 2]] });
  await assert.rejects(small.tradeoff({ signal: AbortSignal.timeout(1) }), { name: 'TimeoutError' });
  const seen = [];
  const tradeoff = await small.tradeoff({ onProgress: (fraction) => seen.push(fraction) });
  assert.equal(tradeoff.mesh.triangles, 1);
  assert.ok(tradeoff.results.length >= 20);
  assert.ok(tradeoff.results.every((row) => row.random.rays_per_s > 0 && row.differences.count === 0));
  assert.equal(seen[seen.length - 1], 1);
});
