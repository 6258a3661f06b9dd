/** What owns a viewer in a worker: takes messages of the page, runs the frame loop, and reports. */

import init, { CityViewer } from './insula_web.js';
import { captioned } from './canvas.js';
import { Helpers, fetchMeshes } from './helpers.js';
import { Network, compileGpu, compileObjects, compileViewer, fetchShaders, locate } from './network.js';

/** Attempts to get a lost GPU back, and the time between them. */
const MAX_REOPENINGS = 3;
const REOPEN_MS = 3000;

/** The module is fetched before the page says what to show. */
const compiled = compileViewer();
// Its failure is reported when it is waited for.
compiled.catch(() => {});

/**
 * What shows frames. All but `show` may be left out.
 * @typedef {object} Screen
 * @property {(image: ImageData) => void} show A frame of the CPU is complete.
 * @property {(step: object) => void} [begin] A step of a frame begins.
 * @property {(step: object, hit: Uint32Array) => void} [rows] Rows were drawn: for each its nodes, then its distances.
 * @property {(viewer: CityViewer, waitMs: number) => void} [rest] Nothing is drawn for this time, unless something changes.
 * @property {(gpu: import('./insula_web_gpu.js').GpuRenderer, step: object) => Promise<void>} [drawn] The GPU is drawing a frame: called in the task that began it.
 */

export class Engine {
  #makeScreen;
  #network = new Network();
  /** @type {CityViewer} */ #viewer;
  /** Where the city is, and its manifest. @type {{manifest: string, base: string, isFolder: boolean, query: string}} */ #city;
  /** What reads its objects; `null` before the first question. @type {Promise<import('./insula_web_objects.js').ObjectReader>|null} */ #objects = null;
  /** @type {Helpers} */ #helpers;
  /** @type {Screen} */ #screen;
  /** @type {any} */ #options;
  /** What draws on a GPU; `null` while the CPU does. @type {import('./insula_web_gpu.js').GpuRenderer|null} */ #gpu = null;
  /** Whether the page knows that a GPU draws. */
  #isGpu = false;
  #isShown = false;
  #isVisible = true;
  #isRunning = false;
  #isDrawing = false;
  #isDue = false;
  /** Bytes of the atlas of each worker, and whether they are to become fewer. */
  #cacheBytes = 0;
  #isShrinking = false;
  #timer = 0;
  #reopenings = 0;
  #lastMissing = -1;
  /** Changes of colours that were asked for. */
  #colorings = 0;
  /** Pictures that were asked for; the first is being made.
   * @type {{id: number, width: number, height: number, caption: string[]}[]} */
  #pictures = [];
  /** Messages about models, which change between frames: all tiles are fetched again. @type {any[]} */ #models = [];
  /** The end of packing: messages about models stay in order. */
  #packed = Promise.resolve();
  /** What is known of named models, by number. @type {Map<number, import('./messages.js').ObjectMessage>} */ #named = new Map();
  /** Who waits for the end of a flight, and whether the camera has moved since.
   * @type {{id: number, isUnderWay: boolean}[]} */
  #arrivals = [];
  /** Messages that arrived before the viewer. @type {object[]|null} */ #early = [];

  /** @param {(options: any) => Screen} makeScreen */
  constructor(makeScreen) {
    this.#makeScreen = makeScreen;
  }

  /** Starts a viewer. `receive` gets the messages that came before it. */
  async start(options, receive) {
    this.#options = options;
    this.#screen = this.#makeScreen(options);
    this.#helpers = new Helpers(compiled, options.workers);
    const [city] = await Promise.all([
      locate(this.#network, options.src, options.manifest),
      compiled.then((module) => init({ module_or_path: module })),
    ]);
    const cacheBytes = (this.#cacheBytes = options.cacheMib * 2 ** 20);
    this.#helpers.resetAtlas(cacheBytes);
    const { width, height, camera, time, tau } = options;
    const values = { ...city, width, height, cacheBytes, camera, time, tau };
    this.#viewer = new CityViewer(this.#host(), JSON.stringify(values));
    this.#city = city;
    this.manifest = JSON.parse(city.manifest);
    const early = this.#early;
    this.#early = null;
    early.forEach(receive);
    this.#reportCpu(this.#whyCpu());
    this.wake();
    return { manifest: this.manifest };
  }

  /** What the crate needs of the page. */
  #host() {
    return {
      fetch: (url, range, limit, request) => this.#network.fetch(url, range, limit, request),
      abort: (request) => this.#network.abort(request),
      bypassCaches: () => this.#network.bypassCaches(),
      decode: (key, bytes) => this.#helpers.decode([...key], bytes),
      shaders: fetchShaders,
      wake: () => this.wake(),
    };
  }

  /** Why no GPU draws; empty while one may be found. */
  #whyCpu() {
    const { adapter, hasGpu, secure } = this.#options;
    if (adapter === 'cpu') return 'the CPU was asked for';
    if (!secure) return 'no WebGPU on plain http';
    return hasGpu ? '' : 'this browser has no WebGPU';
  }

  #reportCpu(why) {
    const name = `CPU, ${this.#helpers.count} workers`;
    postMessage({ op: 'adapter', kind: 'cpu', name, why });
    if (why) this.#viewer.refuseGpu();
  }

  /** Something changed: the frame loop goes on. */
  wake() {
    this.#isDue = true;
    if (this.#isDrawing) this.#viewer.updateWhileDrawing();
    if (this.#isRunning || !this.#viewer) return;
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#run(), 0);
  }

  async #run() {
    if (this.#isRunning || !this.#isVisible) return;
    this.#isRunning = true;
    let waitMs = 0;
    try {
      while (waitMs === 0 && this.#isVisible) {
        this.#isDue = false;
        waitMs = await this.#step();
        if (this.#isDue) waitMs = 0;
      }
    } catch (error) {
      console.error(error);
      postMessage({ op: 'status', kind: 'error', text: `the viewer stopped: ${error?.message ?? error}` });
      return;
    }
    this.#isRunning = false;
    this.#timer = setTimeout(() => this.#run(), Math.min(waitMs, 2 ** 30));
  }

  /** One step of the frame loop. Returns how long to wait before the next. */
  async #step() {
    const lost = this.#gpu?.lost();
    if (lost !== undefined) this.#loseGpu(lost);
    const hits = this.#gpu?.takeHits();
    if (hits) this.#viewer.reportGpuHits(hits);
    if (this.#isShrinking) await this.#shrink();
    this.#changeModels();
    const step = JSON.parse(this.#viewer.update());
    this.#arrivals.forEach((arrival) => (arrival.isUnderWay = true));
    this.#report();
    if (step.action === 'none') {
      this.#announceArrivals();
      this.#screen.rest?.(this.#viewer, step.waitMs);
      // Messages must be received although the loop goes on.
      if (step.waitMs === 0) await new Promise((resolve) => setTimeout(resolve, 10));
      return step.waitMs;
    }
    this.#screen.begin?.(step);
    const begin = performance.now();
    this.#isDrawing = true;
    try {
      if (step.action === 'gpu') await this.#drawOnGpu(step, begin).catch((error) => this.#loseGpu(error.message));
      else await this.#drawRows(step, begin);
    } finally {
      this.#isDrawing = false;
    }
    return 0;
  }

  async #drawRows(step, begin) {
    if (step.hasWrites) this.#helpers.write(this.#viewer.takeWrites());
    if (step.isNew) this.#helpers.begin(this.#viewer.frameWords());
    const { words, hit } = await this.#helpers.draw(step.width, step.first, step.end);
    this.#screen.rows?.(step, hit);
    const ms = performance.now() - begin;
    const pixels = this.#viewer.rowsDrawn(words, hit, ms);
    if (!pixels) return;
    const image = new ImageData(new Uint8ClampedArray(pixels.buffer), step.width, step.height);
    if (step.isPicture) return this.#finishPicture(image);
    // Frames of another size, whose hits a picture needs, are not for the screen.
    if (this.#pictures.length > 0) return;
    // A sky without a city is not shown first.
    if (!this.#isShown && !this.#viewer.has_frame()) return;
    this.#screen.show(image);
    this.#presented(step, ms);
  }

  async #drawOnGpu(step, begin) {
    const gpu = this.#gpu;
    gpu.write(this.#viewer.takeWrites());
    const drawn = gpu.draw(this.#viewer.frameWords(), step.width * step.divisor, step.height * step.divisor);
    if (gpu.countsLast()) this.#viewer.gpuCounts();
    // The picture must be taken in the task that drew it.
    const bitmap = step.isPicture ? this.#options.canvasGpu.transferToImageBitmap() : null;
    const shown = this.#screen.drawn?.(gpu, step);
    await drawn;
    await shown;
    const ms = performance.now() - begin;
    this.#viewer.gpuDrawn(ms);
    if (bitmap) return this.#finishPicture(bitmap);
    if (!this.#isGpu) {
      this.#isGpu = true;
      postMessage({ op: 'adapter', kind: 'gpu', name: this.gpuName, why: '' });
    }
    this.#presented(step, ms);
  }

  /** A frame is on the screen. */
  #presented({ divisor, samples, isFinal }, frameMs) {
    postMessage({ ...JSON.parse(this.#viewer.frame()), frameMs, divisor, samples, final: isFinal });
    this.#announceArrivals();
    if (this.#isShown || !this.#viewer.has_frame()) return;
    this.#isShown = true;
    postMessage({ op: 'ready', manifest: this.manifest });
    fetchMeshes();
    // The first picture does not wait for a GPU, whose pipelines may take seconds.
    if (!this.#whyCpu()) this.#openGpu();
  }

  /** The camera is where it was sent, or elsewhere, and is seen from there. */
  #announceArrivals() {
    if (this.#arrivals.length === 0 || this.#viewer.isFlying()) return;
    const arrived = this.#arrivals.filter(({ isUnderWay }) => isUnderWay);
    this.#arrivals = this.#arrivals.filter(({ isUnderWay }) => !isUnderWay);
    arrived.forEach(({ id }) => reply(id, Promise.resolve(null)));
  }

  arrival({ id }) {
    this.#arrivals.push({ id, isUnderWay: false });
    this.wake();
  }

  #report() {
    const status = this.#viewer.status();
    if (status) postMessage(JSON.parse(status));
    const missing = this.#viewer.missing();
    if (missing === this.#lastMissing) return;
    this.#lastMissing = missing;
    const { bytes, requests } = this.#network;
    postMessage({ op: 'progress', missing, bytes, requests, final: missing === 0 });
  }

  async #openGpu() {
    const { canvasGpu, gpuMib, adapter } = this.#options;
    try {
      // Browsers have WebGPU where there is no adapter, too.
      if (!(await navigator.gpu?.requestAdapter())) throw new Error('no graphics adapter');
      const { GpuRenderer } = await bound(
        () => import(/* @vite-ignore */ /* webpackIgnore: true */ /* turbopackIgnore: true */ new URL('./insula_web_gpu.js', import.meta.url).href),
        compileGpu(),
      );
      const gpu = await GpuRenderer.open(this.#host(), canvasGpu, gpuMib * 2 ** 20, adapter === 'gpu');
      gpu.write(this.#viewer.useGpu(gpu.pages()));
      this.gpuName = gpu.name();
      this.#gpu = gpu;
      await this.#renewHelpers(0);
      this.wake();
    } catch (error) {
      this.#reportCpu(String(error?.message ?? error));
    }
  }

  /** The share of the page's memory that this viewer has from now on. @param {{cacheMib: number, gpuMib: number}} share */
  memory({ cacheMib, gpuMib }) {
    Object.assign(this.#options, { cacheMib, gpuMib });
    this.#isShrinking = true;
    this.wake();
  }

  /** Takes less memory. A GPU keeps its atlas, which is not of the page's memory. */
  async #shrink() {
    this.#isShrinking = false;
    const cacheBytes = this.#options.cacheMib * 2 ** 20;
    if (this.#isGpu || cacheBytes >= this.#cacheBytes) return;
    this.#cacheBytes = cacheBytes;
    await this.#renewHelpers(cacheBytes);
    this.#viewer.resizeCache(cacheBytes);
  }

  /** Replaces the workers by others: the memory of a module never becomes smaller. */
  async #renewHelpers(cacheBytes) {
    const old = this.#helpers;
    this.#helpers = new Helpers(compiled, old.count);
    await compiled;
    this.#helpers.resetAtlas(cacheBytes);
    old.retire();
  }

  #loseGpu(reason) {
    this.#gpu?.free();
    this.#gpu = null;
    this.#isGpu = false;
    this.#cacheBytes = this.#options.cacheMib * 2 ** 20;
    this.#helpers.resetAtlas(this.#cacheBytes);
    this.#viewer.loseGpu(this.#cacheBytes);
    this.#reportCpu(`the device was lost: ${reason || 'no reason given'}`);
    if (this.#reopenings++ < MAX_REOPENINGS) setTimeout(() => this.#openGpu(), REOPEN_MS);
  }

  /** Keeps a message for later if there is no viewer yet. Returns whether it did. */
  keeps(message) {
    this.#early?.push(message);
    return this.#early !== null;
  }

  picture({ id, width, height, caption = [] }) {
    this.#pictures.push({ id, width, height, caption });
    if (this.#pictures.length === 1) this.#makePicture();
  }

  #makePicture() {
    const [{ width, height }] = this.#pictures;
    this.#viewer.makePicture(width, height);
    this.wake();
  }

  #finishPicture(image) {
    const { id, caption } = this.#pictures.shift();
    reply(id, captioned(image, caption));
    if (this.#pictures.length > 0) this.#makePicture();
  }

  visible({ visible }) {
    this.#isVisible = visible;
    if (visible) this.wake();
  }

  pick({ id, x, y }) {
    const [px, py, pz, distance] = this.#viewer.pick(x, y);
    reply(id, Promise.resolve(distance === undefined ? null : { position: [px, py, pz], distance }));
  }

  /** The number of the object that a place of the view shows, or `null`. The device that draws casts the ray. */
  objectAt({ id, x, y }) {
    const probe = async () => {
      const [writes, words] = [this.#viewer.takeWrites(), this.#viewer.probeWords(x, y)];
      (this.#gpu ?? this.#helpers).write(writes);
      return this.#gpu ? new Uint32Array((await this.#gpu.probe(words)).buffer)[0] : this.#helpers.probe(words);
    };
    reply(id, probe().then((word) => this.#viewer.objectOf(word) ?? null));
  }

  /**
   * What reads the objects. Its module is fetched at the first question, and again if that failed.
   * @returns {Promise<import('./insula_web_objects.js').ObjectReader>}
   */
  #reader() {
    this.#objects ??= this.#openObjects().catch((error) => {
      this.#objects = null;
      throw error;
    });
    return this.#objects;
  }

  async #openObjects() {
    const { ObjectReader } = await bound(
      () => import(/* @vite-ignore */ /* webpackIgnore: true */ /* turbopackIgnore: true */ new URL('./insula_web_objects.js', import.meta.url).href),
      compileObjects(),
    );
    const { manifest, base, isFolder, query } = this.#city;
    return new ObjectReader(this.#host(), manifest, base, isFolder, query);
  }

  describe({ id, object }) {
    const named = [...this.#named.values()].find((known) => known.id === object);
    reply(id, named ? Promise.resolve(named) : this.#reader().then((reader) => reader.describe(object)).then(parsed));
  }

  search({ id, text, limit }) {
    reply(id, this.#reader().then((reader) => reader.search(text, limit)).then(parsed));
  }

  schema({ id }) {
    reply(id, this.#reader().then((reader) => reader.schema()).then(parsed));
  }

  colors({ id, rules }) {
    const number = ++this.#colorings;
    const color = async () => {
      const reader = await this.#reader();
      const made = await reader.styles(JSON.stringify(rules));
      const message = parsed(made.message());
      // A later change is not undone by an earlier one that took longer.
      if (number === this.#colorings) this.#viewer.setStyles(made.words());
      made.free();
      this.wake();
      return message;
    };
    reply(id, color());
  }

  outline({ objects }) {
    this.#viewer.outline(new Uint32Array(objects));
    this.wake();
  }

  states({ objects, states }) {
    this.#viewer.setStates(new Uint32Array(objects), new Int32Array(states));
    this.wake();
  }

  /** Heights of the city at places `x, y, x, y, ...`. */
  heights({ id, places }) {
    reply(id, Promise.resolve(this.#viewer.surfaceHeights(places)));
  }

  /** Which of the points `x, y, z, x, y, z, ...` nothing hides. */
  seen({ id, points }) {
    reply(id, Promise.resolve(this.#viewer.seenPoints(points)));
  }

  addModel(message) {
    this.#changeModel(this.#helpers.pack(message).then((packed) => ({ ...message, packed })), message.id);
  }

  removeModel(message) {
    this.#changeModel(Promise.resolve(message), message.id);
  }

  /** @param {Promise<object>} change @param {number} id Of the request, which has the reason if there is no change. */
  #changeModel(change, id) {
    // Nothing else is wrong with what the page has read, unless what packs it has not come.
    const fault = (error) => (error.isTemporary ? undefined : { code: 'models' });
    const refuse = (error) => reply(id, Promise.reject(Object.assign(error, { fault: fault(error) })));
    change.catch(() => {});
    this.#packed = this.#packed.then(() => change).then((message) => {
      this.#models.push(message);
      this.wake();
    }).catch(refuse);
  }

  showModels({ shown }) {
    this.#viewer.showModels(shown);
    this.wake();
  }

  #changeModels() {
    for (const { op, id, number, origin, positions, packed, name } of this.#models.splice(0)) {
      const change = async () => {
        this.#named.delete(number);
        if (op === 'removeModel') this.#viewer.removeModel(number);
        else {
          const object = this.#viewer.addModel(number, packed, name !== undefined);
          if (object !== undefined) this.#named.set(number, namedModel(object, name, origin, positions));
        }
        return null;
      };
      // Nothing else is wrong with what the page has read.
      const tooLarge = (error) => Promise.reject(Object.assign(error, { fault: { code: 'models' } }));
      reply(id, change().catch(tooLarge));
    }
  }

  loseDevice() {
    this.#gpu?.destroy();
    setTimeout(() => this.wake(), 100);
  }

  command(message) {
    const { op, ...values } = message;
    this.#viewer.command(JSON.stringify({ [op]: op === 'measure' ? measureCommand(values) : values }));
    this.wake();
    // The figure and the markers may have changed although the picture has not.
    if (this.#isShown && ['markers', 'lines', 'measure'].includes(message.op)) {
      postMessage({ ...JSON.parse(this.#viewer.frame()), final: true });
    }
  }

  dispose() {
    this.#isVisible = false;
    this.#helpers?.dispose();
    close();
  }
}

/**
 * A module with its script. Bundlers make one script of a worker, and copy files that are named like these. A script is not asked for while
 * its module cannot be fetched: browsers may remember that it failed.
 * @param {() => Promise<any>} script
 * @param {Promise<WebAssembly.Module>} compiled
 */
async function bound(script, compiled) {
  const module = await compiled;
  const bindings = await script();
  await bindings.default({ module_or_path: module });
  return bindings;
}

/** What the measuring tool does, as the crate reads it. */
function measureCommand({ action, ...values }) {
  return { [action]: values };
}

/** A message of the crate; `undefined` if there is none. @param {string|undefined} json */
function parsed(json) {
  return json === undefined ? undefined : JSON.parse(json);
}

/** Requests and commands that the engine itself carries out. */
const OWN = ['memory', 'arrival', 'pick', 'objectAt', 'loseDevice', 'describe', 'search', 'schema', 'colors', 'outline', 'states', 'heights', 'seen', 'addModel', 'removeModel', 'showModels'];

/** What is known of a model: its name, and the middle of the box around it. */
function namedModel(id, identifier, origin, positions) {
  const [low, high] = [origin.map(() => Infinity), origin.map(() => -Infinity)];
  positions.forEach((value, i) => {
    low[i % 3] = Math.min(low[i % 3], value);
    high[i % 3] = Math.max(high[i % 3], value);
  });
  const centre = origin.map((value, axis) => value + (low[axis] + high[axis]) / 2);
  return { id, identifier, parent: null, kind: 'proposal', attributes: {}, centre, parts: [] };
}

/** Answers a request with a value, or with the reason why there is none. */
function reply(id, value) {
  value.then(
    (result) => postMessage({ op: 'reply', id, value: result }),
    (error) => postMessage({ op: 'reply', id, error: String(error?.message ?? error), isTemporary: error?.isTemporary === true, fault: error?.fault }),
  );
}

/**
 * Gives an engine the messages of its page.
 * @param {Engine} engine
 */
export function serve(engine) {
  const receive = (message) => {
    const { op, id } = message;
    try {
      if (op === 'screenshot') engine.picture(message);
      else if (OWN.includes(op)) engine[op](message);
      else engine.command(message);
    } catch (error) {
      if (id === undefined) console.warn(`${op}: ${error?.message ?? error}`);
      else reply(id, Promise.reject(error));
    }
  };
  addEventListener('message', ({ data }) => {
    if (data.op === 'init') reply(data.id, engine.start(data, receive));
    else if (data.op === 'visible' || data.op === 'dispose') engine[data.op](data);
    else if (!engine.keeps(data)) receive(data);
  });
}
