// SPDX-License-Identifier: Apache-2.0
// What the client does when answers are late, missing, broken or refusals: against a server of the
// test, which answers as told.
import assert from 'node:assert/strict';
import { createHash } from 'node:crypto';
import { getEventListeners } from 'node:events';
import { createServer } from 'node:http';
import { after, before, beforeEach, test } from 'node:test';
import { setTimeout as sleep } from 'node:timers/promises';
import { Client, ConnectionError, KdrayError, Tree } from '../../../clients/js/src/index.js';

const ID = `${'a'.repeat(64)}-auto`;
const LIMITS = { limits: { max_rays: 1000, max_pixels: 1e6, max_upload_bytes: 1e6 } };
let server, url, requests, answer;

before(async () => {
  server = createServer(async (request, response) => {
    const pieces = [];
    for await (const piece of request) pieces.push(piece);
    if (request.url === '/base/v1') return response.end(JSON.stringify(LIMITS));
    requests.push({ method: request.method, url: request.url, headers: request.headers, body: Buffer.concat(pieces) });
    await answer(request, response, requests.length, requests[requests.length - 1].body);
  });
  await new Promise((resolve) => server.listen(0, '127.0.0.1', resolve));
  url = `http://127.0.0.1:${server.address().port}/base`;
});
after(() => {
  server.closeAllConnections();
  server.close();
});
beforeEach(() => {
  requests = [];
});

const treeOf = (options) => new Tree(new Client(url, options), { id: ID, state: 'ready', progress: 1, mesh: {} });

/** An array of |b1: for each row of the body (6 doubles) whether its first number is odd. */
function oddness(body) {
  const start = 10 + body.readUInt16LE(8);
  const rows = (body.length - start) / 48;
  const header = `{'descr': '|b1', 'fortran_order': False, 'shape': (${rows},), }`.padEnd(117) + '\n';
  const values = Array.from({ length: rows }, (_, i) => body.readDoubleLE(start + i * 48) % 2);
  return Buffer.concat([Buffer.from('\x93NUMPY\x01\x00\x76\x00', 'latin1'), Buffer.from(header), Buffer.from(values)]);
}
const rows = (count) => Array.from({ length: count }, (_, i) => [i, 0, 0, 0, 0, 1]);
const odd = (count) => Array.from({ length: count }, (_, i) => i % 2);

function problem(response, status, code, headers = {}) {
  response.writeHead(status, { 'Content-Type': 'application/problem+json', ...headers });
  response.end(JSON.stringify({ status, code, title: code, detail: `why ${code}`, request_id: 'r-1' }));
}

test('answers that come in any order are put in the order of the rows', async () => {
  answer = async (request, response, number, body) => {
    await sleep(number % 2 ? 30 : 0);
    response.end(oddness(body));
  };
  const result = await treeOf({ parallel: 3 }).any(rows(100), { batchRows: 7 });
  assert.deepEqual([...result.values], odd(100));
  assert.equal(requests.length, 15);
});

test('no more requests than `parallel` are in flight', async () => {
  let [running, most] = [0, 0];
  answer = async (request, response, number, body) => {
    most = Math.max(most, ++running);
    await sleep(10);
    --running;
    response.end(oddness(body));
  };
  await treeOf({ parallel: 3 }).any(rows(40), { batchRows: 2 });
  assert.equal(most, 3);
});

test('a broken connection, a cut answer and 503 are tried again with the same body', async () => {
  answer = async (request, response, number, body) => {
    if (number === 1) return request.socket.destroy();
    if (number === 2) {
      response.writeHead(200, { 'Content-Length': 1000 });
      response.write('short');
      return setTimeout(() => request.socket.destroy(), 20);
    }
    if (number === 3) return problem(response, 503, 'overloaded', { 'Retry-After': '0' });
    if (number === 4) return problem(response, 409, 'tree_building');
    return response.end(oddness(body));
  };
  const result = await treeOf().any(rows(5));
  assert.deepEqual([...result.values], odd(5));
  assert.equal(requests.length, 5);
  for (const { body } of requests) assert.deepEqual(body, requests[0].body);
});

test('Retry-After is kept', async () => {
  answer = async (request, response, number, body) =>
    number === 1 ? problem(response, 503, 'memory_full', { 'Retry-After': '1' }) : response.end(oddness(body));
  const start = performance.now();
  await treeOf().any(rows(1));
  const passed = performance.now() - start;
  assert.ok(passed >= 990 && passed < 3000, `${passed} ms`);
});

test('refusals are not tried again, and deadline_exceeded neither', async () => {
  for (const [status, code] of [[400, 'invalid_parameter'], [404, 'tree_not_found'], [500, 'internal'],
    [504, 'deadline_exceeded'], [507, 'store_full'], [413, 'too_many_rays']]) {
    requests = [];
    answer = async (request, response) => problem(response, status, code);
    await assert.rejects(treeOf().any(rows(3)), { name: 'KdrayError', status, code, requestId: 'r-1', detail: `why ${code}` });
    assert.equal(requests.length, 1, code);
  }
});

test('after the last try the reason is the last one', async () => {
  answer = async (request, response) => problem(response, 503, 'draining', { 'Retry-After': '0' });
  await assert.rejects(treeOf({ retries: 2 }).any(rows(3)), { code: 'draining' });
  assert.equal(requests.length, 3);
  answer = async (request) => request.socket.destroy();
  await assert.rejects(treeOf({ retries: 1 }).any(rows(3)), (error) => {
    assert.ok(error instanceof ConnectionError);
    assert.match(error.message, /^no answer from http.*any: \w+/);
    return true;
  });
  await assert.rejects(new Client('http://127.0.0.1:1', { retries: 0 }).capabilities(), /ECONNREFUSED|bad port/);
});

test('repetitions keep the id of their request, and errors name it', async () => {
  answer = async (request, response, number, body) => {
    if (number === 1) return request.socket.destroy();
    if (number === 2) return problem(response, 503, 'overloaded', { 'Retry-After': '0' });
    response.end(oddness(body));
  };
  await treeOf().any(rows(3));
  await treeOf().any(rows(3));
  const ids = requests.map(({ headers }) => headers['x-request-id']);
  assert.match(ids[0], /^kdray-[0-9a-f]{12}$/);
  assert.deepEqual(ids.slice(0, 3), [ids[0], ids[0], ids[0]]);
  assert.notEqual(ids[3], ids[0]);
  answer = async (request) => request.socket.destroy();
  await assert.rejects(treeOf({ retries: 0 }).any(rows(3)), (error) => {
    assert.equal(error.requestId, requests.at(-1).headers['x-request-id']);
    return true;
  });
});

test('the trace of the caller goes with every request', async () => {
  const trace = '00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01';
  answer = async (request, response, number, body) => response.end(oddness(body));
  const seen = async (traceparent) => {
    requests = [];
    await treeOf({ traceparent }).any(rows(4), { batchRows: 2 });
    return requests.map(({ headers }) => headers.traceparent);
  };
  assert.deepEqual(await seen(undefined), [undefined, undefined]);
  assert.deepEqual(await seen(trace), [trace, trace]);
  assert.deepEqual(await seen(() => trace), [trace, trace]);
  assert.deepEqual(await seen(() => undefined), [undefined, undefined]);
  assert.deepEqual(await seen(() => 'what is no trace'), [undefined, undefined], 'tracing fails no request');
  for (const wrong of ['', '00-1-2-3', trace.toUpperCase(), `00-${'0'.repeat(32)}-${'1'.repeat(16)}-01`]) {
    assert.throws(() => new Client(url, { traceparent: wrong }), /traceparent .* is invalid/);
  }
});

test('the answer of a proxy that is not kdray has at least its status', async () => {
  answer = async (request, response) => {
    response.writeHead(404, { 'Content-Type': 'text/html' });
    response.end('<h1>nothing here</h1>');
  };
  await assert.rejects(treeOf().any(rows(1)), { status: 404, code: undefined, message: /HTTP 404/ });
  answer = async (request, response) => response.end('<h1>welcome</h1>');
  await assert.rejects(treeOf().any(rows(1)), /not a \.npy array/);
  await assert.rejects(treeOf().refresh(), /not JSON; is this kdrayd/);
});

test('malformed arrays are errors, not wrong numbers', async () => {
  const npy = (header, data = 0) => {
    const text = `${header.padEnd(117)}\n`;
    return Buffer.concat([Buffer.from('\x93NUMPY\x01\x00\x76\x00', 'latin1'), Buffer.from(text), Buffer.alloc(data)]);
  };
  for (const [header, bytes, message] of [
    ["{'descr': '|b1', 'fortran_order': False, 'shape': (3,), }", 2, /2 bytes of 3/],
    ["{'descr': '|b1', 'fortran_order': True, 'shape': (3,), }", 3, /C order/],
    ["{'descr': '>f4', 'fortran_order': False, 'shape': (3,), }", 12, />f4/],
    ["{'descr': '<c8', 'fortran_order': False, 'shape': (3,), }", 24, /<c8/],
    ["{'descr': '|b1', 'fortran_order': False, }", 3, /not readable/],
    ["{'descr': '|b1', 'fortran_order': False, 'shape': (2,), }", 2, /2 rows for 3/],
  ]) {
    answer = async (request, response) => response.end(npy(header, bytes));
    await assert.rejects(treeOf().any(rows(3)), message);
  }
});

test('the first failure of a batch ends its other requests and is thrown', async () => {
  let aborted = 0;
  answer = async (request, response, number) => {
    if (number === 3) return problem(response, 400, 'invalid_parameter');
    response.on('close', () => (aborted += response.writableEnded ? 0 : 1));
    return undefined; // never answered
  };
  await assert.rejects(treeOf({ parallel: 3 }).any(rows(30), { batchRows: 2 }), { code: 'invalid_parameter' });
  await sleep(50);
  assert.deepEqual([requests.length, aborted], [3, 2]);
});

test('an aborted signal ends a batch at once, with its reason', async () => {
  answer = async () => undefined; // never answered
  const reason = new Error('the user left');
  const abort = new AbortController();
  setTimeout(() => abort.abort(reason), 30);
  const start = performance.now();
  await assert.rejects(treeOf().any(rows(30), { batchRows: 2, signal: abort.signal }), (error) => error === reason);
  assert.ok(performance.now() - start < 1000);
  await assert.rejects(treeOf().any(rows(1), { signal: AbortSignal.abort(reason) }), (error) => error === reason);
  await assert.rejects(treeOf().any(rows(1), { signal: AbortSignal.timeout(20) }), { name: 'TimeoutError' });
});

test('an aborted signal does not wait for the limits of a silent server', async () => {
  const silent = createServer(() => {});
  await new Promise((resolve) => silent.listen(0, '127.0.0.1', resolve));
  const client = new Client(`http://127.0.0.1:${silent.address().port}`, { retries: 0 });
  const tree = new Tree(client, { id: ID, state: 'ready', progress: 1, mesh: {} });
  const start = performance.now();
  await assert.rejects(tree.any(rows(1), { signal: AbortSignal.timeout(30) }), { name: 'TimeoutError' });
  await assert.rejects(tree.visibility([], [], { signal: AbortSignal.timeout(30) }), { name: 'TimeoutError' });
  assert.ok(performance.now() - start < 2000);
  silent.closeAllConnections();
  silent.close();
});

test('an aborted signal ends the pause before another try', async () => {
  answer = async (request, response) => problem(response, 503, 'overloaded', { 'Retry-After': '9' });
  const start = performance.now();
  await assert.rejects(treeOf().any(rows(1), { signal: AbortSignal.timeout(50) }), { name: 'TimeoutError' });
  assert.ok(performance.now() - start < 2000);
});

test('many requests leave nothing on the signal that they share', async () => {
  answer = async (request, response, number, body) => response.end(oddness(body));
  const { signal } = new AbortController();
  const tree = treeOf();
  await tree.any(rows(150), { batchRows: 1, signal });
  await tree.any(rows(1), { signal });
  assert.equal(getEventListeners(signal, 'abort').length, 0);
});

test('an upload that breaks while it streams is sent again as a whole, with the digest of its bytes', async () => {
  const mesh = new Uint8Array(100_000).fill(0x20);
  const sha256 = createHash('sha256').update(mesh).digest();
  answer = async (request, response, number, body) => {
    if (request.method === 'GET') return problem(response, 404, 'tree_not_found');
    if (number === 2) return request.socket.destroy();
    return response.end(JSON.stringify({ id: ID, state: 'ready', progress: 1, mesh: {}, got: body.length }));
  };
  const seen = [];
  const tree = await new Client(url).upload(mesh, { onProgress: (progress) => seen.push(progress) });
  assert.equal(tree.description.got, mesh.length);
  const [asked, first, second] = requests;
  assert.equal(asked.url, `/base/v1/trees/${sha256.toString('hex')}-auto`);
  assert.deepEqual([first.headers['transfer-encoding'], second.headers['content-length']], ['chunked', '100000']);
  for (const { headers } of [first, second]) {
    assert.equal(headers['content-digest'], `sha-256=:${sha256.toString('base64')}:`);
  }
  assert.deepEqual(seen[seen.length - 2], { phase: 'upload', fraction: 1, loaded: 100_000, total: 100_000 });
});

test('a DELETE whose answer was lost has still succeeded', async () => {
  answer = async (request, response, number) =>
    number === 1 ? request.socket.destroy() : problem(response, 404, 'tree_not_found');
  await treeOf().delete();
  assert.equal(requests.length, 2);
});

test('options are the parameters of the contract, and absent ones are left out', async () => {
  answer = async (request, response, number, body) => response.end(oddness(body));
  await treeOf().any(rows(1), { tMin: 'auto', tMax: Infinity, deadlineMs: 50, cull: undefined });
  assert.equal(requests[0].url, `/base/v1/trees/${ID}/rays/any?t_min=auto&t_max=inf&deadline_ms=50`);
  assert.equal(requests[0].headers['content-type'], 'application/x-npy');
  const link = treeOf().renderUrl({ eye: [1, 2, 3], fovDeg: 1e21, lights: [{ direction: [0, 0, 1] }] });
  assert.equal(link.split('?')[1],
    'eye=1,2,3&fov_deg=1e%2B21&lights=%5B%7B%22direction%22%3A%5B0,0,1%5D%7D%5D');
});

test('invalid options of the client are refused', async () => {
  assert.throws(() => new Client('not a url'), TypeError);
  assert.throws(() => new Client(url, { parallel: 0 }), RangeError);
  await assert.rejects(treeOf().any(rows(1), { batchRows: 0.5 }), RangeError);
  assert.equal(new KdrayError(400, {}, null).message, 'HTTP 400: the answer gives no reason');
});
