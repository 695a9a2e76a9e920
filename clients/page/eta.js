// SPDX-License-Identifier: Apache-2.0
// Percent and time left of something whose done part is known from time to time.
import { secondsText } from './text.js';

const TELLING_MS = 700; // before, the rate is a guess
const TELLING_PART = 0.02;

export class Eta {
  constructor(nowMs = performance.now()) {
    this.startMs = nowMs;
  }

  /** Estimated milliseconds to the end at the average rate so far; null if it is too early. */
  leftMs(part, nowMs = performance.now()) {
    const elapsedMs = nowMs - this.startMs;
    if (elapsedMs < TELLING_MS || !(part >= TELLING_PART)) return null;
    return (elapsedMs * (1 - Math.min(part, 1))) / part;
  }

  /** "42 % · 12 s left" */
  text(part, nowMs = performance.now()) {
    const percent = `${Math.floor(100 * Math.min(part, 1))} %`;
    const leftMs = this.leftMs(part, nowMs);
    return leftMs === null ? percent : `${percent} · ${secondsText(leftMs / 1000)} left`;
  }
}
