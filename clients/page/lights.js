// SPDX-License-Identifier: Apache-2.0
// Arrangements of lights, as the contract's `lights`. Those with a place in the world belong to the
// up axis; `sun` has a direction that the user chooses.
import { FRAMES, numberText } from './camera.js';
import { add, scale } from './vector.js';

const RADIANS = Math.PI / 180;

/** Azimuth from the front to the right, elevation, and intensity of the lights of the studio. */
const STUDIO = [
  [-40, 45, 0.85],
  [60, 15, 0.3],
  [170, 40, 0.45],
];
/** Besides the sun, so that shadows are not black: the same, with azimuths from the sun's. */
const SKY = [
  [180, 60, 0.25],
  [110, -35, 0.12],
];

export const LIGHTS = ['headlight', 'studio', 'sun'];

/**
 * The JSON text of a request's `lights`; null for the server's default, a headlight.
 * @param sun {azimuth, elevation} in degrees
 */
export function lightsText(name, upAxis, sun) {
  if (name === 'studio')
    return JSON.stringify(STUDIO.map((light) => directional(upAxis, ...light)));
  if (name !== 'sun') return null;
  return JSON.stringify([
    directional(upAxis, sun.azimuth, sun.elevation, 1),
    ...SKY.map(([turn, ...light]) => directional(upAxis, sun.azimuth + turn, ...light)),
  ]);
}

/** A light that comes from an azimuth and an elevation in degrees. */
function directional(upAxis, azimuth, elevation, intensity) {
  const { up, front, right } = FRAMES[upAxis];
  const a = azimuth * RADIANS;
  const e = elevation * RADIANS;
  const flat = add(scale(front, Math.cos(a)), scale(right, Math.sin(a)));
  const from = add(scale(flat, Math.cos(e)), scale(up, Math.sin(e)));
  return { direction: from.map((x) => Number(numberText(0 - x))), intensity };
}
