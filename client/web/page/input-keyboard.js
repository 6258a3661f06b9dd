/** Keys of the viewer: held keys move the camera, others are actions. */

import { MOVES, VIEW_KEYS, codeOf, isTaken, shadingOf } from './key-table.js';

/**
 * Receiver of keys.
 * @typedef {object} KeyActions
 * @property {(op: string, values?: object) => void} send
 * @property {(action: string, value?: number) => void} act An action of VIEW_KEYS, or `shading` with its number.
 */

/** Listens on a target until it is disposed of. */
export class KeyboardInput {
  #actions;
  #stop = new AbortController();
  /** @type {Set<string>} */
  #held = new Set();
  #isFast = false;

  /**
   * @param {EventTarget} target
   * @param {KeyActions} actions
   */
  constructor(target, actions) {
    this.#actions = actions;
    const { signal } = this.#stop;
    target.addEventListener('keydown', (event) => this.#down(event), { signal });
    target.addEventListener('keyup', (event) => this.#up(event), { signal });
    // Keys that are released elsewhere send no event.
    target.addEventListener('blur', () => this.#release(), { signal });
    window.addEventListener('blur', () => this.#release(), { signal });
  }

  /** Stops listening and releases all keys. */
  dispose() {
    this.#release();
    this.#stop.abort();
  }

  #down(event) {
    this.#setFast(event.shiftKey);
    if (isTaken(event) || event.ctrlKey) return;
    const direction = MOVES[event.code];
    if (direction) {
      event.preventDefault();
      if (this.#held.has(event.code)) return;
      const isNew = ![...this.#held].some((code) => MOVES[code] === direction);
      this.#held.add(event.code);
      if (isNew) this.#actions.send('move', { direction, held: true });
      return;
    }
    const [action, shading] = [VIEW_KEYS[codeOf(event)], shadingOf(codeOf(event))];
    if (event.repeat && action !== 'closer' && action !== 'farther') return;
    if (action) this.#actions.act(action);
    else if (shading >= 0) this.#actions.act('shading', shading);
    else return;
    event.preventDefault();
  }

  #up(event) {
    this.#setFast(event.shiftKey);
    if (!this.#held.delete(event.code)) return;
    const direction = MOVES[event.code];
    const isHeld = [...this.#held].some((code) => MOVES[code] === direction);
    if (!isHeld) this.#actions.send('move', { direction, held: false });
  }

  #setFast(held) {
    if (held === this.#isFast) return;
    this.#isFast = held;
    this.#actions.send('fast', { held });
  }

  #release() {
    if (this.#held.size === 0 && !this.#isFast) return;
    this.#held.clear();
    this.#isFast = false;
    this.#actions.send('release');
  }
}
