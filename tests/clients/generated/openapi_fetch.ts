// SPDX-License-Identifier: Apache-2.0
// openapi-fetch with the types of openapi-typescript: node openapi_fetch.js URL MESH
import { readFileSync } from 'node:fs';
import createClient from 'openapi-fetch';
import type { components, paths } from './schema';
import { check, pngSize, raysAsNpy } from './checks';

const [url, mesh] = process.argv.slice(2) as [string, string];
// It has only the types of the contract at hand, so it is told that lists have commas (explode: false).
const querySerializer = { array: { style: 'form', explode: false } } as const;
const client = createClient<paths>({ baseUrl: url, querySerializer });
const bytes = { bodySerializer: (body: unknown) => body as Blob };

async function main() {
  const uploaded = await client.POST('/v1/trees', {
    params: { query: { build: 'kd-median', wait_ms: 60000 } },
    body: new Blob([new Uint8Array(readFileSync(mesh))]),
    headers: { 'Content-Type': 'application/octet-stream' },
    ...bytes,
  });
  const tree = uploaded.data;
  if (!tree) throw new Error(uploaded.error.detail);
  const triangles: number | undefined = tree.mesh.triangles;
  check(triangles === 12, `${triangles} triangles`);
  const path = { id: tree.id };

  // Results are typed: a hit or null for each ray.
  const answer = await client.POST('/v1/trees/{id}/rays/closest', {
    params: { path, query: { fields: ['t', 'triangle', 'point'], t_min: 0, precision: 'exact' } },
    body: { rays: [[0, 0, 5, 0, 0, -1], [9, 9, 9, 0, 0, 1, 0, null]] },
  });
  const results = answer.data && 'results' in answer.data ? answer.data.results : [];
  const [hit, miss]: (components['schemas']['Hit'] | null)[] = results;
  check(hit?.t === 4 && hit.point?.[2] === 1 && miss === null, JSON.stringify(results));

  // The same as .npy, in and out.
  const array = await client.POST('/v1/trees/{id}/rays/any', {
    params: { path },
    body: raysAsNpy([0, 0, 5, 0, 0, -1]),
    headers: { 'Content-Type': 'application/x-npy' },
    parseAs: 'blob',
    ...bytes,
  });
  const any = new Uint8Array(await (array.data as Blob).arrayBuffer());
  check(any[any.length - 1] === 1, `any answered ${any.length} bytes`);

  const picture = await client.GET('/v1/trees/{id}/render.png', {
    params: { path, query: { width: 64, height: 48, eye: [3, 4, 5], background: 'transparent', color: [1, 0, 0] } },
    parseAs: 'blob',
  });
  check((await pngSize(picture.data)) === '64x48', 'GET render.png');
  // No field has to be there, only because it has a default.
  const lit = await client.POST('/v1/trees/{id}/render.png', {
    params: { path },
    body: { height: 32, lights: [{ direction: [0, -1, 0] }] },
    parseAs: 'blob',
  });
  check((await pngSize(lit.data)) === '640x32', 'POST render.png');

  const refused = await client.GET('/v1/trees/{id}/cells', { params: { path, query: { depth: 999 } } });
  const code: components['schemas']['ProblemCode'] | undefined = refused.error?.code;
  check(code === 'invalid_parameter', `code ${code}`);
  check((await client.DELETE('/v1/trees/{id}', { params: { path } })).response.status === 204, 'DELETE');
}

main();
