/** Tells screen readers what happened. */

import { element } from './dom.js';

const polite = element('div', { class: 'visually-hidden', role: 'status', 'aria-live': 'polite' });
const assertive = element('div', { class: 'visually-hidden', role: 'alert' });

/** The live regions, for the page. */
export const liveRegions = [polite, assertive];

/**
 * Announces a text after what is being said.
 * @param {string} text
 */
export function announce(text) {
  say(polite, text);
}

/**
 * Announces a text at once.
 * @param {string} text
 */
export function alarm(text) {
  say(assertive, text);
}

/** The same text twice is announced twice only if the region was empty in between. */
function say(region, text) {
  region.textContent = '';
  setTimeout(() => (region.textContent = text), 50);
}
