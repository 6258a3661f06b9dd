/** The workers that decode tiles and draw rows for the engine. */

import { compileMeshes } from './network.js';
import { startWorker } from './workers.js';

/** Rows keep a worker as busy as this many tiles. */
const ROWS_WEIGHT = 8;

/** Kind of a mesh in a tile's key. */
const MESH = 2;

/** Ends the wait for the first picture, which needs no mesh. */
let endWait = () => {};
const firstPicture = new Promise((resolve) => (endWait = resolve));

/** Lets meshes be decoded: the first picture is shown, and what decodes them no longer delays it. */
export function fetchMeshes() {
  endWait();
}

/** What decodes meshes, before the first of them; `null` before, and after it could not be fetched. @type {Promise<WebAssembly.Module>|null} */
let meshes = null;

function compiledMeshes() {
  meshes ??= firstPicture.then(compileMeshes).catch((error) => {
    meshes = null;
    throw error;
  });
  return meshes;
}

/** Workers copy what they are to write: most words of it at once. The memory of a module never becomes smaller. */
const MAX_WRITE_WORDS = 1 << 18;

/** Writes in parts that are not long. @param {Uint32Array} words As `page_writes` of the crate makes them. */
function* partsOf(words) {
  let begin = 0;
  for (let at = 0; at < words.length; at += 3 + words[at + 2]) {
    if (at - begin < MAX_WRITE_WORDS) continue;
    yield words.slice(begin, at);
    begin = at;
  }
  yield words.slice(begin);
}

function startHelper() {
  return startWorker('helper.js', () => new Worker(new URL('./helper.js', import.meta.url), { type: 'module' }));
}

export class Helpers {
  /** @type {{worker: Worker, pending: number}[]} */
  #workers = [];
  /** @type {Map<number, {resolve: (value: any) => void, reject: (error: Error) => void, at: number, weight: number}>} */
  #jobs = new Map();
  #lastNumber = 0;
  /** Number of workers that draw: the first ones. */
  #drawing = 0;
  #isRetiring = false;
  /** Whether the workers have what decodes meshes, and the number of jobs that wait for it. */
  #hasMeshes = false;
  #waiting = 0;

  /**
   * @param {Promise<WebAssembly.Module>} compiled Workers start while it is being compiled.
   * @param {number} count Number of workers that draw, once they have an atlas.
   */
  constructor(compiled, count) {
    this.#drawing = count;
    // One more decodes all the time: tiles do not wait for rows.
    for (let at = 0; at <= count; at++) {
      const worker = startHelper();
      worker.onmessage = ({ data }) => this.#settle(data);
      worker.onerror = (event) => this.#failAll(at, event.message || 'helper.js');
      // The engine reports the failure of a module that does not compile.
      compiled.then((module) => worker.postMessage({ job: 'init', module }), () => {});
      this.#workers.push({ worker, pending: 0 });
    }
  }

  get count() {
    return this.#drawing;
  }

  /** Decodes a tile in the least busy worker. Fails if the tile is damaged, and with `isTemporary` if what decodes it has not come. */
  async decode(key, bytes) {
    const isMesh = key[0] === MESH;
    if (isMesh) await this.#giveMeshes();
    const job = isMesh ? 'decodeMesh' : 'decode';
    return (await this.#askLeastBusy({ job, key, bytes }, [bytes.buffer])).bytes;
  }

  /** Packs a model that a page adds. Fails if it is incomplete or too large. @param {object} model @returns {Promise<Uint8Array>} */
  async pack({ number, origin, positions, colours, triangles, name }) {
    await this.#giveMeshes();
    const values = { model: number, origin, positions, colours, triangles, isNamed: name !== undefined };
    return (await this.#askLeastBusy({ job: 'pack', ...values })).bytes;
  }

  async #giveMeshes() {
    if (this.#hasMeshes) return;
    this.#waiting++;
    try {
      const module = await compiledMeshes();
      if (!this.#hasMeshes) this.#workers.forEach(({ worker }) => worker.postMessage({ job: 'meshes', module }));
      this.#hasMeshes = true;
    } finally {
      this.#waiting--;
      // The job that waited is asked for first.
      if (this.#isRetiring) setTimeout(() => this.retire());
    }
  }

  #askLeastBusy(message, transfer = []) {
    const last = this.#workers.length - 1;
    const at = this.#workers.reduce((best, { pending }, i) => (pending < this.#workers[best].pending ? i : best), last);
    return this.#ask(at, 1, message, transfer);
  }

  /** Makes new atlases, or none for 0 bytes. */
  resetAtlas(cacheBytes) {
    this.#tellAll({ job: 'renderer', cacheBytes });
  }

  /** Writes to all atlases. */
  write(words) {
    for (const part of partsOf(words)) this.#tellAll({ job: 'write', words: part });
  }

  /** The frame that the next rows are of. */
  begin(words) {
    this.#tellAll({ job: 'frame', words });
  }

  /**
   * Draws rows `first` to `end` of a frame of a width, each worker every n-th. Fails if a worker fails.
   * @returns {Promise<{words: Uint32Array, hit: Uint32Array}>} In `hit`, each row has its nodes, then its distances.
   */
  async draw(width, first, end) {
    const step = this.#drawing;
    const draw = (_, at) => this.#ask(at, ROWS_WEIGHT, { job: 'draw', first: first + at, end, step });
    const parts = this.#workers.slice(0, step).map(draw);
    const words = new Uint32Array(width * (end - first));
    const hit = new Uint32Array(2 * words.length);
    for (const [at, part] of (await Promise.all(parts)).entries()) {
      for (let row = at, from = 0; row < end - first; row += step, from += width) {
        words.set(part.words.subarray(from, from + width), row * width);
        hit.set(part.hit.subarray(2 * from, 2 * (from + width)), 2 * row * width);
      }
    }
    return { words, hit };
  }

  /** Casts the ray of a frame of one pixel. @returns {Promise<number>} Its word. */
  probe(words) {
    return this.#ask(0, 1, { job: 'probe', words }).then(({ word }) => word);
  }

  /** Ends the workers when they have done what they were asked for. */
  retire() {
    this.#isRetiring = true;
    if (this.#jobs.size + this.#waiting === 0) this.dispose();
  }

  dispose() {
    this.#workers.forEach(({ worker }) => worker.terminate());
    this.#workers = [];
  }

  #tellAll(message) {
    this.#workers.slice(0, this.#drawing).forEach(({ worker }) => worker.postMessage(message));
  }

  /** `weight` is how long the job takes, in tiles. */
  #ask(at, weight, message, transfer = []) {
    const number = ++this.#lastNumber;
    this.#workers[at].pending += weight;
    return new Promise((resolve, reject) => {
      this.#jobs.set(number, { resolve, reject, at, weight });
      this.#workers[at].worker.postMessage({ ...message, number }, transfer);
    });
  }

  #settle(answer) {
    const job = this.#jobs.get(answer.number);
    if (!job) return;
    this.#jobs.delete(answer.number);
    const worker = this.#workers[job.at];
    if (worker) worker.pending -= job.weight;
    if (answer.error === undefined) job.resolve(answer);
    else job.reject(new Error(answer.error));
    if (this.#isRetiring) this.retire();
  }

  #failAll(at, text) {
    for (const [number, job] of this.#jobs) {
      if (job.at === at) this.#settle({ number, error: text });
    }
  }
}
