/** Mouse, pen, touch and wheel as motions of the camera. */

import { TwoFingers } from './touch-gesture.js';

/** A press that moves less is a click. */
const CLICK_PX = 5;
const CLICK_MS = 600;
/** A mouse that rests this long hovers over what is below it. */
const HOVER_MS = 80;
/** Two clicks within this time and distance are a double click. */
const DOUBLE_CLICK_MS = 350;
const DOUBLE_CLICK_PX = 24;
/** Pixels of a touchpad, and of a mouse wheel, that count as one step. */
const TOUCHPAD_STEP_PX = 40;
const WHEEL_STEP_PX = 100;
/** Magnification per pixel of a pinch on a touchpad, which browsers report as a wheel with Ctrl. */
const PINCH_PER_PX = 0.01;

/**
 * Receiver of motions. Positions are shares of the surface, 0 to 1.
 * @typedef {object} PointerActions
 * @property {(op: string, values: object) => void} send
 * @property {(x: number, y: number, count: number, adds: boolean) => void} click
 * @property {() => void} press
 * @property {() => boolean} isShy Whether wheel and single fingers are the page's.
 * @property {(what: 'wheel'|'fingers') => void} refuse Such a gesture was left to the page.
 * @property {(at: {x: number, y: number}|null) => void} hover A mouse rests there without a pressed button; `null` ends it.
 */

/** Listens on a surface until it is disposed of. */
export class PointerInput {
  #surface;
  #actions;
  #stop = new AbortController();
  /** Pressed pointers and their positions. @type {Map<number, [number, number]>} */
  #pointers = new Map();
  /** @type {TwoFingers|null} */
  #gesture = null;
  /** The press that may become a click. @type {{at: [number, number], time: number, button: number}|null} */
  #press = null;
  /** @type {{at: [number, number], time: number}|null} */
  #lastClick = null;
  #hoverTimer = 0;
  /** Whether the touch in progress began while single fingers were the page's. */
  #isShyTouch = false;

  /**
   * @param {HTMLElement} surface
   * @param {PointerActions} actions
   */
  constructor(surface, actions) {
    this.#surface = surface;
    this.#actions = actions;
    const { signal } = this.#stop;
    const listen = (name, listener) => surface.addEventListener(name, listener, { signal, passive: false });
    listen('pointerdown', (event) => this.#down(event));
    listen('pointermove', (event) => this.#move(event));
    listen('pointerup', (event) => this.#up(event));
    listen('pointercancel', (event) => this.#forget(event));
    listen('lostpointercapture', (event) => this.#forget(event));
    listen('pointerleave', () => this.#endHover());
    listen('wheel', (event) => this.#wheel(event));
    // The right button pans.
    listen('contextmenu', (event) => event.preventDefault());
  }

  /** Stops listening. */
  dispose() {
    clearTimeout(this.#hoverTimer);
    this.#stop.abort();
  }

  #down(event) {
    // A tap must give the focus, and a finger that moves scrolls the page.
    if (event.pointerType === 'touch' && this.#actions.isShy()) this.#isShyTouch = true;
    else if (this.#pointers.size === 0) this.#isShyTouch = false;
    event.preventDefault();
    this.#endHover();
    this.#surface.setPointerCapture(event.pointerId);
    this.#pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (!this.#isShyTouch) this.#actions.press();
    const isFirst = this.#pointers.size === 1;
    this.#press = isFirst ? { at: [event.clientX, event.clientY], time: event.timeStamp, button: event.button } : null;
    this.#startGesture();
  }

  #startGesture() {
    this.#gesture = this.#pointers.size === 2 ? new TwoFingers([...this.#pointers.values()]) : null;
  }

  #move(event) {
    const last = this.#pointers.get(event.pointerId);
    if (!last) return this.#hover(event);
    const at = [event.clientX, event.clientY];
    if (this.#press && distance(at, this.#press.at) > CLICK_PX) this.#press = null;
    this.#pointers.set(event.pointerId, at);
    if (this.#gesture) this.#moveTwo(this.#gesture.move([...this.#pointers.values()]));
    else if (this.#isShyTouch) this.#actions.refuse('fingers');
    else if (this.#pointers.size === 1) this.#moveOne(event, at[0] - last[0], at[1] - last[1]);
    return undefined;
  }

  #hover({ pointerType, clientX, clientY }) {
    clearTimeout(this.#hoverTimer);
    if (pointerType !== 'mouse' || this.#pointers.size > 0) return;
    const [x, y] = this.#share([clientX, clientY]);
    this.#hoverTimer = setTimeout(() => this.#actions.hover({ x, y }), HOVER_MS);
  }

  #endHover() {
    clearTimeout(this.#hoverTimer);
    this.#actions.hover(null);
  }

  #moveOne(event, dx, dy) {
    if (dx === 0 && dy === 0) return;
    // Bits 2 and 4 are the right and the middle button.
    const pans = (event.buttons & 6) !== 0 || event.ctrlKey || event.metaKey;
    this.#actions.send(pans ? 'pan' : 'drag', { dx, dy });
  }

  #moveTwo(motion) {
    if (!motion) return;
    const { send } = this.#actions;
    if (motion.tilt) send('tilt', { rad: motion.tilt });
    if (motion.pan && (motion.pan[0] || motion.pan[1])) send('pan', { dx: motion.pan[0], dy: motion.pan[1] });
    if (motion.zoom && motion.zoom !== 1) send('zoom', { factor: motion.zoom });
    if (motion.turn) send('turn', { rad: motion.turn });
  }

  #up(event) {
    const press = this.#press;
    this.#forget(event);
    if (!press || press.button !== 0 || event.timeStamp - press.time > CLICK_MS) return;
    const last = this.#lastClick;
    const isDouble =
      last !== null &&
      press.time - last.time < DOUBLE_CLICK_MS &&
      distance(press.at, last.at) < DOUBLE_CLICK_PX;
    // A third click begins another double click.
    if (this.#isShyTouch) this.#actions.press();
    this.#lastClick = isDouble ? null : { at: press.at, time: event.timeStamp };
    const [x, y] = this.#share(press.at);
    this.#actions.click(x, y, isDouble ? 2 : 1, event.shiftKey);
  }

  #forget(event) {
    if (!this.#pointers.delete(event.pointerId)) return;
    this.#press = null;
    this.#startGesture();
  }

  #wheel(event) {
    // With Ctrl, the browser would scale the page.
    if (!event.ctrlKey && this.#actions.isShy()) return this.#actions.refuse('wheel');
    event.preventDefault();
    const { send } = this.#actions;
    if (event.ctrlKey) return send('zoom', { factor: Math.exp(-event.deltaY * PINCH_PER_PX) });
    if (event.deltaMode !== WheelEvent.DOM_DELTA_PIXEL) return send('wheel', { steps: -Math.sign(event.deltaY) });
    // The larger component decides, because fingers never move along an axis exactly.
    if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) return send('drag', { dx: -event.deltaX, dy: 0 });
    // Wheels move in large steps, touchpads in small ones.
    const isWheel = Math.abs(event.deltaY) >= WHEEL_STEP_PX / 2 && Number.isInteger(event.deltaY);
    return send('wheel', { steps: -event.deltaY / (isWheel ? WHEEL_STEP_PX : TOUCHPAD_STEP_PX) });
  }

  #share([clientX, clientY]) {
    const { left, top, width, height } = this.#surface.getBoundingClientRect();
    return [(clientX - left) / Math.max(width, 1), (clientY - top) / Math.max(height, 1)];
  }
}

function distance([x0, y0], [x1, y1]) {
  return Math.hypot(x1 - x0, y1 - y0);
}
