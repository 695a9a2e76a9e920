// SPDX-License-Identifier: Apache-2.0
// Notices that the server is gone, and when it is back.

const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 5000;

export class Connection {
  /**
   * @param url what to ask: any answer that is a success means that the server is back
   * @param onChange called with true when the server is lost, false when it is back
   */
  constructor(url, onChange) {
    this.url = url;
    this.returned = null; // a promise while the server is lost
    this.onChange = onChange;
    this.isLost = false;
    this.returned = null;
  }

  /** To be called when a request had no answer. */
  lost() {
    if (this.isLost) return;
    this.isLost = true;
    this.onChange(true);
    this.returned = this.waitForReturn();
  }

  /** Resolves when the server is there, or back. */
  async back() {
    await this.returned;
  }

  async waitForReturn() {
    for (let waitMs = FIRST_WAIT_MS; ; waitMs = Math.min(2 * waitMs, LONGEST_WAIT_MS)) {
      await new Promise((resolve) => setTimeout(resolve, waitMs));
      const answer = await fetch(this.url, { cache: 'no-store' }).catch(() => null);
      if (answer?.ok) break;
    }
    this.isLost = false;
    this.onChange(false);
  }
}
