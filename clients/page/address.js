// SPDX-License-Identifier: Apache-2.0
// The page's address: its fragment says all that is shown, and Back and Forward go through it.

const TREE_ID = /^[0-9a-f]{64}-[a-z0-9.-]{1,63}$/;

/** The values of a fragment; null if it names no tree. */
export function parseFragment(fragment) {
  const values = Object.fromEntries(new URLSearchParams(fragment.replace(/^#/, '')));
  return TREE_ID.test(values.tree ?? '') ? values : null;
}

/** Values as a fragment; null and undefined are left out. Commas stay readable. */
export function fragmentText(values) {
  const given = Object.entries(values).filter(([, value]) => value !== null && value !== undefined);
  return `#${new URLSearchParams(given).toString().replaceAll('%2C', ',')}`;
}

export class Address {
  /** @param onGo called with the values when Back, Forward or an edited address leads elsewhere */
  constructor(onGo) {
    addEventListener('popstate', () => {
      const values = parseFragment(location.hash);
      if (values) onGo(values);
    });
  }

  values() {
    return parseFragment(location.hash);
  }

  /** Says what is shown now; with `isStep`, Back returns to what was shown before. */
  write(values, { isStep = false } = {}) {
    const fragment = fragmentText(values);
    if (fragment === location.hash) return;
    if (isStep) history.pushState(null, '', fragment);
    else history.replaceState(null, '', fragment);
  }

  clear() {
    history.replaceState(null, '', location.pathname + location.search);
  }
}
