// Elements made by hand. Whatever came from a file, a device or a person goes in as a text node:
// nothing is ever parsed as HTML.

function filled(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith('on')) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, '');
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children.flat(Infinity).filter(child => child !== null && child !== undefined && child !== false));
  return element;
}

export function make(tag, attributes = {}, ...children) {
  return filled(document.createElement(tag), attributes, children);
}

export function draw(tag, attributes = {}, ...children) {
  return filled(document.createElementNS('http://www.w3.org/2000/svg', tag), attributes, children);
}

export function card(title, ...children) {
  return make('section', {class: 'card'}, make('h2', {}, title), ...children);
}

// Pairs of a name and its value; what has no value is left out.
export function facts(pairs) {
  return make('dl', {}, pairs.filter(([, value]) => value !== null && value !== undefined && value !== '')
    .map(([name, value, unit]) => make('div', {}, make('dt', {}, name),
      make('dd', {}, String(value), unit ? make('small', {}, ' ' + unit) : null))));
}

// Rows of cells; a cell is text, a number (aligned right) or an element.
export function table(header, rows, label) {
  const cell = (value, i) => make('td', {class: typeof value === 'number' ? 'number' : null, 'data-column': header[i]},
    value instanceof Node ? value : String(value ?? ''));
  return make('table', {class: 'stack', 'aria-label': label},
    make('thead', {}, make('tr', {}, header.map(text => make('th', {scope: 'col'}, text)))),
    make('tbody', {}, rows.map(row => make('tr', {}, row.map(cell)))));
}

// Three significant digits, as a person reads them.
export function figure(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '\u2013';
  return value === 0 ? '0' : String(Number(value.toPrecision(digits)));
}

// Puts the children in place of the old ones, only where `key` has changed: what a person types,
// reads or presses is not taken away while nothing new is to be shown. The focus stays.
export function show(container, key, build) {
  const text = JSON.stringify(key);
  if (container.shownKey === text) return;
  container.shownKey = text;
  const targets = () => [...container.querySelectorAll('button, input, select, a')];
  const at = targets().indexOf(document.activeElement);
  container.replaceChildren(...[build()].flat(Infinity).filter(Boolean));
  if (at >= 0) targets()[at]?.focus();
}
