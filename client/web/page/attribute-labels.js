/** What people read of attributes: titles in the language of the page, units, and what is hidden. */

import { strings } from './strings.js';

/**
 * The title in the language of the page, or in the first part of its code; `undefined` without one.
 * @param {Record<string, string>|undefined} titles
 * @returns {string|undefined}
 */
function inLanguage(titles) {
  const code = String(strings.language).toLowerCase();
  return titles?.[code] ?? titles?.[code.split('-')[0]];
}

/** The word of the page for what all objects have; other names are those of the source. */
function fieldTitle(name) {
  const { names } = strings.colors;
  return Object.hasOwn(names, name) ? names[name] : name;
}

/**
 * The title of a legend.
 * @param {import('./insula-viewer.js').Legend} legend
 * @returns {string}
 */
export function legendTitle({ title, titles, unit }) {
  const text = inLanguage(titles) ?? fieldTitle(title);
  return unit ? `${text} (${unit})` : text;
}

/** The labels of a city's attributes. */
export class AttributeLabels {
  /** @type {Map<string, import('./insula-viewer.js').AttributeLabel>} */ #labels;
  /** @type {Map<string, string>} */ #units;

  /** @param {import('./insula-viewer.js').Schema|null} schema `null` while it is not known. */
  constructor(schema) {
    const numbers = (schema?.attributes ?? []).filter(({ type }) => type === 'integer' || type === 'float');
    this.#labels = new Map(Object.entries(schema?.labels ?? {}));
    this.#units = new Map(numbers.flatMap(({ name, unit }) => (unit ? [[name, unit]] : [])));
  }

  /** What people read for a name. @param {string} name @returns {string} */
  title(name) {
    const label = this.#labels.get(name);
    return inLanguage(label?.titles) ?? label?.title ?? fieldTitle(name);
  }

  /** A value with its unit. @param {string} name @param {string|number|boolean} value @returns {string} */
  text(name, value) {
    const unit = this.#units.get(name);
    return unit ? `${value} ${unit}` : String(value);
  }

  /** Whether panels show it. @param {string} name @returns {boolean} */
  isShown(name) {
    return this.#labels.get(name)?.hidden !== true;
  }
}
