// SPDX-License-Identifier: Apache-2.0
// What the page tells its user: short notes, problems, the loss of the server, and words for those
// who hear the page.
import { byId } from './dom.js';
import { errorDetails, errorName, isAbort } from './errors.js';

let toastTimer;

export function showToast(text) {
  byId('toast').textContent = text;
  byId('toast').hidden = false;
  clearTimeout(toastTimer);
  toastTimer = setTimeout(() => (byId('toast').hidden = true), 2200);
}

/** An ApiError or another error, until dismissed; null takes it away. */
export function showProblem(error) {
  byId('problem').hidden = !error;
  if (!error) return;
  byId('problem-code').textContent = errorName(error);
  byId('problem-detail').textContent = error.message;
  byId('problem-more').textContent = errorDetails(error);
}

/** Shows an error to the user, unless the page itself ended the request or the banner says it. */
export function report(error) {
  if (isAbort(error) || error.isOutage) return;
  showProblem(error);
}

/** A handler whose failure is shown instead of lost in the console. */
export const trying = (work) => async (...parameters) => {
  try {
    return await work(...parameters);
  } catch (error) {
    report(error);
    return undefined;
  }
};

/** The banner that is there as long as the server is not. */
export function showLost(isLost) {
  byId('lost').hidden = !isLost;
  if (isLost) showProblem(null);
}

/** For screen readers: what happened, once; not the numbers that change with every picture. */
export function announce(text) {
  byId('announcer').textContent = text;
}
