/** Dark and light: as the system wants, unless the user chose otherwise. */

import { applyAccent } from './brand.js';
import { load, save } from './storage.js';

const KEY = 'theme';
const system = matchMedia('(prefers-color-scheme: dark)');

/** Whether the page is dark. @returns {boolean} */
export function isDark() {
  const chosen = load(KEY, null);
  return chosen === 'dark' || (chosen !== 'light' && system.matches);
}

/** Applies the stored choice to the page. */
export function applyTheme() {
  const chosen = load(KEY, null);
  if (chosen === 'dark' || chosen === 'light') document.documentElement.dataset.theme = chosen;
  else delete document.documentElement.dataset.theme;
  applyAccent(isDark());
}

/** Switches. A choice that agrees with the system is forgotten, so that the page follows the system again. */
export function toggleTheme() {
  const dark = !isDark();
  save(KEY, dark === system.matches ? null : dark ? 'dark' : 'light');
  applyTheme();
}

/**
 * Calls `changed` when the system's wish changes.
 * @param {() => void} changed
 */
export function onSystemTheme(changed) {
  system.addEventListener('change', () => {
    applyTheme();
    changed();
  });
}
