// SPDX-License-Identifier: Apache-2.0
// Ray and point queries against a real daemon; brute force over all triangles is the oracle.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Client, KdrayError } from '../../../clients/js/src/index.js';
import { startDaemon } from './daemon.js';
import * as shapes from './shapes.js';

const mesh = shapes.sphere();
const rays = shapes.randomRays(600);
const double = { precision: 'double' };
let daemon, client, tree;

before(async () => {
  daemon = await startDaemon();
  client = new Client(daemon.url);
  tree = await client.upload(mesh);
});
after(() => daemon.close());

const near = (actual, expected, bound = 1e-9) =>
  assert.ok(Math.abs(actual - expected) <= bound, `${actual} is not ${expected}`);

test('closest finds the hit that brute force finds, as doubles for lists of rows', async () => {
  const hits = await tree.closest(rays, { ...double, fields: ['t', 'triangle', 'u', 'v', 'side', 'point', 'normal'] });
  assert.equal(hits.count, rays.length);
  assert.ok(hits.t instanceof Float64Array && hits.triangle instanceof Int32Array);
  assert.equal(hits.precision, 'double');
  let found = 0;
  rays.forEach((ray, i) => {
    const [best] = shapes.allHits(mesh, ray);
    assert.equal(hits.triangle[i], best?.triangle ?? -1, `ray ${i}`);
    assert.equal(hits.side[i], best?.side ?? 0);
    if (!best) return assert.equal(hits.t[i], Infinity);
    ++found;
    near(hits.t[i], best.t);
    near(hits.u[i], best.u);
    near(hits.v[i], best.v);
    const point = shapes.plus(ray.slice(0, 3), ray.slice(3, 6), best.t);
    for (let axis = 0; axis < 3; ++axis) near(hits.point[i * 3 + axis], point[axis], 1e-8);
    near(Math.hypot(...hits.normal.subarray(i * 3, i * 3 + 3)), 1);
  });
  assert.ok(found > 100 && found < rays.length - 100, `${found} hits`);
});

test('floats are sent and answered as floats, unless dtype says otherwise', async () => {
  const floats = Float32Array.from(rays.flat());
  const hits = await tree.closest(floats);
  assert.ok(hits.t instanceof Float32Array);
  const wide = await tree.closest(floats, { dtype: 'f8' });
  assert.ok(wide.t instanceof Float64Array && wide.triangle instanceof Int32Array);
  assert.deepEqual(wide.triangle, hits.triangle);
  assert.deepEqual(Float32Array.from(wide.t), hits.t);
});

test('any, count and all agree with brute force', async () => {
  const options = { precision: 'exact' };
  const [any, count, all] = await Promise.all([
    tree.any(rays, options), tree.count(rays, options), tree.all(rays, options)]);
  assert.ok(any.values instanceof Uint8Array && count.values instanceof Uint32Array);
  let at = 0;
  rays.forEach((ray, i) => {
    const hits = shapes.allHits(mesh, ray);
    assert.equal(any.values[i], hits.length ? 1 : 0);
    assert.equal(count.values[i], hits.length);
    for (const hit of hits) {
      assert.equal(all.ray[at], i);
      assert.equal(all.triangle[at], hit.triangle);
      near(all.t[at++], hit.t);
    }
  });
  assert.equal(all.count, at);
  assert.equal(all.rays, rays.length);
  assert.equal(all.truncated, 0);
});

test('all keeps the nearest maxHits and says how many rows were cut', async () => {
  const all = await tree.all(rays, { maxHits: 1, fields: ['triangle'] });
  const closest = await tree.closest(rays, { precision: 'exact', fields: ['triangle'] });
  assert.deepEqual([...all.triangle], [...closest.triangle].filter((triangle) => triangle >= 0));
  const count = await tree.count(rays);
  assert.equal(all.truncated, count.values.filter((hits) => hits > 1).length);
});

test('a batch in many requests is the same as one request, in order', async () => {
  for (const options of [{ batchRows: 7 }, { batchRows: 599 }, { batchRows: 1 }]) {
    const few = rays.slice(0, options.batchRows === 1 ? 60 : rays.length);
    assert.deepEqual(await tree.closest(few, options), await tree.closest(few));
    assert.deepEqual(await tree.any(few, options), await tree.any(few));
    assert.deepEqual(await tree.all(few, options), await tree.all(few));
  }
});

test('rows of 8 columns have their own interval, as lists or flat', async () => {
  const bounded = rays.map((ray) => {
    const [best] = shapes.allHits(mesh, ray);
    return [...ray, best ? best.t + 1e-6 : 0, Infinity];
  });
  const expected = bounded.map((ray) => shapes.allHits(mesh, ray)[0]?.triangle ?? -1);
  const options = { ...double, fields: ['triangle'] };
  assert.deepEqual([...(await tree.closest(bounded, options)).triangle], expected);
  const flat = Float64Array.from(bounded.flat());
  assert.deepEqual([...(await tree.closest(flat, { ...options, columns: 8 })).triangle], expected);
});

test('tMin, tMax and cull choose which hits count', async () => {
  const down = [[0.1, 0.2, 5, 0, 0, -1]];
  const [front, back] = shapes.allHits(mesh, down[0]);
  const triangle = async (options) => (await tree.closest(down, options)).triangle[0];
  assert.equal(await triangle({}), front.triangle);
  assert.equal(await triangle({ tMin: front.t + 0.1 }), back.triangle);
  assert.equal(await triangle({ cull: 'front' }), back.triangle);
  assert.equal(await triangle({ tMax: front.t - 0.1 }), -1);
  assert.equal(await triangle({ tMax: Infinity, tMin: 0 }), front.triangle);
  assert.equal((await tree.closest(down, { tMin: 'auto' })).offset > 0, true);
  assert.equal((await tree.closest(down)).offset, undefined);
});

test('an invalid row is a miss with t NaN, and is counted over all requests', async () => {
  const some = [rays[0], [0, 0, 0, 0, 0, 0], rays[1], [NaN, 0, 0, 1, 0, 0], [0, 0, 9, 0, 0, -1]];
  const hits = await tree.closest(some, { batchRows: 2 });
  assert.equal(hits.invalid, 2);
  assert.deepEqual([hits.triangle[1], hits.triangle[3]], [-1, -1]);
  assert.ok(Number.isNaN(hits.t[1]) && Number.isNaN(hits.t[3]) && hits.triangle[4] >= 0);
});

test('an empty batch has empty columns of the right types', async () => {
  const hits = await tree.closest([]);
  assert.deepEqual([hits.count, hits.t.length, hits.triangle.length], [0, 0, 0]);
  assert.ok((await tree.closest(new Float32Array())).t instanceof Float32Array);
  assert.equal((await tree.any([])).values.length, 0);
  assert.equal((await tree.all([])).ray.length, 0);
  assert.equal((await tree.inside([])).values.length, 0);
  assert.equal((await tree.visibility([], [])).visible.length, 0);
});

test('one field alone is a column too, also of vectors', async () => {
  for (const field of ['t', 'triangle', 'point', 'normal', 'side']) {
    const alone = await tree.closest(rays, { fields: [field], batchRows: 100 });
    const both = await tree.closest(rays, { fields: ['u', field] });
    assert.deepEqual(alone[field], both[field], field);
    assert.equal('u' in alone, false);
  }
  const text = await tree.closest(rays, { fields: 't,side' });
  assert.deepEqual([text.t.length, text.side.length], [rays.length, rays.length]);
});

test('closest points and signed distances agree with brute force', async () => {
  const points = shapes.randomPoints(200, 1.6);
  const nearest = await tree.closestPoints(points);
  const signed = await tree.signedDistance(points, { batchRows: 30 });
  const inside = await tree.inside(points);
  assert.ok(inside.values instanceof Int8Array);
  points.forEach((point, i) => {
    const distance = shapes.distanceTo(mesh, point);
    near(nearest.distance[i], distance);
    near(Math.hypot(...shapes.minus(point, [...nearest.point.subarray(i * 3, i * 3 + 3)])), distance);
    const isInside = shapes.allHits(mesh, [...point, 0.3, 0.5, 0.7]).length % 2;
    assert.equal(inside.values[i], isInside);
    near(signed.values[i], isInside ? -distance : distance);
  });
  assert.equal(signed.count, points.length);
});

test('visibility agrees with segments against all triangles, however it is split', async () => {
  const from = shapes.randomPoints(13, 2);
  const to = shapes.randomPoints(17, 2, shapes.makeRandom(7));
  const expected = from.flatMap((a) => to.map((b) => {
    return shapes.allHits(mesh, [...a, ...shapes.minus(b, a), 0, 1]).length ? 0 : 1;
  }));
  for (const batchRows of [undefined, 1, 5, 17, 40]) {
    const sight = await tree.visibility(from, to, { precision: 'double', batchRows });
    assert.deepEqual([...sight.visible], expected, `batchRows ${batchRows}`);
    assert.deepEqual([sight.from, sight.to, sight.precision], [13, 17, 'double']);
  }
  const sky = await tree.visibility(from, [[0, 0, 1], [0, 0, 0]], { toDirections: true, batchRows: 3 });
  assert.equal(sky.invalid, 1);
  from.forEach((point, i) => {
    assert.equal(sky.visible[i * 2], shapes.allHits(mesh, [...point, 0, 0, 1]).length ? 0 : 1);
  });
  assert.equal((await tree.visibility([[NaN, 0, 0]], Float32Array.of(0, 0, 9))).invalid, 1);
});

test('every refusal has the reason of the server', async () => {
  const refused = async (promise, code, parameter, pattern) => {
    await assert.rejects(promise, (error) => {
      assert.ok(error instanceof KdrayError, String(error));
      assert.equal(error.code, code);
      assert.equal(error.parameter, parameter);
      assert.match(error.message, pattern);
      assert.ok(error.requestId);
      return true;
    });
  };
  await refused(tree.closest(rays, { precison: 'exact' }), 'invalid_parameter', 'precison', /precision/);
  await refused(tree.closest(rays, { fields: ['t', 'colour'] }), 'invalid_parameter', 'fields', /colour/);
  await refused(tree.render({ width: 0 }), 'invalid_parameter', '/width', /width/);
  await refused(client.tree(`${'0'.repeat(64)}-auto`), 'tree_not_found', undefined, /tree/);
});

test('arguments that are not rows are refused before anything is sent', async () => {
  const silent = new Client('http://127.0.0.1:9', { retries: 0 });
  const { Tree } = await import('../../../clients/js/src/index.js');
  const nowhere = new Tree(silent, tree.description);
  await assert.rejects(nowhere.closest(new Float32Array(7)), RangeError);
  await assert.rejects(nowhere.closest([[1, 2, 3]]), /row 0 of rays has 3 columns; allowed are 6 or 8/);
  await assert.rejects(nowhere.closest([rays[0], [1]]), /row 1 of rays has 1 columns/);
  await assert.rejects(nowhere.closest([[0, 0, 0, 0, null, 1]]), TypeError);
  await assert.rejects(nowhere.closest('rays'), TypeError);
  await assert.rejects(nowhere.closest(undefined), TypeError);
  await assert.rejects(nowhere.inside([[1, 2]]), RangeError);
  await assert.rejects(nowhere.closest(rays, { columns: 7 }), RangeError);
});

test('the server\'s max_rays bounds each request, not the batch', async () => {
  const narrow = await startDaemon('--max-rays', '50');
  try {
    const small = await new Client(narrow.url).upload(mesh);
    assert.deepEqual(await small.closest(rays), await tree.closest(rays));
    const [from, to] = [shapes.randomPoints(9, 2), shapes.randomPoints(60, 2)];
    assert.deepEqual(await small.visibility(from, to), await tree.visibility(from, to));
  } finally {
    await narrow.close();
  }
});
