/** One run of a viewer in an element: its worker, canvases and inputs, until the element is removed or restarts. */

import { deviceValues } from './device.js';
import { element } from './dom.js';
import { EngineClient } from './engine-client.js';
import { GamepadInput } from './input-gamepad.js';
import { KeyboardInput } from './input-keyboard.js';
import { PointerInput } from './input-pointer.js';
import { returnMemory, takeMemory } from './memory-budget.js';
import { strings } from './strings.js';
import { act, changedOptions, optionMessages } from './viewer-options.js';
import { ViewWatch } from './view-watch.js';

/**
 * What a session tells its element.
 * @typedef {object} SessionEvents
 * @property {(message: {op: string}) => void} receive
 * @property {(x: number, y: number, count: number, adds: boolean) => void} click
 * @property {(at: {x: number, y: number}|null) => void} hover
 * @property {(what: 'wheel'|'fingers') => void} refuse The page got a gesture that the city would take otherwise.
 */

/** A running viewer. */
export class ViewerSession {
  /** @type {EngineClient} */ engine;
  /** @type {ViewWatch} */ watch;
  #city;
  #surface;
  #events;
  /** @type {KeyboardInput} */ #keyboard;
  /** @type {PointerInput} */ #pointer;
  /** @type {GamepadInput} */ #gamepad;
  #isDisposed = false;

  /**
   * Starts the viewer of the city that the element's attributes name.
   * @param {import('./insula-city.js').InsulaCity} city
   * @param {HTMLElement} surface Gets the canvases, and is where pointers act.
   * @param {EventTarget} keyTarget
   * @param {SessionEvents} events
   */
  constructor(city, surface, keyTarget, events) {
    [this.#city, this.#surface, this.#events] = [city, surface, events];
    this.engine = new EngineClient((message) => this.#receive(message));
    this.watch = new ViewWatch(city, {
      resize: () => this.engine.send('resize', this.#size()),
      visible: (visible) => this.#setVisible(visible),
    });
    this.#startEngine();
    const send = (op, values) => this.engine.send(op, values);
    this.#gamepad = new GamepadInput({ send, act: (action) => this.#act(action) });
    const press = () => {
      city.focus({ preventScroll: true });
      this.#gamepad.use();
    };
    const actions = { send, click: events.click, hover: events.hover, press, isShy: () => this.#isShy(), refuse: events.refuse };
    this.#pointer = new PointerInput(surface, actions);
    this.#keyboard = this.#keysOf(keyTarget);
  }

  /**
   * Takes keys from another target.
   * @param {EventTarget} target
   */
  listenForKeys(target) {
    this.#keyboard.dispose();
    this.#keyboard = this.#keysOf(target);
  }

  /** Ends the viewer. */
  dispose() {
    [this.#keyboard, this.#pointer, this.#gamepad, this.watch].forEach((part) => part.dispose());
    this.engine.dispose();
    returnMemory(this);
    this.#isDisposed = true;
  }

  #startEngine() {
    const city = this.#city;
    const canvases = ['cpu', 'gpu'].map((kind) => element('canvas', { class: kind, 'aria-hidden': 'true' }));
    this.#surface.replaceChildren(...canvases);
    const [canvasCpu, canvasGpu] = canvases.map((canvas) => canvas.transferControlToOffscreen());
    const values = {
      src: new URL(city.getAttribute('src') ?? '', document.baseURI).href,
      manifest: city.manifest,
      camera: city.getAttribute('camera'),
      time: city.getAttribute('time'),
      adapter: city.getAttribute('adapter') ?? 'auto',
      tau: city.options.tau,
      canvasCpu,
      canvasGpu,
      ...this.#size(),
      ...deviceValues(),
      ...takeMemory(this, (share) => this.engine.send('memory', share)),
    };
    this.#receive({ op: 'status', kind: 'loading', text: '' });
    this.engine.init(values, [canvasCpu, canvasGpu]).catch(({ message, isTemporary }) => {
      this.#receive({ op: 'status', kind: 'error', text: message, isTemporary });
    });
    optionMessages(changedOptions(city.options)).forEach(([op, message]) => this.engine.send(op, message));
  }

  #receive(message) {
    // Without an origin of its own, a frame may fetch neither the viewer nor the city.
    if (message.kind === 'error' && self.origin === 'null') Object.assign(message, { text: strings.status.sandboxed, isTemporary: false });
    if (!this.#isDisposed) this.#events.receive(message);
  }

  #keysOf(target) {
    const send = (op, values) => this.engine.send(op, values);
    return new KeyboardInput(target, { send, act: (action, value) => this.#act(action, value) });
  }

  #act(action, value = 0) {
    if (action === 'middle') this.#events.click(0.5, 0.5, 1, false);
    else act(this.#city, action, value);
  }

  /** Whether gestures that scroll a page are the page's: the element stands in an article, and is not being used. */
  #isShy() {
    return this.#city.getAttribute('gestures') === 'cooperative' && !this.#city.matches(':focus, :focus-within, :fullscreen');
  }

  #setVisible(visible) {
    this.#gamepad.isVisible = visible;
    this.engine.send('visible', { visible });
  }

  #size() {
    return { width: this.watch.width, height: this.watch.height };
  }
}
