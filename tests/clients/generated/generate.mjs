// SPDX-License-Identifier: Apache-2.0
// Runs the generators: node generate.mjs OPENAPI.json OUTPUT
// The packages are those of the folder that it is started in.
import { createRequire } from 'node:module';
import { writeFile } from 'node:fs/promises';
import { join } from 'node:path';
import { pathToFileURL } from 'node:url';

const [document, output] = process.argv.slice(2);
const require = createRequire(join(process.cwd(), 'package.json'));
const load = async (name) => {
  const module = await import(pathToFileURL(require.resolve(name)));
  return module.default?.default ?? module;
};

// Types only, for openapi-fetch. Bodies of format binary are a Blob, as its documentation shows.
const { default: openapiTS, astToString } = await import(pathToFileURL(
  join(process.cwd(), 'node_modules/openapi-typescript/dist/index.mjs')));
const ts = (await load('typescript')).default;
const blob = ts.factory.createTypeReferenceNode('Blob');
const nodes = await openapiTS(pathToFileURL(document), {
  transform: (schema) => (schema.format === 'binary' ? blob : undefined),
});
await writeFile(join(output, 'schema.ts'), astToString(nodes));

// A client with a function for each operation.
const { createClient } = await import(pathToFileURL(require.resolve('@hey-api/openapi-ts')));
await createClient({
  input: document,
  output: join(output, 'hey'),
  plugins: ['@hey-api/typescript', '@hey-api/client-fetch', '@hey-api/sdk'],
  logs: { level: 'error' },
});
