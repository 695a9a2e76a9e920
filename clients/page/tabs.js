// SPDX-License-Identifier: Apache-2.0
// Tabs by the pattern of the ARIA Authoring Practices: arrows move between them, and one panel is
// shown.

export class Tabs {
  /** @param onChosen called with the name of a tab that the user chose: its data-tab */
  constructor(list, onChosen) {
    this.tabs = [...list.querySelectorAll('[role="tab"]')];
    this.onChosen = onChosen;
    for (const tab of this.tabs) tab.addEventListener('click', () => this.pick(tab));
    list.addEventListener('keydown', (event) => this.key(event));
    this.show(this.tabs[0].dataset.tab);
  }

  get chosen() {
    return this.tabs.find((tab) => tab.ariaSelected === 'true').dataset.tab;
  }

  /** Unknown names change nothing. */
  show(name) {
    if (!this.tabs.some((tab) => tab.dataset.tab === name)) return;
    for (const tab of this.tabs) {
      const isChosen = tab.dataset.tab === name;
      tab.ariaSelected = String(isChosen);
      tab.tabIndex = isChosen ? 0 : -1;
      document.getElementById(tab.getAttribute('aria-controls')).hidden = !isChosen;
    }
  }

  pick(tab) {
    this.show(tab.dataset.tab);
    tab.focus();
    this.onChosen(tab.dataset.tab);
  }

  key(event) {
    const last = this.tabs.length - 1;
    const now = this.tabs.indexOf(document.activeElement);
    const next = {
      ArrowRight: now === last ? 0 : now + 1,
      ArrowLeft: now <= 0 ? last : now - 1,
      Home: 0,
      End: last,
    }[event.key];
    if (next === undefined) return;
    event.preventDefault();
    this.pick(this.tabs[next]);
  }
}
