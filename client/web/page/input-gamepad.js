/** Gamepads: the left stick moves, the right stick looks, triggers go down and up. Polled only while one is connected. */

/** Sticks rarely rest at exactly 0. */
const DEAD_ZONE = 0.15;
/** A stick beyond this holds a direction. */
const HOLD = 0.4;
/** Speed of looking around, as a drag in pixels per second. */
const LOOK_PX_PER_SEC = 500;

/** Buttons of the standard layout and their actions. @type {Record<number, string>} */
const BUTTONS = { 0: 'middle', 2: 'north', 3: 'mode', 9: 'home' };
const [FAST, DOWN, UP] = [4, 6, 7];

/** Viewers that gamepads may steer; the one that was used last comes first. @type {GamepadInput[]} */
const inputs = [];
let isPolling = false;

/** Steers one viewer. */
export class GamepadInput {
  #actions;
  /** @type {Set<string>} */
  #held = new Set();
  /** @type {Set<number>} */
  #pressed = new Set();
  isVisible = true;

  /** @param {import('./input-keyboard.js').KeyActions} actions */
  constructor(actions) {
    this.#actions = actions;
    inputs.push(this);
    startPolling();
  }

  /** Makes this viewer the one that gamepads steer. */
  use() {
    const at = inputs.indexOf(this);
    if (at > 0) inputs.unshift(...inputs.splice(at, 1));
  }

  /** Releases all buttons, because the gamepad was disconnected or steers another viewer. */
  release() {
    for (const direction of [...this.#held]) this.#hold(direction, false);
    this.#pressed.clear();
  }

  /** Ends steering. */
  dispose() {
    this.release();
    const at = inputs.indexOf(this);
    if (at >= 0) inputs.splice(at, 1);
  }

  /**
   * Acts on the state of a gamepad after `secs` seconds.
   * @param {Gamepad} pad
   * @param {number} secs
   */
  step(pad, secs) {
    const [x = 0, y = 0, lookX = 0, lookY = 0] = pad.axes;
    const isPressed = (button) => pad.buttons[button]?.pressed ?? false;
    this.#hold('forward', y < -HOLD);
    this.#hold('back', y > HOLD);
    this.#hold('left', x < -HOLD);
    this.#hold('right', x > HOLD);
    this.#hold('down', isPressed(DOWN));
    this.#hold('up', isPressed(UP));
    this.#hold('fast', isPressed(FAST));
    const [dx, dy] = [lookX, lookY].map((v) => (Math.abs(v) > DEAD_ZONE ? v * LOOK_PX_PER_SEC * secs : 0));
    if (dx !== 0 || dy !== 0) this.#actions.send('drag', { dx, dy });
    for (const button of Object.keys(BUTTONS).map(Number)) {
      if (isPressed(button) && !this.#pressed.has(button)) this.#actions.act(BUTTONS[button]);
      if (isPressed(button)) this.#pressed.add(button);
      else this.#pressed.delete(button);
    }
  }

  #hold(direction, held) {
    if (held === this.#held.has(direction)) return;
    if (held) this.#held.add(direction);
    else this.#held.delete(direction);
    if (direction === 'fast') this.#actions.send('fast', { held });
    else this.#actions.send('move', { direction, held });
  }
}

/** Gamepads with the standard layout. Browsers may refuse the list to embedded pages. */
function connected() {
  try {
    return navigator.getGamepads().filter((pad) => pad?.connected && pad.mapping === 'standard');
  } catch {
    return [];
  }
}

function startPolling() {
  if (isPolling || connected().length === 0 || inputs.length === 0) return;
  isPolling = true;
  let last = performance.now();
  const poll = (now) => {
    const pad = connected()[0];
    const steered = inputs.find((input) => input.isVisible);
    inputs.filter((input) => input !== steered || !pad).forEach((input) => input.release());
    if (pad && steered) steered.step(pad, Math.min((now - last) / 1000, 0.1));
    last = now;
    isPolling = pad !== undefined && inputs.length > 0;
    if (isPolling) requestAnimationFrame(poll);
  };
  requestAnimationFrame(poll);
}

if (globalThis.addEventListener && 'getGamepads' in navigator) addEventListener('gamepadconnected', startPolling);
