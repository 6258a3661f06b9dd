/** What users change in a viewer: options as messages to the engine, and the actions of keys and gamepads. */

import { LOOKS, MODES, SHADINGS } from './key-table.js';

const ZOOM_STEP = 1.25;

/**
 * What is displayed, and how the camera is steered.
 * @typedef {object} ViewerOptions
 * @property {number} tau Tolerated error in pixels.
 * @property {number} fps Frames a second while the view moves, 5 to 240.
 * @property {string} distances Where levels of detail change, in metres, such as `50,100`; empty if `tau` decides.
 * @property {string} shading One of SHADINGS.
 * @property {string} look One of LOOKS.
 * @property {boolean} shadows
 * @property {boolean|null} collision `null` as long as the mode decides.
 * @property {string} mode One of MODES.
 * @property {boolean} day Whether the time of day runs.
 */

/** @returns {ViewerOptions} */
export function defaultOptions() {
  return { tau: 1, fps: 30, distances: '', shading: 'lit', look: 'model', shadows: true, collision: null, mode: 'orbit', day: false };
}

/**
 * Whether ground and buildings stop the camera: when walking, unless the user chose otherwise.
 * @param {ViewerOptions} options
 * @returns {boolean}
 */
export function collides({ collision, mode }) {
  return collision ?? mode === 'walk';
}

/** @type {(value: any) => boolean} */
const isPositive = (value) => Number.isFinite(value) && value > 0;
/** @type {(value: any) => boolean} */
const isSwitch = (value) => typeof value === 'boolean';
/** @type {(values: number[]) => boolean} */
const isAscending = (values) =>
  values.length <= 16 && values.every((value, i) => Number.isFinite(value) && value > (values[i - 1] ?? 0));

/**
 * Which values an option has, and the same in words.
 * @type {Record<string, [isValid: (value: any) => boolean, allowed: string]>}
 */
const RULES = {
  tau: [isPositive, 'a number above 0'],
  fps: [isPositive, 'a number above 0'],
  distances: [
    (value) => value === '' || (typeof value === 'string' && isAscending(value.split(',').map(Number))),
    "at most 16 ascending numbers above 0, such as '50,100', or ''",
  ],
  shading: [(value) => SHADINGS.includes(value), SHADINGS.join(', ')],
  look: [(value) => LOOKS.includes(value), LOOKS.join(', ')],
  shadows: [isSwitch, 'true, false'],
  collision: [isSwitch, 'true, false'],
  mode: [(value) => MODES.includes(value), MODES.join(', ')],
  day: [isSwitch, 'true, false'],
};

/**
 * The changes that are valid. Says in the console which are not; what is `undefined` is no change.
 * @param {object} changes
 * @param {{hasOthers?: boolean}} [of] Whether there may be values that are no options.
 * @returns {Partial<ViewerOptions>}
 */
export function validChanges(changes, { hasOthers = false } = {}) {
  const isValid = ([name, value]) => {
    if (value === undefined || (hasOthers && !Object.hasOwn(RULES, name))) return false;
    if (!Object.hasOwn(RULES, name)) {
      console.warn(`insula: there is no option ${name}: use one of ${Object.keys(RULES).join(', ')}`);
      return false;
    }
    const [isAllowed, allowed] = RULES[name];
    if (!isAllowed(value)) console.warn(`insula: the option ${name} cannot be ${shown(value)}: allowed is ${allowed}`);
    return isAllowed(value);
  };
  return Object.fromEntries(Object.entries(changes).filter(isValid));
}

/** A value as a script has it. @param {any} value */
function shown(value) {
  return typeof value === 'string' ? `'${value}'` : String(value);
}

/**
 * Messages to the engine for changed options.
 * @param {Partial<ViewerOptions>} changes
 * @returns {[string, object][]}
 */
export function optionMessages({ tau, fps, distances, shading, look, shadows, collision, mode, day }) {
  /** @type {(all: string[], word: string|undefined) => number|undefined} */
  const number = (all, word) => (word === undefined ? undefined : all.indexOf(word));
  const numbers = { shading: number(SHADINGS, shading), look: number(LOOKS, look) };
  const shown = Object.entries({ tau, fps, distances, shadows, ...numbers }).filter(([, value]) => value !== undefined);
  /** @type {[string, object][]} */
  const messages = [];
  if (shown.length > 0) messages.push(['options', Object.fromEntries(shown)]);
  if (mode !== undefined) messages.push(['mode', { mode }]);
  if (collision !== undefined) messages.push(['collision', { on: collision }]);
  if (day !== undefined) messages.push(['day', { running: day }]);
  return messages;
}

/**
 * Does an action of the key table.
 * @param {import('./insula-city.js').InsulaCity} city
 * @param {string} action
 * @param {number} [value] Number of a shading.
 */
export function act(city, action, value = 0) {
  const { options } = city;
  const mode = MODES[(MODES.indexOf(options.mode) + 1) % MODES.length];
  /** @type {Record<string, () => void>} */
  const actions = {
    mode: () => city.setOptions({ mode }),
    home: () => city.steer('home'),
    north: () => city.steer('north'),
    collision: () => city.setOptions({ collision: !collides(options) }),
    shadows: () => city.setOptions({ shadows: !options.shadows }),
    shading: () => city.setOptions({ shading: SHADINGS[value] }),
    day: () => city.setOptions({ day: !options.day }),
    closer: () => city.steer('zoom', { factor: ZOOM_STEP }),
    farther: () => city.steer('zoom', { factor: 1 / ZOOM_STEP }),
  };
  actions[action]?.();
}

/**
 * The options that differ from those with which the engine starts.
 * @param {ViewerOptions} options
 * @returns {Partial<ViewerOptions>}
 */
export function changedOptions(options) {
  /** @type {Record<string, unknown>} */
  const initial = { ...defaultOptions(), tau: options.tau };
  return Object.fromEntries(Object.entries(options).filter(([key, value]) => value !== initial[key]));
}
