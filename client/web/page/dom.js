/**
 * Small helpers around the DOM. Texts always become text nodes, so that nothing from outside is read as markup.
 */

const MAX_CHARS = 8192;

/**
 * Makes an element. Attributes that are functions become listeners, `true` and `false` set or omit an attribute.
 * @param {string} name
 * @param {Record<string, unknown>} [attributes]
 * @param {...(Node|string|null)} children
 * @returns {HTMLElement}
 */
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (typeof value === 'function') made.addEventListener(key, value);
    else if (value === true) made.setAttribute(key, '');
    else if (value !== false && value != null) made.setAttribute(key, String(value));
  }
  made.append(...children.filter((child) => child !== null));
  return made;
}

/**
 * Makes an SVG element with attributes.
 * @param {string} name
 * @param {Record<string, string|number>} [attributes]
 * @param {...Node} children
 * @returns {SVGElement}
 */
export function svg(name, attributes = {}, ...children) {
  const made = document.createElementNS('http://www.w3.org/2000/svg', name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, String(value));
  made.append(...children);
  return made;
}

/**
 * Text from a file or a server on one line, without control characters and without marks that change its direction.
 * @param {unknown} text
 * @returns {string}
 */
export function printable(text) {
  const unsafe = /[\u0000-\u001f\u007f-\u009f\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u2069\ufeff]+/g;
  return String(text ?? '').slice(0, MAX_CHARS).replace(unsafe, ' ').trim();
}

/**
 * Sets a text if it differs, so that unchanged texts cost no layout.
 * @param {Node} node
 * @param {string} text
 */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/**
 * An address if it is one of the web. Others, such as `javascript:`, must not become links.
 * @param {unknown} address
 * @returns {string|null}
 */
export function webAddress(address) {
  return /^https?:\/\//i.test(String(address ?? '')) ? String(address) : null;
}
