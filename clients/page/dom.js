// SPDX-License-Identifier: Apache-2.0
// Elements: finding them, making them, filling lists of facts and tables.

const SVG = 'http://www.w3.org/2000/svg';

export const byId = (id) => document.getElementById(id);

export function element(name, properties = {}, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

/** An SVG element; `class` and all others are attributes. */
export function svg(name, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

/** Fills a <dl> with pairs; those whose value is null or undefined are left out. */
export function fillFacts(list, pairs) {
  const rows = pairs.filter(([, value]) => value !== null && value !== undefined);
  list.replaceChildren(
    ...rows.flatMap(([name, value]) => [
      element('dt', { textContent: name }),
      element('dd', {}, value),
    ]),
  );
}

/** Fills a <table>; cells are texts or elements. The first cell of a row is its heading. */
export function fillTable(table, headings, rows) {
  const head = element(
    'tr', {}, ...headings.map((text) => element('th', { scope: 'col', textContent: text })),
  );
  const body = rows.map(([first, ...rest]) =>
    element(
      'tr', {}, element('th', { scope: 'row' }, first),
      ...rest.map((cell) => element('td', {}, cell)),
    ),
  );
  table.replaceChildren(element('thead', {}, head), element('tbody', {}, ...body));
}

/** Adds an <option> for each name. */
export function addOptions(select, names) {
  select.append(...names.map((name) => element('option', { value: name, textContent: name })));
}

/** Chooses an existing option; false for other values. */
export function chooseOption(select, value) {
  const has = [...select.options].some((option) => option.value === value);
  if (has) select.value = value;
  return has;
}

/** Saves a blob as a file. */
export function saveBlob(blob, name) {
  const href = URL.createObjectURL(blob);
  element('a', { href, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(href), 60000);
}
