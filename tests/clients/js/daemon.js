// SPDX-License-Identifier: Apache-2.0
// The real kdrayd on a free port with a data directory of its own. $KDRAYD is the program.
import { spawn } from 'node:child_process';
import { mkdtemp, rm } from 'node:fs/promises';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { createInterface } from 'node:readline';

/** Options of the person who runs the tests must not reach the daemon under test. */
const environment = () =>
  Object.fromEntries(Object.entries(process.env).filter(([name]) => !name.startsWith('KDRAY_')));

export async function startDaemon(...options) {
  const folder = await mkdtemp(join(tmpdir(), 'kdray-js-'));
  const child = spawn(
    process.env.KDRAYD,
    ['--port', '0', '--data-dir', join(folder, 'data'), ...options],
    { env: environment(), stdio: ['ignore', 'pipe', 'ignore'] },
  );
  const ended = new Promise((resolve) => child.once('close', resolve));
  const close = async () => {
    child.kill();
    await ended;
    await rm(folder, { recursive: true, force: true });
  };
  for await (const line of createInterface({ input: child.stdout })) {
    const found = /listening on (http:\S+)/.exec(line);
    if (found) return { url: found[1], folder, close };
  }
  await close();
  throw new Error('kdrayd did not start');
}
