// SPDX-License-Identifier: Apache-2.0
// The contract for people, where a plain link to /docs cannot carry a token; its examples can be
// changed and sent.
import { Api } from './api.js';
import { byId, element } from './dom.js';
import { ApiError } from './errors.js';
import { askForToken } from './token_dialog.js';

const api = new Api(() => askForToken(byId('token-dialog'), byId('token')), () => {});

async function show() {
  const response = await api.fetch('docs');
  // This page has the style as a file; inside the other it would break the policy of this one.
  const html = (await response.text()).replace(/<style>[^]*?<\/style>/, '');
  const page = new DOMParser().parseFromString(html, 'text/html');
  document.body.prepend(...page.body.childNodes);
  byId('state').hidden = true;
  const newest = await newestTree();
  for (const sample of document.querySelectorAll('pre.sample[data-url]')) addForm(sample, newest);
  // The browser looked for the anchor before it was there.
  if (location.hash) byId(decodeURIComponent(location.hash.slice(1)))?.scrollIntoView();
}

/** The id that the examples use; without a tree, the reader's to fill in. */
async function newestTree() {
  const { trees } = await api.trees();
  return trees[0]?.id ?? 'TREE';
}

/** A form that sends the example. It opens on demand, for the page is long. */
function addForm(sample, tree) {
  const { method, url, body } = sample.dataset;
  const address = element('input', { value: url.slice(1).replace('$TREE', tree), ariaLabel: 'Path and parameters' });
  const text = element('textarea', { value: body ?? '', rows: 3, ariaLabel: 'Body', hidden: body === undefined });
  const answer = element('div', { className: 'answer' });
  answer.setAttribute('role', 'status');
  const send = element('button', { type: 'button', textContent: `Send ${method}` });
  send.onclick = () => run(answer, method, address.value, body === undefined ? undefined : text.value);
  const details = element('details', { className: 'try' });
  details.append(element('summary', { textContent: 'Try it' }), address, text, send, answer);
  sample.after(details);
}

async function run(answer, method, path, body) {
  answer.replaceChildren('…');
  try {
    // The query stays as it is written, so the path goes without the client's own parameters.
    const headers = body === undefined ? {} : { 'Content-Type': 'application/json' };
    const response = await api.send(new URL(path, api.base), { method, body, headers });
    const lines = [`${response.status} ${response.statusText}`];
    response.headers.forEach((value, name) => lines.push(`${name}: ${value}`));
    answer.replaceChildren(element('pre', { textContent: lines.join('\n') }), await shown(response));
  } catch (error) {
    answer.replaceChildren(error.message);
  }
}

/** An answer's body as an element. */
async function shown(response) {
  const type = response.headers.get('Content-Type') ?? '';
  if (type.startsWith('image/')) {
    const image = element('img', { alt: 'The rendered picture', src: URL.createObjectURL(await response.blob()) });
    image.onload = () => URL.revokeObjectURL(image.src);
    return image;
  }
  if (/json|text/.test(type)) {
    const text = await response.text();
    return element('pre', { textContent: type.includes('json') ? pretty(text) : text });
  }
  return element('p', { textContent: `${(await response.blob()).size} bytes` });
}

function pretty(text) {
  try {
    return JSON.stringify(JSON.parse(text), null, 1);
  } catch {
    return text;
  }
}

show().catch((error) => {
  const reason = error instanceof ApiError ? `${error.code}: ${error.message}` : error.message;
  byId('state').textContent = `The contract cannot be shown. ${reason}`;
});
