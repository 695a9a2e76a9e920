// SPDX-License-Identifier: Apache-2.0
// The panel of the trade-off between speed and accuracy on the chosen mesh: measuring, its
// progress, the result.
import { byId, fillTable } from './dom.js';
import { isAbort } from './errors.js';
import { Eta } from './eta.js';
import { rememberMeasured, wasMeasured } from './names.js';
import { announce } from './notices.js';
import { millionsText, millisecondsText } from './text.js';
import { ACCURACIES, showPlot } from './tradeoff_plot.js';

const POLL_MS = 500;

export class TradeoffPanel {
  /**
   * @param onError called with what a request threw
   * @param onChange called when there is a result, or none any more
   */
  constructor(api, { onError, onChange }) {
    this.api = api;
    this.onError = onError;
    this.onChange = onChange;
    this.tree = null;
    this.result = null;
    const run = (work) => () => this.run(work);
    for (const id of ['measure', 'measure-again'])
      byId(id).addEventListener('click', run((signal) => this.measure(signal)));
    byId('look').addEventListener('click', run((signal) => this.follow(signal)));
    byId('stop').addEventListener('click', run(() => this.forget()));
    byId('accuracy').addEventListener('change', () => this.showResult());
    for (const [name, { words }] of Object.entries(ACCURACIES))
      byId('accuracy').add(new Option(words, name));
  }

  /** Shows what is known of this tree's mesh. Asks the server only if a result is likely there. */
  choose(tree, { isLikely = false } = {}) {
    const isSame = tree?.mesh.sha256 === this.tree?.mesh.sha256;
    this.tree = tree;
    if (isSame) return;
    this.abort?.abort();
    this.showState('unknown');
    if (tree && (isLikely || wasMeasured(tree.mesh.sha256)))
      this.run((signal) => this.follow(signal));
  }

  /** Runs one piece of work instead of the one before. */
  async run(work) {
    this.abort?.abort();
    this.abort = new AbortController();
    try {
      await work(this.abort.signal);
    } catch (error) {
      if (isAbort(error)) return;
      this.showState('unknown');
      if (error.code === 'not_measured') {
        rememberMeasured(this.tree.mesh.sha256, false);
        byId('tradeoff-words').textContent = 'This mesh has not been measured yet.';
      } else {
        this.onError(error);
      }
    }
  }

  async measure(signal) {
    this.showProgress(new Eta(), 0);
    await this.api.measureTradeoff(this.tree.id, signal);
    await this.follow(signal);
  }

  /** Waits for the end of the measurement. */
  async follow(signal) {
    const eta = new Eta();
    let firstPart = null;
    for (;;) {
      const answer = await this.api.tradeoff(this.tree.id, POLL_MS, signal);
      rememberMeasured(this.tree.mesh.sha256, true);
      if (answer.state === 'measured') {
        this.result = answer;
        this.showResult();
        if (firstPart !== null) announce('The trade-off is measured');
        return;
      }
      // Joined half-way, the part that was done before says nothing of the time.
      firstPart ??= answer.progress;
      this.showProgress(eta, answer.progress);
    }
  }

  async forget() {
    await this.api.forgetTradeoff(this.tree.id);
    rememberMeasured(this.tree.mesh.sha256, false);
    this.showState('unknown');
  }

  showState(state) {
    if (state !== 'measured') this.result = null;
    byId('tradeoff-start').hidden = state !== 'unknown';
    byId('tradeoff-progress').hidden = state !== 'measuring';
    byId('tradeoff-result').hidden = state !== 'measured';
    byId('tradeoff-words').textContent = '';
    this.onChange();
  }

  showProgress(eta, part) {
    if (byId('tradeoff-progress').hidden) this.showState('measuring');
    byId('tradeoff-bar').value = part;
    byId('tradeoff-part').textContent = eta.text(part);
  }

  showResult() {
    this.showState('measured');
    const { results, conditions } = this.result;
    const accuracy = byId('accuracy').value;
    showPlot(byId('tradeoff-plot'), results, accuracy);
    fillTable(
      byId('tradeoff-table'),
      ['Tree', 'Random/s', 'Aimed/s', 'Leaks', 'Error of t'],
      results.map((row) => [
        `${row.build} ${row.precision}`,
        millionsText(row.random.rays_per_s),
        millionsText(row.aimed.rays_per_s),
        row.leaks ? String(row.leaks.count) : '–',
        row.t_error.p999 === 0 ? '0' : row.t_error.p999.toExponential(1),
      ]),
    );
    const disturbed = conditions.disturbed_runs;
    byId('tradeoff-conditions').textContent =
      `${conditions.threads} threads, ${millisecondsText(conditions.total_ms)}` +
      (disturbed > 0 ? `, ${disturbed} of ${conditions.runs} runs disturbed` : '');
  }
}
