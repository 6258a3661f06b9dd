/**
 * The custom element <insula-city>: a city in any page. Its work is done in a worker; this file connects both.
 *
 * The entries define it: `app.js` as it is, `insula-viewer.js` with what only pages of others need.
 */

import { wantsLessMotion } from './device.js';
import { element, printable, svg } from './dom.js';
import { ElementNotices } from './element-notices.js';
import { ElementObjects } from './element-objects.js';
import { applyStyle } from './element-style.js';
import { Overlay } from './overlay.js';
import { strings } from './strings.js';
import { cameraNumbers, isTime } from './view-text.js';
import { defaultOptions, optionMessages, validChanges } from './viewer-options.js';
import { ViewerSession } from './viewer-session.js';

/** An element that was removed, and not only moved, ends its viewer after this time. */
const DISPOSE_MS = 1000;
const FLIGHT_SECS = 1.5;
/** A city that is replaced again sooner is opened again by people only. */
const REOPEN_MS = 60_000;
const MAX_HITS = 20;
/** A server that does not answer at the start is asked again after these times, of which the last is repeated. */
const RETRY_MS = [1000, 2000, 4000, 8000, 15_000, 30_000];

/** Servers that render pages import the element, and never make one. */
const Base = globalThis.HTMLElement ?? class {};

/** The members are documented for users in insula-viewer.d.ts of the package. */
export class InsulaCity extends Base {
  static observedAttributes = ['src', 'camera', 'time', 'adapter', 'tau'];

  options = defaultOptions();
  /** Manifest of the city: set by a page that has it already, or loaded by the engine. @type {object|null} */
  manifest = null;
  #surface = element('div', { class: 'surface' });
  #overlay = new Overlay(this, (what) => this.#sendPoints(what));
  #notices = new ElementNotices();
  #objects = new ElementObjects({
    ask: (op, values) => this.#ask(op, values),
    send: (op, values) => this.#send(op, values),
    emit: (name, detail) => this.#emit(name, detail),
  });
  /** @type {ViewerSession|null} */ #session = null;
  /** @type {EventTarget} */ #keyTarget = this;
  /** The last frame's message. @type {any} */ #frame = null;
  /** Details of the last event of each name. @type {Record<string, any>} */
  last = {};
  #disposal = 0;
  #reopened = -Infinity;
  /** Attempts to start since the last picture, and the timer of the next one. */
  #attempts = 0;
  #retry = 0;
  #isMeasuring = false;
  /** @type {string|undefined} */ #measureKind;
  /** The label that this file has set; `null` before. @type {string|null} */ #ownLabel = null;

  constructor() {
    super();
    const root = this.attachShadow({ mode: 'open' });
    applyStyle(root);
    const cross = 'M12.5 1v9m0 5v9M1 12.5h9m5 0h9';
    const aim = svg('svg', { class: 'aim', viewBox: '0 0 25 25' }, svg('path', { d: cross }), svg('path', { d: cross }));
    root.append(this.#surface, ...this.#overlay.nodes, aim, ...this.#notices.nodes, element('slot'));
    // A click may follow, which then needs one request; the first picture is not to wait for what answers it. A city without objects says
    // so when it is clicked.
    const prepare = () => this.#ask('schema').catch(() => {});
    const enter = () => (this.last.ready ? prepare() : this.addEventListener('ready', prepare, { once: true }));
    this.#surface.addEventListener('pointerenter', enter, { once: true });
  }

  connectedCallback() {
    clearTimeout(this.#disposal);
    if (!this.hasAttribute('tabindex')) this.tabIndex = 0;
    if (!this.hasAttribute('role')) this.setAttribute('role', 'application');
    this.describeInWords();
    if (this.#session) this.#send('visible', { visible: true });
    else this.#startSoon();
  }

  disconnectedCallback() {
    this.#send('visible', { visible: false });
    this.#disposal = setTimeout(() => this.#dispose(), DISPOSE_MS);
  }

  attributeChangedCallback(name, before, value) {
    if (before === value) return;
    if (name === 'src' || name === 'adapter') {
      if (name === 'src' && before !== null) {
        this.manifest = null;
        this.#objects.forget();
      }
      this.restart();
    }
    if (!this.#session || value === null) return;
    if (name === 'camera') this.flyTo(value, { seconds: 0 }).catch(() => {});
    if (name === 'time') this.setTime(value);
    if (name === 'tau') this.setOptions({ tau: Number(value) });
  }

  /** Says in the language of the page what the element is. */
  describeInWords() {
    this.setAttribute('aria-roledescription', strings.element.role);
    this.setAttribute('aria-description', strings.element.keys);
    this.#label();
  }

  /** The last drawn view; `null` before the first picture. */
  get view() {
    return this.#frame;
  }

  restart() {
    this.#dispose();
    this.#startSoon();
  }

  async flyTo(place, { seconds = FLIGHT_SECS } = {}) {
    const duration = wantsLessMotion() ? 0 : Math.max(Number(seconds) || 0, 0);
    const numbers = Array.isArray(place) ? place.map(Number) : cameraNumbers(String(place));
    if (numbers?.length === 3 && numbers.every(Number.isFinite)) {
      return this.#fly('goto', { position: numbers, seconds: duration });
    }
    const camera = numbers?.join(',') ?? '';
    if (!cameraNumbers(camera)) throw new RangeError(strings.element.noCamera);
    return this.#fly('camera', { camera, seconds: duration });
  }

  /** Moves the camera. Ends when it has arrived, and a picture from there is shown. */
  async #fly(op, values) {
    this.#send(op, values);
    await this.#ask('arrival', {}).catch(() => {});
  }

  setTime(time) {
    if (isTime(String(time))) this.#send('time', { time: String(time) });
  }

  /** The selected objects. */
  get selection() {
    return this.#objects.selection;
  }

  async setColors(rules = null) {
    return this.#objects.setColors(rules);
  }

  async select(ids) {
    return this.#objects.select([ids].flat().map(Number));
  }

  async describe(id) {
    return this.#objects.describe(id);
  }

  async schema() {
    return this.#objects.schema();
  }

  async search(text, { limit = MAX_HITS } = {}) {
    return this.#objects.search(text, limit);
  }

  setOptions(values) {
    const changes = validChanges(values);
    Object.assign(this.options, changes);
    optionMessages(changes).forEach(([op, message]) => this.#send(op, message));
    this.#emit('options', { ...this.options, changes });
  }

  async pick(x, y) {
    return this.#ask('pick', { x: x / Math.max(this.clientWidth, 1), y: y / Math.max(this.clientHeight, 1) });
  }

  async screenshot({ width, height, caption = [] } = {}) {
    const { width: w, height: h } = this.#session?.watch ?? { width: 1, height: 1 };
    const lines = [caption].flat().map(String);
    return this.#ask('screenshot', { width: Math.round(width ?? w), height: Math.round(height ?? h), caption: lines });
  }

  addMarker(marker) {
    return this.#overlay.addMarker(marker);
  }

  addLine(line) {
    return this.#overlay.addLine(line);
  }

  measure(action, kind) {
    if (action === 'start' || action === 'stop') this.#isMeasuring = action === 'start';
    this.#measureKind = kind ?? this.#measureKind;
    this.#surface.classList.toggle('measuring', this.#isMeasuring);
    this.#send('measure', { action, kind });
  }

  steer(op, values = {}) {
    this.#send(op, values);
  }

  listenForKeys(target) {
    this.#keyTarget = target;
    this.#session?.listenForKeys(target);
  }

  /** Starts after the running script, which may set the manifest and the first view. */
  #startSoon() {
    queueMicrotask(() => this.isConnected && !this.#session && this.hasAttribute('src') && this.#start());
  }

  #start() {
    const tau = this.getAttribute('tau');
    if (tau !== null) Object.assign(this.options, validChanges({ tau: Number(tau) }));
    this.#session = new ViewerSession(this, this.#surface, this.#keyTarget, {
      receive: (message) => this.#receive(message),
      click: (x, y, count, adds) => this.#click(x, y, count, adds),
      hover: (at) => this.#hover(at),
      refuse: (what) => this.#notices.showGesture(what),
    });
    this.#sendPoints('markers');
    this.#sendPoints('lines');
    this.#objects.restart();
    if (!this.#isMeasuring) return;
    this.measure('start');
    this.measure('kind', this.#measureKind);
  }

  #dispose() {
    clearTimeout(this.#retry);
    this.#session?.dispose();
    this.#session = this.#frame = null;
    this.last = {};
  }

  #receive({ op, ...detail }) {
    if (op === 'frame') return this.#showFrame(detail);
    if (op === 'ready') {
      this.#attempts = 0;
      this.manifest = detail.manifest ?? this.manifest;
      this.#label();
      this.#notices.showAttribution(this.manifest);
    }
    if (op === 'status' && detail.kind === 'replaced') {
      if (performance.now() - this.#reopened > REOPEN_MS) return this.#reopen();
      detail.kind = 'error';
    }
    // The page has its own words for it. The browser's console has the reason.
    if (detail.kind === 'offline') detail.text = '';
    if (op === 'status' && detail.isTemporary) this.#retryLater(detail);
    if (op === 'status') this.#notices.showStatus(detail);
    if (op === 'adapter') this.#surface.dataset.adapter = detail.kind;
    this.#emit(op, detail);
    return undefined;
  }

  /** The server did not answer at the start: it may be starting itself. */
  #retryLater(detail) {
    console.warn(detail.text);
    [detail.kind, detail.text] = ['waiting', strings.status.waiting];
    const waitMs = RETRY_MS[Math.min(this.#attempts++, RETRY_MS.length - 1)];
    clearTimeout(this.#retry);
    this.#retry = setTimeout(() => this.isConnected && this.restart(), waitMs);
  }

  /** Opens the version that the city has now, at the same view. */
  #reopen() {
    this.#reopened = performance.now();
    const camera = this.#frame?.camera;
    this.manifest = null;
    this.#objects.forget();
    this.restart();
    if (camera) this.camera = camera;
    return undefined;
  }

  #showFrame(frame) {
    const isMoved = frame.camera !== this.#frame?.camera;
    this.#frame = frame;
    if (frame.mode) this.options.mode = frame.mode;
    this.#overlay.update(frame, this.#session?.watch.ratio ?? 1);
    this.#emit('frame', frame);
    const { camera, position, azimuth, pitch } = frame;
    if (isMoved) this.#emit('camera', { camera, position, azimuth, pitch });
  }

  async #click(x, y, count, adds) {
    if (this.#isMeasuring) return this.#send('measure', { action: 'click', x, y });
    if (count === 2) return this.#send('approach', { x, y });
    const hit = await this.pick(x * this.clientWidth, y * this.clientHeight).catch(() => null);
    if (!hit) return this.#objects.click(null, adds);
    let [object, error, fault] = [null, '', undefined];
    try {
      const id = await this.#ask('objectAt', { x, y });
      object = id === null ? null : await this.describe(id);
    } catch (reason) {
      ({ message: error, fault } = reason);
    }
    if (this.#emit('pick', { ...hit, object, error, fault, adds }, true)) this.#objects.click(object, adds);
    return undefined;
  }

  /** Outlines the object under a resting mouse. Only on a GPU: on the CPU, a frame for each takes too long. */
  #hover(at) {
    const hasOutline = at !== null && !this.#isMeasuring && this.#surface.dataset.adapter === 'gpu';
    this.#objects.hover(hasOutline ? this.#ask('objectAt', at).catch(() => null) : Promise.resolve(null));
  }

  #send(op, values) {
    this.#session?.engine.send(op, values);
  }

  /** Asks the engine. Not for users: the messages change. */
  ask(op, values) {
    return this.#ask(op, values);
  }

  async #ask(op, values) {
    if (!this.#session) throw new Error(strings.element.notRunning);
    return this.#session.engine.request(op, values);
  }

  #sendPoints(what) {
    if (what === 'markers') this.#send('markers', { points: this.#overlay.markerPoints });
    else this.#send('lines', { lines: this.#overlay.linePoints });
  }

  #label() {
    const title = printable(this.manifest?.title);
    const label = title ? strings.element.label(title) : strings.element.labelWithoutTitle;
    if (this.getAttribute('aria-label') !== this.#ownLabel) return;
    this.#ownLabel = label;
    this.setAttribute('aria-label', label);
  }

  /** Returns whether no listener has prevented what follows. */
  #emit(name, detail, cancelable = false) {
    this.last[name] = detail;
    return this.dispatchEvent(new CustomEvent(name, { detail, cancelable }));
  }
}

// Gestures are looked up when one begins.
for (const name of [...InsulaCity.observedAttributes, 'gestures']) {
  Object.defineProperty(InsulaCity.prototype, name, {
    configurable: true,
    enumerable: true,
    get() {
      return this.getAttribute(name);
    },
    set(value) {
      if (value == null) this.removeAttribute(name);
      else this.setAttribute(name, String(value));
    },
  });
}
