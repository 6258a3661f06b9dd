/**
 * Keys and their actions, as in the native client.
 *
 * Browsers keep Tab for the focus and most function keys for themselves: F switches the mode, and the digits 1 to 9 alone
 * choose the shading.
 */

/** Names of shadings, in the order of their keys and of their numbers in the engine. */
export const SHADINGS = ['lit', 'albedo', 'ao', 'normal', 'lod', 'kind', 'wire', 'triangles', 'bounds'];
/** Looks, in the order of their numbers in the engine. */
export const LOOKS = ['model', 'physical', 'paper'];
/** Control modes, in the order in which the key switches them. */
export const MODES = ['orbit', 'fly', 'walk'];
/** What the measuring tool measures, in the order in which the key switches it. */
export const MEASURES = ['line', 'area', 'height'];

/** Directions of held keys. @type {Record<string, string>} */
export const MOVES = {
  KeyW: 'forward',
  ArrowUp: 'forward',
  KeyS: 'back',
  ArrowDown: 'back',
  KeyA: 'left',
  ArrowLeft: 'left',
  KeyD: 'right',
  ArrowRight: 'right',
  KeyE: 'up',
  PageUp: 'up',
  KeyQ: 'down',
  PageDown: 'down',
};

/** Actions of the viewer. @type {Record<string, string>} */
export const VIEW_KEYS = {
  KeyF: 'mode',
  KeyH: 'home',
  Home: 'home',
  KeyU: 'north',
  KeyX: 'collision',
  KeyL: 'shadows',
  KeyT: 'day',
  Equal: 'closer',
  NumpadAdd: 'closer',
  Minus: 'farther',
  NumpadSubtract: 'farther',
  Enter: 'middle',
};

/** Actions of the application page. @type {Record<string, string>} */
export const PAGE_KEYS = {
  KeyB: 'bookmark',
  KeyC: 'copyLink',
  KeyG: 'colors',
  KeyI: 'counters',
  KeyM: 'measure',
  KeyO: 'time',
  KeyP: 'picture',
  KeyV: 'bookmarks',
  KeyY: 'proposal',
  Slash: 'search',
  Backspace: 'undo',
  KeyZ: 'undo',
  F1: 'help',
  Escape: 'escape',
};

/** Signs that lie elsewhere on other keyboards. */
const SIGNS = { '/': 'Slash', '+': 'Equal', '-': 'Minus', '?': 'F1' };

/**
 * The key of the tables that was meant: what moves the camera is where it lies on every keyboard, other letters are what is
 * written on them. Where none are Latin, they are where they lie, too.
 * @param {KeyboardEvent} event
 * @returns {string}
 */
export function codeOf({ key, code, ctrlKey }) {
  if (MOVES[code] && !ctrlKey) return code;
  return SIGNS[key] ?? (/^[a-z]$/i.test(key) ? 'Key' + key.toUpperCase() : code);
}

/**
 * The shading of a digit key, or -1.
 * @param {string} code
 * @returns {number}
 */
export function shadingOf(code) {
  return Number(/^Digit([1-9])$/.exec(code)?.[1] ?? 0) - 1;
}

/** Keys that controls such as sliders and lists use themselves. */
const CONTROL_KEYS = /^(Arrow|Page|Home|End|Enter|Space|Backspace)/;
const TEXT_FIELDS = 'select, textarea, [contenteditable]:not([contenteditable=false])';
const PLAIN_INPUTS = ['range', 'checkbox', 'radio', 'button', 'submit'];

/**
 * Whether a key belongs to the control that has the focus, to the browser, or to an open dialog. Not of those with Ctrl.
 * @param {KeyboardEvent} event
 * @returns {boolean}
 */
export function isTaken(event) {
  if (event.defaultPrevented || event.isComposing || event.altKey || event.metaKey) return true;
  const target = event.composedPath()[0];
  if (!(target instanceof Element)) return false;
  if (target.closest('dialog') || target.closest(TEXT_FIELDS)) return true;
  const input = target.closest('input');
  if (input && !PLAIN_INPUTS.includes(input.type)) return true;
  return CONTROL_KEYS.test(event.code) && target.closest('input, button, a[href], summary') !== null;
}
