/** Panels beside the view, of which at most one is open, and modal dialogs. */

import { element } from './dom.js';
import { strings } from './strings.js';
import { iconButton, uniqueId } from './widgets.js';

/**
 * A panel: its title, its content, and what happens when it opens and closes. `opened` returns a promise if it fetches content.
 * @typedef {{title: string, content: Node[], opened?: () => Promise<unknown>|void, closed?: () => void, focus?: HTMLElement}} Panel
 */

/** All panels of the page. */
export class Panels {
  /** The container of the panels. */
  node = element('div', { class: 'panels' });
  /** @type {Map<string, {panel: Panel, section: HTMLElement, button: HTMLElement}>} */
  #entries = new Map();
  /** @type {string|null} */
  #current = null;

  constructor() {
    // On narrow screens, what lies above an open panel depends on its height.
    const show = ([{ target }]) => document.documentElement.style.setProperty('--panel-height', `${target.clientHeight}px`);
    new ResizeObserver(show).observe(this.node);
  }

  /** Name of the open panel, or `null`. */
  get current() {
    return this.#current;
  }

  /**
   * Adds a panel that a button opens.
   * @param {string} name
   * @param {HTMLElement} button
   * @param {Panel} panel
   */
  add(name, button, panel) {
    const [id, titleId] = [uniqueId(), uniqueId()];
    const label = strings.panel.closeNamed(panel.title);
    const close = iconButton({ icon: 'close', label, press: () => this.close(true) });
    const head = element('header', {}, element('h2', { id: titleId }, panel.title), close);
    const body = element('div', { class: 'panel-body' }, ...panel.content);
    const attributes = { class: 'panel', id, tabindex: -1, 'aria-labelledby': titleId, hidden: true };
    const section = element('section', attributes, head, body);
    button.setAttribute('aria-expanded', 'false');
    button.setAttribute('aria-controls', id);
    this.#entries.set(name, { panel, section, button });
    this.node.append(section);
  }

  /**
   * Opens a panel, or closes it if it is open.
   * @param {string} name
   */
  toggle(name) {
    if (this.#current === name) this.close(true);
    else this.open(name);
  }

  /**
   * Opens a panel instead of another one.
   * @param {string} name
   * @param {boolean} takesFocus Whether it gets the focus.
   */
  open(name, takesFocus = true) {
    const entry = this.#entries.get(name);
    if (!entry || this.#current === name) return;
    this.close(false);
    this.#current = name;
    entry.section.hidden = false;
    entry.button.setAttribute('aria-expanded', 'true');
    markBusy(entry.section, entry.panel.opened?.());
    if (takesFocus) (entry.panel.focus ?? entry.section).focus({ preventScroll: true });
  }

  /**
   * Closes the open panel.
   * @param {boolean} returnsFocus Whether its button gets the focus.
   * @returns {boolean} Whether one was open.
   */
  close(returnsFocus) {
    const entry = this.#current === null ? undefined : this.#entries.get(this.#current);
    if (!entry) return false;
    this.#current = null;
    const hadFocus = entry.section.contains(document.activeElement);
    entry.section.hidden = true;
    entry.button.setAttribute('aria-expanded', 'false');
    entry.panel.closed?.();
    if (returnsFocus && hadFocus) entry.button.focus({ preventScroll: true });
    return true;
  }
}

/** Says that a panel is incomplete until what it fetches has come or failed. */
function markBusy(section, content) {
  if (!content) return;
  section.setAttribute('aria-busy', 'true');
  const end = () => section.removeAttribute('aria-busy');
  content.then(end, end);
}

/**
 * A modal dialog with a title and a button that closes it. A click beside it closes it as well.
 * @param {string} title
 * @param {...Node} content
 * @returns {HTMLDialogElement}
 */
export function dialog(title, ...content) {
  const titleId = uniqueId();
  const made = /** @type {HTMLDialogElement} */ (element('dialog', { 'aria-labelledby': titleId }));
  const close = iconButton({ icon: 'close', label: strings.panel.closeNamed(title), press: () => made.close() });
  const head = element('header', {}, element('h2', { id: titleId }, title), close);
  const body = element('div', { class: 'dialog-body', tabindex: 0, role: 'group', 'aria-labelledby': titleId }, ...content);
  made.append(head, body);
  made.addEventListener('click', (event) => event.target === made && made.close());
  return made;
}
