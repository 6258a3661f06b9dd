/** The worker that owns the viewer, as the element sees it: messages, and requests with replies. */

import { startWorker } from './workers.js';

/** A worker that no viewer has taken yet. @type {Worker|null} */
let spare = null;

function startEngine() {
  return startWorker('engine.js', () => new Worker(new URL('./engine.js', import.meta.url), { type: 'module' }));
}

/** Starts a worker for the first viewer of a page that will have one: it loads while the page is being set up. */
export function prepareEngine() {
  spare ??= startEngine();
}

function takeWorker() {
  const worker = spare ?? startEngine();
  spare = null;
  return worker;
}

/** A worker of one viewer. */
export class EngineClient {
  /** @type {Worker} */
  #worker;
  /** @type {Map<number, {resolve: (value: unknown) => void, reject: (error: Error) => void}>} */
  #pending = new Map();
  #nextId = 1;
  #isDisposed = false;

  /**
   * Starts a worker whose messages go to `onMessage`.
   * @param {(message: {op: string, [key: string]: unknown}) => void} onMessage
   * @param {Worker} [worker] Another one than that of an element.
   */
  constructor(onMessage, worker = takeWorker()) {
    this.#worker = worker;
    const report = (text) => onMessage({ op: 'status', kind: 'error', text });
    this.#worker.onmessage = ({ data }) => (data.op === 'reply' ? this.#settle(data) : onMessage(data));
    this.#worker.onerror = (event) => report(event.message || 'engine.js');
    this.#worker.onmessageerror = () => report('engine.js');
  }

  /**
   * Starts the viewer. Fails if it cannot be loaded.
   * @param {object} values Values of `init`.
   * @param {OffscreenCanvas[]} canvases
   * @returns {Promise<{manifest: object}>}
   */
  init(values, canvases) {
    const id = this.#nextId++;
    this.#worker.postMessage({ ...values, op: 'init', id }, canvases);
    return new Promise((resolve, reject) => this.#pending.set(id, { resolve, reject }));
  }

  /**
   * Sends a message without a reply.
   * @param {string} op
   * @param {object} [values]
   */
  send(op, values = {}) {
    const message = { ...values, op };
    if (!this.#isDisposed) this.#worker.postMessage(message);
  }

  /**
   * Sends a message and waits for its reply. Fails with the engine's text.
   * @param {string} op
   * @param {object} [values]
   * @returns {Promise<any>}
   */
  request(op, values = {}) {
    if (this.#isDisposed) return Promise.reject(new Error('the viewer is closed'));
    const id = this.#nextId++;
    const reply = new Promise((resolve, reject) => this.#pending.set(id, { resolve, reject }));
    this.send(op, { ...values, id });
    return reply;
  }

  /** Ends the worker and all requests. */
  dispose() {
    this.send('dispose');
    this.#isDisposed = true;
    this.#pending.forEach(({ reject }) => reject(new Error('the viewer is closed')));
    this.#pending.clear();
    // The engine ends its own workers first. A worker that does not is ended after a second.
    setTimeout(() => this.#worker.terminate(), 1000);
  }

  #settle({ id, value, error, isTemporary, fault }) {
    const request = this.#pending.get(id);
    this.#pending.delete(id);
    if (error === undefined || error === null) request?.resolve(value);
    else request?.reject(Object.assign(new Error(String(error)), { isTemporary, fault }));
  }
}
