// SPDX-License-Identifier: Apache-2.0
// The card of one upload: what happens, how far it is, and what went wrong.
import { element } from './dom.js';
import { errorDetails, errorName } from './errors.js';
import { Eta } from './eta.js';

export class UploadCard {
  /** @param onAgain called when a failed upload is to be tried again */
  constructor(list, file, onAgain) {
    this.file = file;
    this.onAgain = onAgain;
    this.abort = new AbortController();
    this.text = element('span', { className: 'quiet', textContent: 'waiting' });
    this.bar = element('progress', { ariaLabel: `Progress of ${file.name}` });
    this.close = this.button(`Stop ${file.name}`, '×', () => this.stop());
    this.item = element(
      'li', {}, element('span', { className: 'name', textContent: file.name }), this.text, this.bar,
      this.close,
    );
    list.append(this.item);
  }

  get signal() {
    return this.abort.signal;
  }

  stop() {
    this.abort.abort();
    this.remove(); // also one that still waits for its turn
  }

  button(label, textContent, onClick) {
    const words = { ariaLabel: label, title: label, textContent };
    const button = element('button', { type: 'button', ...words });
    button.addEventListener('click', onClick);
    return button;
  }

  /** The bar shows activity only. */
  words(text) {
    this.text.textContent = text;
    this.bar.removeAttribute('value');
  }

  begin(what) {
    this.what = what;
    this.eta = new Eta();
    this.progress(0);
  }

  progress(part) {
    this.text.textContent = `${this.what} · ${this.eta.text(part)}`;
    this.bar.value = part;
  }

  fail(error) {
    this.bar.remove();
    this.item.className = 'failed';
    this.text.textContent = `${errorName(error)}: ${error.message}`;
    this.item.append(element('small', { textContent: errorDetails(error) }));
    this.close.ariaLabel = this.close.title = 'Dismiss';
    // What is wrong with the file stays wrong.
    if (error.status && !error.retryAfterMs) return;
    const again = this.button(`Try ${this.file.name} again`, 'Try again', () => {
      this.remove();
      this.onAgain();
    });
    again.className = 'again';
    this.item.append(again);
  }

  remove() {
    this.item.remove();
  }
}
