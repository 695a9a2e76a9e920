// The service identifies meshes by their hash. The names of files uploaded from this browser are
// kept here, in the browser.

const KEY = 'kdray-names';
const KEEP = 200;

export function rememberName(sha256, name) {
  const names = read().filter(([known]) => known !== sha256);
  names.push([sha256, name]);
  try {
    localStorage.setItem(KEY, JSON.stringify(names.slice(-KEEP)));
  } catch {
    // Storage is full or switched off: trees are then shown by their id.
  }
}

/** The file's name, or null. */
export function nameOf(treeId) {
  const sha256 = treeId.slice(0, 64);
  return read().find(([known]) => known === sha256)?.[1] ?? null;
}

function read() {
  try {
    const names = JSON.parse(localStorage.getItem(KEY));
    return Array.isArray(names) ? names : [];
  } catch {
    return [];
  }
}
