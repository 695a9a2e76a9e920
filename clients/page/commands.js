// SPDX-License-Identifier: Apache-2.0
// Text for the clipboard: links, and commands that repeat in a shell what the page just did.
import { rayBody, treePath } from './api.js';
import { element } from './dom.js';
import { showToast } from './notices.js';
import { shellQuote } from './text.js';

export function renderCommand(api, id, query) {
  return curl(api, ['-o', 'kdray.png', String(api.url(`${treePath(id)}/render.png`, query))]);
}

export function hitCommand(api, id, ray, query) {
  const url = String(api.url(`${treePath(id)}/rays/closest`, query));
  return curl(api, ['--data', rayBody(ray), url]);
}

// The token itself stays out of what is pasted into chats and tickets.
function curl(api, words) {
  const token = api.token ? ' -H "Authorization: Bearer $KDRAY_TOKEN"' : '';
  return `curl -sS${token} ${words.map(shellQuote).join(' ')}`;
}

export async function copyText(text, what) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    // Plain http on another host has no clipboard: the old way, by a selection.
    const area = element('textarea', { value: text });
    document.body.append(area);
    area.select();
    document.execCommand('copy');
    area.remove();
  }
  showToast(`${what} copied`);
}
