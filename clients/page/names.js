// SPDX-License-Identifier: Apache-2.0
// The service identifies meshes by their hash. What this browser knows of them is kept here, in the
// browser: the names of their files, and whether their trade-off was measured.

const KEEP = 200;

export function rememberName(sha256, name) {
  remember('kdray-names', sha256, name);
}

/** The file's name, or null. */
export function nameOf(treeId) {
  const sha256 = treeId.slice(0, 64);
  return read('kdray-names').find(([known]) => known === sha256)?.[1] ?? null;
}

export function rememberMeasured(sha256, isMeasured) {
  remember('kdray-measured', sha256, isMeasured);
}

export function wasMeasured(sha256) {
  return read('kdray-measured').some(([known, isMeasured]) => known === sha256 && isMeasured);
}

function remember(key, sha256, value) {
  const pairs = read(key).filter(([known]) => known !== sha256);
  pairs.push([sha256, value]);
  try {
    localStorage.setItem(key, JSON.stringify(pairs.slice(-KEEP)));
  } catch {
    // Storage is full or switched off: trees are then shown by their id.
  }
}

function read(key) {
  try {
    const pairs = JSON.parse(localStorage.getItem(key));
    return Array.isArray(pairs) ? pairs : [];
  } catch {
    return [];
  }
}
