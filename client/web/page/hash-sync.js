/** Keeps the view in the location's hash: written when the view rests, followed when a link changes it. */

import { follow } from './events.js';
import { formatView, parseView } from './view-text.js';

/** The view rests when it has not changed for this time. Browsers limit how often a location may change. */
const REST_MS = 500;

/**
 * Connects the hash with the view.
 * @param {import('./page-context.js').PageContext} page
 */
export function syncHash(page) {
  let [shown, timer] = ['', 0];
  const rest = () => {
    history.replaceState(history.state, '', `#${shown}`);
    page.dispatchEvent(new Event('rest'));
  };
  follow(page.city, 'frame', () => {
    const view = formatView(page.view);
    if (view === shown) return;
    shown = view;
    clearTimeout(timer);
    timer = setTimeout(rest, REST_MS);
  });
  // replaceState does not cause this event.
  addEventListener('hashchange', () => page.open(parseView(location.hash)));
}
