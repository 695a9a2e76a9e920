// SPDX-License-Identifier: Apache-2.0
// What kdray.d.ts declares is what clients/js/src has: the code's types must fit the declared ones.
// tsc checks it; nothing runs. The second part is what users write.
import type * as declared from '../../../clients/js/kdray.js';
import * as code from '../../../clients/js/src/index.js';

export const client: declared.Client = new code.Client('http://127.0.0.1:8080', { token: () => 'a' });
export const constructors: Pick<typeof declared, 'plyOf'> = code;

export async function use(tree: declared.Tree, file: File) {
  const progress = (seen: declared.Progress) => seen.fraction.toFixed(2);
  const own = await client.upload(file, { build: 'bvh', onProgress: progress });
  await client.upload({ vertices: new Float32Array(9), faces: [[0, 1, 2]] });

  const hits = await own.closest(new Float32Array(6), { tMin: 'auto', precision: 'exact' });
  const t: number = hits.t[0];
  const triangle: Int32Array = hits.triangle;
  // @ts-expect-error: not asked for
  hits.normal;
  const some = await own.closest([[0, 0, 1, 0, 0, -1]], { fields: ['normal', 'shadingNormal'] });
  const normal: Float32Array | Float64Array = some.normal;
  // @ts-expect-error: a typo
  await own.closest([], { precison: 'exact' });
  // @ts-expect-error: no such field
  await own.closest([], { fields: ['colour'] });

  const all = await own.all([], { maxHits: 3, fields: ['side'] });
  const inside: Int8Array = (await own.inside([[0, 0, 0]])).values;
  const sight: Uint8Array = (await own.visibility([[0, 0, 0]], new Float64Array(3))).visible;
  const picture = await own.render({ eye: [1, 2, 3], lights: [{ direction: [0, 0, 1] }], signal: AbortSignal.timeout(9) });
  const scan = await own.scanBeams({ eye: [0, 0, 0], elevationsDeg: [1, 2] });
  for await (const other of client.trees()) await other.delete();
  const tradeoff = await own.tradeoff({ onProgress: (fraction) => fraction });
  return [t, triangle, normal, all.ray, all.side, all.truncated, inside, sight, picture.blob(), scan.ranges,
    tradeoff.results[0].leaks?.rate];
}
