// SPDX-License-Identifier: Apache-2.0
// The client of @hey-api/openapi-ts: node hey_api.js URL MESH
import { readFileSync } from 'node:fs';
import * as kdray from './hey';
import { client } from './hey/client.gen';
import { check, pngSize, raysAsNpy } from './checks';

const [url, mesh] = process.argv.slice(2) as [string, string];
client.setConfig({ baseUrl: url });

async function main() {
  const { data: tree, error } = await kdray.postTree({
    body: new Blob([new Uint8Array(readFileSync(mesh))]),
    query: { build: 'bvh', wait_ms: 60000 },
  });
  if (!tree) throw new Error(error?.detail);
  check(tree.mesh.triangles === 12 && tree.tree?.build === 'bvh', JSON.stringify(tree));
  const path = { id: tree.id };

  const answer = await kdray.raysClosest({
    path,
    query: { fields: ['t', 'triangle', 'point'], precision: 'exact', t_max: 'inf' },
    body: { rays: [[0, 0, 5, 0, 0, -1], [9, 9, 9, 0, 0, 1]] },
  });
  const results = answer.data && 'results' in answer.data ? answer.data.results : [];
  const [hit, miss]: (kdray.Hit | null)[] = results;
  check(hit?.t === 4 && hit.point?.[2] === 1 && miss === null, JSON.stringify(results));

  // This generator knows one type of each body, JSON; .npy needs casts.
  const array = await kdray.raysAny({
    path,
    body: raysAsNpy([0, 0, 5, 0, 0, -1]) as unknown as kdray.Rays,
    headers: { 'Content-Type': 'application/x-npy' },
    bodySerializer: null,
    parseAs: 'blob',
  });
  const any = new Uint8Array(await (array.data as unknown as Blob).arrayBuffer());
  check(any[any.length - 1] === 1, `any answered ${any.length} bytes`);

  const picture = await kdray.getRenderPng({
    path,
    query: { width: 64, height: 48, eye: [3, 4, 5], background: 'transparent', color: [1, 0, 0] },
  });
  const png: Blob | File | undefined = picture.data;
  check((await pngSize(png)) === '64x48', 'GET render.png');
  const lit = await kdray.postRenderPng({ path, body: { height: 32, lights: [{ direction: [0, -1, 0] }] } });
  check((await pngSize(lit.data)) === '640x32', 'POST render.png');

  const refused = await kdray.getCells({ path, query: { depth: 999 } });
  const code: kdray.ProblemCode | undefined = refused.error?.code;
  check(code === 'invalid_parameter', `code ${code}`);
  check((await kdray.deleteTree({ path })).response?.status === 204, 'DELETE');
}

main();
