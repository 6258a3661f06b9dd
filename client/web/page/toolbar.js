/** The toolbar. On narrow screens, its second group opens from a button. */

import { element } from './dom.js';
import { icon, setIcon } from './icons.js';
import { strings } from './strings.js';
import { isDark, onSystemTheme, toggleTheme } from './theme.js';
import { setTip, uniqueId } from './widgets.js';

const texts = strings.toolbar;

/** Names of the buttons in their order, with their keys. */
const MAIN = { search: '/', view: '', objects: '', colors: 'G', time: 'O', measure: 'M' };
const EXTRA = { analyse: '', proposals: '', bookmarks: 'V', share: 'C', picture: 'P', fullScreen: 'F11', dark: '', help: 'F1', about: '' };

/**
 * The toolbar.
 * @param {Record<string, () => void>} actions What the buttons do, by name.
 * @returns {{node: HTMLElement, buttons: Record<string, HTMLElement>, closeMore: () => boolean}}
 */
export function toolbar(actions) {
  /** @type {Record<string, HTMLElement>} */
  const buttons = {};
  const group = (names, attributes) => {
    for (const [name, key] of Object.entries(names)) {
      const text = element('span', { class: 'text', 'aria-hidden': 'true' }, texts[name]);
      const press = () => actions[name]?.();
      buttons[name] = element('button', { type: 'button', class: 'tool', click: press }, icon(name), text);
      setTip(buttons[name], texts[name], key);
    }
    return element('div', attributes, ...Object.keys(names).map((name) => buttons[name]));
  };
  const id = uniqueId();
  const main = group(MAIN, { class: 'tools' });
  const extra = group(EXTRA, { class: 'tools extra', id });
  const more = element('button', { type: 'button', class: 'tool more', 'aria-expanded': 'false', 'aria-controls': id });
  more.append(icon('more'), element('span', { class: 'text' }, texts.more));
  const setOpen = (isOpen) => {
    extra.classList.toggle('is-open', isOpen);
    more.setAttribute('aria-expanded', String(isOpen));
  };
  const isOpen = () => extra.classList.contains('is-open');
  more.addEventListener('click', () => {
    setOpen(!isOpen());
    // The menu opens where panels are.
    actions.more?.();
  });
  extra.addEventListener('click', () => setOpen(false));
  const closeMore = () => {
    const wasOpen = isOpen();
    setOpen(false);
    return wasOpen;
  };
  showTheme(buttons.dark);
  showFullScreen(buttons.fullScreen);
  return { node: element('nav', { class: 'toolbar', 'aria-label': texts.label }, main, extra, more), buttons, closeMore };
}

function relabel(button, name, key) {
  setTip(button, texts[name], key);
  setIcon(button, name);
  button.querySelector('.text')?.replaceChildren(texts[name]);
}

/** The button offers the other appearance. */
function showTheme(button) {
  const show = () => relabel(button, isDark() ? 'light' : 'dark', '');
  button.addEventListener('click', () => {
    toggleTheme();
    show();
  });
  onSystemTheme(show);
  show();
}

/** Phones may have no full screen for pages. */
function showFullScreen(button) {
  button.hidden = !document.fullscreenEnabled;
  const show = () => relabel(button, document.fullscreenElement ? 'endFullScreen' : 'fullScreen', 'F11');
  button.addEventListener('click', () => {
    const change = document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen();
    // Browsers may refuse, and then nothing has changed.
    change.catch(() => {});
  });
  document.addEventListener('fullscreenchange', show);
}
