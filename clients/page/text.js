// Numbers and ids as people read them, and elements made of them.

const count = new Intl.NumberFormat('en');

export const countText = (number) => (Number.isFinite(number) ? count.format(number) : '–');

export const trianglesText = (number) =>
  number === 1 ? '1 triangle' : `${countText(number)} triangles`;

export function bytesText(bytes) {
  if (!Number.isFinite(bytes)) return '–';
  const units = ['B', 'KiB', 'MiB', 'GiB', 'TiB'];
  let unit = 0;
  for (; bytes >= 1000 && unit + 1 < units.length; ++unit) bytes /= 1024;
  return `${unit === 0 || bytes >= 100 ? Math.round(bytes) : bytes.toFixed(1)} ${units[unit]}`;
}

export const shortNumber = (number, digits = 4) =>
  Number.isFinite(number) ? String(Number(number.toPrecision(digits))) : '–';

export const millisecondsText = (ms) =>
  !Number.isFinite(ms) ? '–' : ms < 1000 ? `${shortNumber(ms, 3)} ms` : `${shortNumber(ms / 1000, 3)} s`;

export const pointText = (point, digits = 4) =>
  point.map((x) => shortNumber(x, digits)).join(', ');

/** Twelve digits of the digest, then the build, as the kdray command shows ids. */
export const shortId = (id) => id.slice(0, 12) + id.slice(64);

/** A word as one argument of a POSIX shell. */
export const shellQuote = (word) => `'${word.replaceAll("'", `'\\''`)}'`;

export function element(name, properties = {}, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

/** Fills a <dl> with pairs; those whose value is null or undefined are left out. */
export function fillFacts(list, pairs) {
  const rows = pairs.filter(([, value]) => value !== null && value !== undefined);
  list.replaceChildren(
    ...rows.flatMap(([name, value]) => [
      element('dt', { textContent: name }),
      element('dd', {}, value),
    ]),
  );
}
