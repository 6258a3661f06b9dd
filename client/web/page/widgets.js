/** Controls of panels: buttons, choices, switches, sliders. */

import { element } from './dom.js';
import { icon } from './icons.js';

let nextId = 1;

/** An id that no other element of the page has. @returns {string} */
export function uniqueId() {
  return `insula-${nextId++}`;
}

/**
 * A button with an icon, a text, or both.
 * @param {{icon?: string, text?: string, label?: string, class?: string, press: (event: Event) => void}} values
 * @returns {HTMLButtonElement}
 */
export function button({ icon: name, text = '', label, class: kind = '', press }) {
  const attributes = { type: 'button', class: kind, 'aria-label': label, click: press };
  const parts = [name ? icon(name) : null, text ? element('span', {}, text) : null];
  return /** @type {HTMLButtonElement} */ (element('button', attributes, ...parts));
}

/**
 * A button that shows only an icon; its label is its tooltip.
 * @param {{icon: string, label: string, key?: string, press: (event: Event) => void}} values
 */
export function iconButton({ icon: name, label, key, press }) {
  const made = button({ icon: name, label, class: 'icon-button', press });
  setTip(made, label, key);
  return made;
}

/**
 * Sets label and tooltip of a button.
 * @param {HTMLElement} target
 * @param {string} label
 * @param {string} [key] Shown in the tooltip.
 */
export function setTip(target, label, key) {
  target.setAttribute('aria-label', label);
  target.dataset.tip = key ? `${label} (${key})` : label;
  if (key) target.setAttribute('aria-keyshortcuts', key);
}

/**
 * One choice of several, as a row of segments or as a list.
 * @param {{title: string, choices: [string, string][], value: string, isRow?: boolean, change: (value: string) => void}} values
 * @returns {{node: HTMLElement, set: (value: string) => void}}
 */
export function choice({ title, choices, value, isRow = false, change }) {
  const name = uniqueId();
  const inputs = choices.map(([key]) =>
    /** @type {HTMLInputElement} */ (
      element('input', { type: 'radio', name, value: key, checked: key === value, change: () => change(key) })
    ),
  );
  const rows = choices.map(([, text], i) => element('label', {}, inputs[i], element('span', {}, text)));
  const list = element('div', { class: isRow ? 'segments' : 'choices' }, ...rows);
  const node = element('fieldset', {}, element('legend', {}, title), list);
  const set = (key) => inputs.forEach((input) => (input.checked = input.value === key));
  return { node, set };
}

/**
 * A checkbox with a label.
 * @param {{text: string, checked: boolean, change: (checked: boolean) => void}} values
 * @returns {{node: HTMLElement, set: (checked: boolean) => void}}
 */
export function checkbox({ text, checked, change }) {
  const input = /** @type {HTMLInputElement} */ (element('input', { type: 'checkbox', checked }));
  input.addEventListener('change', () => change(input.checked));
  const node = element('label', { class: 'check' }, input, element('span', {}, text));
  const set = (isChecked) => (input.checked = isChecked);
  return { node, set };
}

/**
 * A slider with its value as text.
 * @param {{text: string, min: number, max: number, step: number, value: number, format: (value: number) => string,
 *   input: (value: number) => void}} values
 * @returns {{node: HTMLElement, set: (value: number) => void}}
 */
export function slider({ text, min, max, step, value, format, input }) {
  const id = uniqueId();
  const range = /** @type {HTMLInputElement} */ (element('input', { type: 'range', id, min, max, step }));
  const output = element('output', { for: id });
  const show = (shown) => {
    output.textContent = format(shown);
    range.setAttribute('aria-valuetext', format(shown));
  };
  const set = (next) => {
    range.value = String(next);
    show(next);
  };
  range.addEventListener('input', () => {
    show(range.valueAsNumber);
    input(range.valueAsNumber);
  });
  set(value);
  const head = element('div', { class: 'slider-head' }, element('label', { for: id }, text), output);
  return { node: element('div', { class: 'slider' }, head, range), set };
}

/**
 * A list to choose from, with a label above it. It is empty until it is filled.
 * @param {{text: string, change: (value: string) => void}} values
 * @returns {{node: HTMLElement, fill: (choices: [string, string][]) => void, set: (value: string) => void}}
 */
export function select({ text, change }) {
  const id = uniqueId();
  const list = /** @type {HTMLSelectElement} */ (element('select', { id, change: () => change(list.value) }));
  const fill = (choices) => list.replaceChildren(...choices.map(([value, name]) => element('option', { value }, name)));
  const set = (value) => (list.value = value);
  return { node: element('div', { class: 'field' }, element('label', { for: id }, text), list), fill, set };
}

/**
 * A text field with a label above it.
 * @param {{text: string, value?: string, type?: string, readOnly?: boolean, placeholder?: string, hint?: string}} values
 * @returns {{node: HTMLElement, input: HTMLInputElement}}
 */
export function field({ text, value = '', type = 'text', readOnly = false, placeholder, hint }) {
  const [id, hintId] = [uniqueId(), uniqueId()];
  const attributes = { type, id, readonly: readOnly, placeholder, autocomplete: 'off', spellcheck: 'false' };
  const described = hint ? { 'aria-describedby': hintId } : {};
  const input = /** @type {HTMLInputElement} */ (element('input', { ...attributes, ...described, dir: 'auto' }));
  input.value = value;
  const hintNode = hint ? element('p', { class: 'hint', id: hintId }, hint) : null;
  return { node: element('div', { class: 'field' }, element('label', { for: id }, text), input, hintNode), input };
}
