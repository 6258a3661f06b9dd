/** How single objects are drawn whatever rules say: what users ask for, and what the engine has of it. */

import { cssColour } from './colour.js';

/** States for the engine, besides colours. */
const [HIDDEN, AS_RULES_SAY] = [-1, -2];

export class ObjectStates {
  #send;
  /** By object: what is asked for. @type {Map<number, {color?: string|null, hidden?: boolean}>} */ #states = new Map();
  /** Objects whose states the engine does not have yet. @type {Set<number>} */ #changed = new Set();

  /** @param {(op: string, values: object) => void} send */
  constructor(send) {
    this.#send = send;
  }

  /** Changes what is asked for; `null` ends it. @param {number|string} id @param {{color?: string|null, hidden?: boolean}|null} state */
  set(id, state) {
    const number = Number(id);
    if (!Number.isInteger(number) || number < 0 || number >= 2 ** 32) throw new RangeError(`${id} is not the number of an object`);
    if (state?.color) cssColour(state.color);
    if (state === null) this.#states.delete(number);
    else this.#states.set(number, { ...this.#states.get(number), ...state });
    // Each message costs a pass over the palettes: one for all changes of a script.
    if (this.#changed.size === 0) queueMicrotask(() => this.sendChanged());
    this.#changed.add(number);
  }

  get(id) {
    return { ...this.#states.get(Number(id)) };
  }

  /** Another city has other objects. */
  clear() {
    this.#states.clear();
  }

  /** To an engine that has none of it. */
  sendAll() {
    this.#sendOf([...this.#states.keys()]);
  }

  sendChanged() {
    this.#sendOf([...this.#changed]);
  }

  #sendOf(objects) {
    this.#changed.clear();
    const number = ({ color, hidden } = {}) => (hidden ? HIDDEN : color ? cssColour(color) : AS_RULES_SAY);
    if (objects.length > 0) this.#send('states', { objects, states: objects.map((object) => number(this.#states.get(object))) });
  }
}
