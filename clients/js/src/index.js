// SPDX-License-Identifier: Apache-2.0
// The package's interface; kdray.d.ts beside this folder describes it.
export { Client } from './client.js';
export { ConnectionError, KdrayError } from './errors.js';
export { plyOf } from './ply.js';
export { Tree } from './tree.js';
