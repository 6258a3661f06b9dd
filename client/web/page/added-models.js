/** Models that a page adds to a city: they are read here, and drawn by the engine like the city. */

/** Of a file: more is not read. */
const MAX_BYTES = 64 * 2 ** 20;

/** All models of an element. */
export class AddedModels {
  #ask;
  /** What the engine was told, by number. @type {Map<number, object>} */ #models = new Map();
  #last = 0;

  /** @param {(op: string, values: object) => Promise<any>} ask Asks the engine. */
  constructor(ask) {
    this.#ask = ask;
  }

  /**
   * Reads a model and adds it. Fails with what is wrong with it.
   * @param {{url?: string, bytes?: ArrayBuffer|ArrayBufferView}} from
   * @param {number[]} origin Position of the model's own origin.
   * @param {number} azimuth Degrees clockwise from the grid's north, by which it is turned.
   * @param {number} scale
   * @returns {Promise<number>}
   */
  async add(from, origin, azimuth, scale) {
    // Pages without a model do not fetch this.
    const { readModel } = await import('./model-reader.js');
    const model = readModel(await bytesOf(from));
    const [sin, cos] = [scale * Math.sin((azimuth * Math.PI) / 180), scale * Math.cos((azimuth * Math.PI) / 180)];
    const positions = model.positions.map((value, i, all) => {
      if (i % 3 === 0) return cos * value + sin * all[i + 1];
      return i % 3 === 1 ? cos * value - sin * all[i - 1] : scale * value;
    });
    return this.put({ ...model, positions }, origin);
  }

  /**
   * Adds triangles. Fails if they are too many.
   * @param {import('./model-reader.js').Model} model
   * @param {number[]} origin
   * @returns {Promise<number>}
   */
  async put(model, origin) {
    const number = ++this.#last;
    const values = { ...model, number, origin };
    await this.#ask('addModel', values);
    this.#models.set(number, values);
    return number;
  }

  /** Returns whether there was such a model. @param {number} number */
  remove(number) {
    if (!this.#models.delete(number)) return false;
    this.#ask('removeModel', { number }).catch(() => {});
    return true;
  }

  /** Tells a new engine of all models. */
  sendAll() {
    this.#models.forEach((values) => this.#ask('addModel', values).catch(({ message }) => console.warn(`a model: ${message}`)));
  }

  /** Another city has none of them. */
  clear() {
    [...this.#models.keys()].forEach((number) => this.remove(number));
  }
}

/** @param {{url?: string, bytes?: ArrayBuffer|ArrayBufferView}} from @returns {Promise<ArrayBuffer>} */
async function bytesOf({ url, bytes }) {
  if (bytes instanceof ArrayBuffer) return bytes;
  if (ArrayBuffer.isView(bytes)) return new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength).slice().buffer;
  if (!url) throw new TypeError('a model has a url or bytes');
  const address = new URL(url, document.baseURI);
  const response = await fetch(address);
  if (!response.ok || !response.body) throw new Error(`${address}: status ${response.status}`);
  const [reader, chunks] = [response.body.getReader(), []];
  let length = 0;
  for (let part = await reader.read(); !part.done; part = await reader.read()) {
    length += part.value.length;
    chunks.push(part.value);
    if (length > MAX_BYTES) {
      reader.cancel().catch(() => {});
      throw new RangeError(`${address}: longer than ${MAX_BYTES / 2 ** 20} MiB`);
    }
  }
  return new Blob(chunks).arrayBuffer();
}
