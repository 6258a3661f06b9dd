/** The sources that must be named wherever a city is shown. */

import { element, printable, webAddress } from './dom.js';

/**
 * The sources of a city as lines of plain text, for captions.
 * @param {object|null} manifest
 * @returns {string[]}
 */
export function attributionLines(manifest) {
  const sources = Array.isArray(manifest?.attribution) ? manifest.attribution : [];
  return sources.map(({ text, licence }) => {
    const name = printable(text);
    return licence ? `${name} (${printable(licence)})` : name;
  });
}

/**
 * The sources of a city as nodes with links, separated by commas.
 * @param {object|null} manifest
 * @returns {Node[]}
 */
export function attributionNodes(manifest) {
  return attributionLines(manifest).flatMap((line, i) => {
    const href = webAddress(manifest.attribution[i].url);
    const link = { href, rel: 'noopener noreferrer', target: '_blank' };
    const node = element('bdi', {}, href ? element('a', link, line) : line);
    return i === 0 ? [node] : [document.createTextNode(', '), node];
  });
}
