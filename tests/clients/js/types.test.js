// SPDX-License-Identifier: Apache-2.0
// kdray.d.ts names what the contract names: fields, enumerations, and the members of descriptions.
import assert from 'node:assert/strict';
import { readFile } from 'node:fs/promises';
import { after, before, test } from 'node:test';
import { startDaemon } from './daemon.js';

let daemon, contract, types;

before(async () => {
  daemon = await startDaemon();
  contract = await (await fetch(`${daemon.url}/openapi.json`)).json();
  types = (await readFile(new URL('../../../clients/js/kdray.d.ts', import.meta.url), 'utf8'))
    .replace(/\/\*\*[^]*?\*\//g, '');
});
after(() => daemon.close());

const camel = (name) => name.replace(/_([a-z])/g, (_, letter) => letter.toUpperCase());
const sorted = (names) => [...names].sort();
const declaration = (name) => new RegExp(`(?:interface|type) ${name}\\b[^{=]*[{=]([^]*?)\\n(?:\\}|(?=export))`).exec(types)[1];
/** The names of an interface's own members. */
const members = (name) => sorted(declaration(name).matchAll(/^ {2}(\w+)\??:/gm)).map((found) => found[1]).sort();
/** The texts of a union, in a member or in a whole type. */
const texts = (text) => sorted([...text.matchAll(/'([\w-]+)'/g)].map((found) => found[1]));
const memberTexts = (name, member) => texts(new RegExp(`\\b${member}\\?:([^;]*);`).exec(declaration(name))[1]);

const parametersOf = (path, method = 'post') =>
  contract.paths[path][method].parameters.map((parameter) =>
    parameter.$ref ? contract.components.parameters[parameter.$ref.split('/').pop()] : parameter);
const parameter = (path, name) => parametersOf(path).find((one) => one.name === name).schema;

test('RenderFields has every field of a render, with its values', () => {
  const fields = contract.components.schemas.RenderRequest.properties;
  assert.deepEqual(members('RenderFields'), sorted(Object.keys(fields).map(camel)));
  for (const name of ['projection', 'view', 'mode']) {
    assert.deepEqual(memberTexts('RenderFields', name), sorted(fields[name].enum), name);
  }
});

test('builds, precisions and fields of hits are those of the contract', () => {
  const { schemas } = contract.components;
  assert.deepEqual(texts(declaration('Build')), sorted(schemas.Build.enum));
  assert.deepEqual(texts(declaration('Precision')), sorted(schemas.Precision.enum));
  const rays = parameter('/v1/trees/{id}/rays/closest', 'fields').items.enum;
  assert.deepEqual(texts(declaration('RayField')), sorted(rays.map(camel)));
  assert.deepEqual(members('RayColumns'), sorted(rays.map(camel)));
  const points = parameter('/v1/trees/{id}/points/closest', 'fields').items.enum;
  assert.deepEqual(texts(declaration('PointField')), sorted(points.map(camel)));
  assert.deepEqual(members('PointColumns'), sorted(points.map(camel)));
});

test('options of queries are the parameters of the contract', () => {
  const options = (...names) => sorted(names.flatMap(members));
  const query = (path, others) => sorted([...others,
    ...parametersOf(path).map((one) => camel(one.name)).filter((name) => name !== 'id')]);
  const own = ['signal', 'batchRows'];
  assert.deepEqual(options('RayOptions', 'BatchOptions'), query('/v1/trees/{id}/rays/any', [...own, 'columns']));
  assert.deepEqual(options('PointOptions', 'BatchOptions'), query('/v1/trees/{id}/points/inside', own));
  // The client itself sends from_count; it needs no bits.
  assert.deepEqual(sorted([...members('VisibilityOptions'), 'fromCount', 'bits']),
    query('/v1/trees/{id}/visibility', own));
});

test('descriptions have the fields of the contract', () => {
  const { TreeDescription, Tradeoff, TradeoffRow, RayCost, ErrorRate, Cell, Light } = contract.components.schemas;
  const schemas = { TreeDescription, Tradeoff, TradeoffRow, RayCost, ErrorRate, Cell, Light };
  for (const [name, schema] of Object.entries(schemas)) {
    assert.deepEqual(members(name), sorted(Object.keys(schema.properties)), name);
  }
  const inner = (name) => [...declaration('TreeDescription').matchAll(new RegExp(`\\b${name}\\??:`, 'g'))].length;
  for (const part of ['mesh', 'tree']) {
    for (const field of Object.keys(TreeDescription.properties[part].properties)) assert.ok(inner(field), field);
  }
  for (const field of Object.keys(TreeDescription.properties.mesh.properties.health.properties)) {
    assert.ok(inner(field), field);
  }
});
