/** Keys of the page: they open panels and do what the toolbar does. Keys of the view belong to the element. */

import { PAGE_KEYS, codeOf, isTaken } from './key-table.js';
import { load, save } from './storage.js';

const KEY = 'single-keys';

/** Whether keys act wherever the focus is, or only while the city has it. @returns {boolean} */
export function hasSingleKeys() {
  return load(KEY, true) === true;
}

/**
 * Listens for keys.
 * @param {import('./insula-city.js').InsulaCity} city
 * @param {Record<string, () => void>} actions By the names of PAGE_KEYS.
 * @returns {{set: (singleKeys: boolean) => void}}
 */
export function listenForPageKeys(city, actions) {
  const set = (singleKeys) => {
    save(KEY, singleKeys ? null : false);
    city.listenForKeys(singleKeys ? document : city);
  };
  document.addEventListener('keydown', (event) => {
    const code = codeOf(event);
    const isEscape = code === 'Escape';
    const isOnCity = event.target === city;
    if (event.repeat || (!isEscape && !isOnCity && !hasSingleKeys() && event.code !== 'F1')) return;
    // Escape closes a panel even from its text field.
    if (isEscape ? event.defaultPrevented || event.target.closest?.('dialog') : isTaken(event)) return;
    const action = actions[PAGE_KEYS[code]];
    if (!action || event.ctrlKey !== (code === 'KeyZ')) return;
    if (!isEscape) event.preventDefault();
    action();
  });
  set(hasSingleKeys());
  return { set };
}
