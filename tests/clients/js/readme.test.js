// SPDX-License-Identifier: Apache-2.0
// The example of the package's README, run as it is written.
import assert from 'node:assert/strict';
import { readFile, writeFile } from 'node:fs/promises';
import { join } from 'node:path';
import { test } from 'node:test';
import { pathToFileURL } from 'node:url';
import { plyOf } from '../../../clients/js/src/index.js';
import { startDaemon } from './daemon.js';
import * as shapes from './shapes.js';

const PACKAGE = new URL('../../../clients/js/', import.meta.url);

test('the example of the README uploads, casts a million rays and renders', async () => {
  const readme = await readFile(new URL('README.md', PACKAGE), 'utf8');
  const [, example] = /```js\n([^]*?)```/.exec(readme);
  const daemon = await startDaemon();
  try {
    const mesh = join(daemon.folder, 'sphere.ply');
    await writeFile(mesh, plyOf(...Object.values(shapes.sphere())));
    const saved = join(daemon.folder, 'teapot.png');
    const program = join(daemon.folder, 'example.mjs');
    await writeFile(program, `${example
      .replace("'kdray'", `'${new URL('src/index.js', PACKAGE)}'`)
      .replace('http://127.0.0.1:8080', daemon.url)
      .replace('teapot.ply', mesh)
      .replace('teapot.png', saved)
      .replace('console.log(phase, fraction)', 'seen.push(phase)')
      .replace('const client', 'const seen = [];\nconst client')}
      export { seen, t, triangle, precision, picture };`);
    const { seen, t, triangle, precision, picture } = await import(pathToFileURL(program));
    assert.deepEqual([...new Set(seen)], ['upload', 'build']);
    assert.deepEqual([t.length, triangle.length, precision], [1_000_000, 1_000_000, 'double']);
    assert.ok(t.every((distance) => distance > 8 && distance < 9)); // down onto a sphere of radius 1
    assert.ok(picture.bytes.length > 1000);
    assert.deepEqual(new Uint8Array(await readFile(saved)), picture.bytes);
  } finally {
    await daemon.close();
  }
});
