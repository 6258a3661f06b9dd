/** A city without an element of its own: it is cast at the cameras of others, as pictures with distances. */

import { deviceValues } from './device.js';
import { cameraText, earthCamera } from './earth-camera.js';
import { EngineClient } from './engine-client.js';
import { lonLatGrid } from './lon-lat.js';
import { returnMemory, takeMemory } from './memory-budget.js';
import { ObjectStates } from './object-states.js';
import { optionMessages, validChanges } from './viewer-options.js';
import { cameraNumbers, isTime } from './view-text.js';
import { startWorker } from './workers.js';

/** A server that does not answer at the start is asked again after this time, and a city that is replaced again sooner is not opened. */
const RETRY_MS = 5000;
const REOPEN_MS = 60_000;
/** Streets and kerbs are ground, too. */
const GROUND_M = 0.5;

/**
 * A picture of a city: see insula-caster.d.ts.
 * @typedef {object} Cast
 * @property {string} camera
 * @property {number} width Of the distances.
 * @property {number} height
 * @property {Uint8ClampedArray|ImageBitmap} colours
 * @property {Float32Array} distances In metres along each ray, row by row from the top; infinite where nothing was hit.
 * @property {boolean} isFinal Whether no later cast of this camera will be finer: known a little after it.
 */

/** The members are documented for users in insula-caster.d.ts of the package. */
export class Caster {
  /** @type {any} */ manifest = null;
  /** @type {import('./lon-lat.js').LonLatGrid|null} */ grid = null;
  /** @type {Cast|null} */ frame = null;
  #options;
  /** @type {EngineClient} */ #engine;
  #states = new ObjectStates((op, values) => this.#engine.send(op, values));
  /** @type {object|null} */ #rules = null;
  #changes = {};
  #camera = '';
  #size = '';
  #hasGround;
  #isDisposed = false;
  #replaced = -Infinity;
  #timer = 0;
  #watch = () => this.#update();

  /** @param {any} options */
  constructor(options) {
    this.#options = options;
    this.#changes = validChanges(options, { hasOthers: true });
    this.#hasGround = options.ground !== false;
    document.addEventListener('visibilitychange', this.#watch);
    this.#open();
  }

  #open() {
    const { url, time = null, adapter = 'auto' } = this.#options;
    const start = () => new Worker(new URL('./cast-engine.js', import.meta.url), { type: 'module' });
    const engine = new EngineClient((message) => this.#engine === engine && this.#receive(message), startWorker('cast-engine.js', start));
    this.#engine = engine;
    [this.#camera, this.#size] = ['', ''];
    const values = {
      src: new URL(url, document.baseURI).href,
      manifest: null,
      camera: null,
      time: isTime(String(time)) ? time : null,
      adapter,
      tau: this.#changes.tau ?? 1,
      width: 1,
      height: 1,
      ...deviceValues(),
      ...takeMemory(this, (share) => engine.send('memory', share)),
    };
    const opened = engine.init(values, []);
    this.#update();
    optionMessages(this.#changes).forEach(([op, message]) => engine.send(op, message));
    this.#states.sendAll();
    if (this.#rules) engine.request('colors', { rules: this.#rules }).catch(() => {});
    /** Ends when the manifest is there. */
    this.opened = opened.then(({ manifest }) => {
      [this.manifest, this.grid] = [manifest, lonLatGrid(manifest)];
      this.#options.onOpen?.(this);
      return this;
    });
    this.opened.catch((error) => this.#fail(engine, error));
  }

  #fail(engine, error) {
    if (this.#isDisposed || engine !== this.#engine) return;
    this.#status({ kind: 'error', text: error.message });
    if (error.isTemporary) this.#timer = setTimeout(() => this.#reopen(), RETRY_MS);
  }

  #reopen() {
    this.#engine.dispose();
    this.#open();
  }

  #receive({ op, ...detail }) {
    if (op === 'cast') {
      // Pictures of a GPU would stay in its memory until the browser looks for what nobody needs.
      if (this.frame?.colours instanceof ImageBitmap) this.frame.colours.close();
      this.frame = { ...detail, isFinal: false };
      this.#options.onFrame?.(this.frame);
    } else if (op === 'rest' && this.frame?.camera === this.#camera) {
      this.frame.isFinal = true;
      this.#options.onFrame?.(this.frame);
    } else if (op === 'status' && detail.kind === 'replaced' && performance.now() - this.#replaced > REOPEN_MS) {
      this.#replaced = performance.now();
      this.#reopen();
    } else if (op === 'status') {
      this.#status(detail);
    } else if (op === 'adapter') {
      this.#options.onAdapter?.(detail);
    }
  }

  #status(status) {
    if (this.#options.onStatus) this.#options.onStatus(status);
    else if (status.kind && status.kind !== 'loading') console.warn(`the city ${this.#options.url}: ${status.text || status.kind}`);
  }

  /** What is lower is not shown: the ground, where others have their own. */
  get lowestM() {
    return this.#hasGround ? -Infinity : this.manifest.ground_z_m + GROUND_M;
  }

  /** Whether the ground is drawn, in a city without hills. @param {boolean} isShown */
  setGround(isShown) {
    this.#hasGround = isShown;
    if (this.frame) this.#options.onFrame?.(this.frame);
  }

  /** Without a camera, or in a page that nobody sees, nothing is fetched. */
  #update() {
    this.#engine.send('visible', { visible: this.#camera !== '' && document.visibilityState !== 'hidden' });
  }

  /** Casts at a camera's text from now on. */
  cast(camera, width, height) {
    const size = `${width} ${height}`;
    if (size !== this.#size) this.#engine.send('resize', { width, height });
    if (camera !== this.#camera) this.#engine.send('camera', { camera, seconds: 0 });
    const isFirst = this.#camera === '';
    [this.#camera, this.#size] = [camera, size];
    if (isFirst) this.#update();
  }

  /** Nothing of the city is in view. */
  rest() {
    if (this.#camera === '') return;
    this.#camera = '';
    this.#update();
  }

  setCamera(camera, { width, height }) {
    const text = typeof camera === 'string' ? camera : cameraText(this.#needGrid(), camera);
    if (!cameraNumbers(text)) throw new RangeError('a camera is X,Y,Z,AZIMUTH,PITCH,FOV in metres and degrees');
    if (typeof camera !== 'string' && camera.roll) throw new RangeError('a cast has a level horizon: its roll is 0');
    this.cast(text, Math.round(width), Math.round(height));
  }

  /** The camera of a cast in degrees. @param {Cast} frame */
  place({ camera }) {
    return earthCamera(this.#needGrid(), camera);
  }

  #needGrid() {
    if (this.grid) return this.grid;
    throw new Error(this.manifest ? 'it is not known where on Earth this city lies: bake it with --crs' : 'no city yet');
  }

  /** What is at shares of the cast's width and height. */
  async pick(x, y) {
    const hit = await this.#engine.request('pick', { x, y });
    if (!hit) return null;
    const id = await this.#engine.request('objectAt', { x, y });
    // A city without objects has surfaces.
    const object = id === null ? null : await this.describe(id).catch(() => null);
    const [lon, lat] = this.grid?.toLonLat(hit.position) ?? [null, null];
    return { ...hit, lon, lat, height: hit.position[2], object };
  }

  async describe(id) {
    return (await this.#engine.request('describe', { object: Number(id) })) ?? null;
  }

  async schema() {
    return this.#engine.request('schema');
  }

  async setColors(rules = null) {
    const found = await this.#engine.request('colors', { rules: rules ?? {} });
    this.#rules = rules;
    return found;
  }

  async setFilter(filter = null) {
    return this.setColors({ ...this.#rules, filter: filter ?? '' });
  }

  setFeatureState(id, state) {
    this.#states.set(id, state);
  }

  getFeatureState(id) {
    return this.#states.get(id);
  }

  outline(ids) {
    this.#engine.send('outline', { objects: [ids].flat().map(Number) });
  }

  setTime(time) {
    if (!isTime(String(time))) throw new RangeError(`${time} is not a time: write YYYY-MM-DDThh:mm`);
    this.#options.time = String(time);
    this.#engine.send('time', { time: String(time) });
  }

  setOptions(values) {
    const changes = validChanges(values);
    Object.assign(this.#changes, changes);
    optionMessages(changes).forEach(([op, message]) => this.#engine.send(op, message));
  }

  dispose() {
    this.#isDisposed = true;
    clearTimeout(this.#timer);
    document.removeEventListener('visibilitychange', this.#watch);
    returnMemory(this);
    this.#engine.dispose();
  }
}

/** A caster, once its city is known. @param {any} options @returns {Promise<Caster>} */
export async function createCaster(options) {
  return new Caster(options).opened;
}
