// SPDX-License-Identifier: Apache-2.0
// Numbers and ids as people read them.

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

export function millisecondsText(ms) {
  if (!Number.isFinite(ms)) return '–';
  return ms < 1000 ? `${shortNumber(ms, 3)} ms` : `${shortNumber(ms / 1000, 3)} s`;
}

/** Whole seconds, or minutes and seconds: for times that are estimated. */
export function secondsText(seconds) {
  const whole = Math.max(1, Math.round(seconds));
  return whole < 60 ? `${whole} s` : `${Math.floor(whole / 60)} min ${whole % 60} s`;
}

/** 4,100,000 as "4.1 M". */
export function millionsText(number) {
  if (!Number.isFinite(number)) return '–';
  if (number >= 1e6) return `${shortNumber(number / 1e6, 3)} M`;
  return number >= 1e3 ? `${shortNumber(number / 1e3, 3)} k` : shortNumber(number, 3);
}

export const pointText = (point, digits = 4) =>
  point.map((x) => shortNumber(x, digits)).join(', ');

/** Twelve digits of the digest, then the build, as the kdray command shows ids. */
export const shortId = (id) => id.slice(0, 12) + id.slice(64);

/** A word as one argument of a POSIX shell. */
export const shellQuote = (word) => `'${word.replaceAll("'", `'\\''`)}'`;
