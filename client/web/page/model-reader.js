/**
 * Reads models: the triangles of a glTF file in one piece (GLB), in metres, with a colour for each corner. The bytes may come from
 * anybody. Only pages that add a model fetch this module.
 */

const MAX_BYTES = 64 * 2 ** 20;
/** Of a model, its triangles and vertices once for each node that shows them. */
const MOST = { nodes: 20_000, vertices: 2 ** 20, triangles: 2 ** 18 };
const MAX_DEPTH = 64;
const [MAGIC, JSON_CHUNK, BINARY_CHUNK] = [0x46546c67, 0x4e4f534a, 0x004e4942];
/** Names of the methods of a DataView, and the bytes of a number. @type {Record<number, [string, number]>} */
const COMPONENTS = {
  5120: ['getInt8', 1],
  5121: ['getUint8', 1],
  5122: ['getInt16', 2],
  5123: ['getUint16', 2],
  5125: ['getUint32', 4],
  5126: ['getFloat32', 4],
};
const TYPES = { SCALAR: 1, VEC3: 3, VEC4: 4 };
/** Extensions that files may require without which their triangles and colours are the same. */
const HARMLESS = /^KHR_(materials_\w+|texture_transform|mesh_quantization|lights_punctual)$/;
const [TRIANGLES, STRIP, FAN] = [4, 5, 6];
const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

/**
 * Triangles in metres to the east, to the north and up, if the model's z points south.
 * @typedef {object} Model
 * @property {Float32Array} positions x, y, z, x, y, z, ...
 * @property {Uint8Array} colours Red, green and blue (sRGB) of each position.
 * @property {Uint32Array} triangles Numbers of three positions each, counter-clockwise as seen from outside.
 */

/**
 * Reads a file. Fails with what is wrong.
 * @param {ArrayBuffer} bytes
 * @returns {Model}
 */
export function readModel(bytes) {
  const { root, binary } = chunksOf(bytes);
  const needed = list(root.extensionsRequired).find((name) => !HARMLESS.test(String(name)));
  if (needed !== undefined) throw new TypeError(`a model with ${needed} cannot be read: export it without`);
  const reader = new Reader(root, binary);
  const scene = list(root.scenes)[root.scene ?? 0];
  // A file without scenes shows all nodes that no other has.
  const inner = new Set(list(root.nodes).flatMap((node) => list(node?.children)));
  const outer = list(root.nodes).map((_, i) => i).filter((i) => !inner.has(i));
  (scene ? list(scene.nodes) : outer).forEach((node) => reader.addNode(node, IDENTITY, 0));
  return reader.model();
}

/** The two parts of a GLB. */
function chunksOf(bytes) {
  if (bytes.byteLength > MAX_BYTES) throw new RangeError(`a model has at most ${MAX_BYTES / 2 ** 20} MiB`);
  const view = new DataView(bytes);
  if (view.byteLength < 20 || view.getUint32(0, true) !== MAGIC) {
    throw new TypeError('no model: a glTF file in one piece (.glb) is expected');
  }
  if (view.getUint32(4, true) !== 2) throw new TypeError('a model of another version than glTF 2.0: export it again');
  let [root, binary] = [null, new DataView(new ArrayBuffer(0))];
  for (let at = 12; at + 8 <= view.byteLength; ) {
    const [length, kind] = [view.getUint32(at, true), view.getUint32(at + 4, true)];
    if (length > view.byteLength - at - 8) throw damaged('it ends early');
    const content = new DataView(bytes, at + 8, length);
    if (kind === JSON_CHUNK && root === null) root = JSON.parse(new TextDecoder().decode(content));
    if (kind === BINARY_CHUNK) binary = content;
    at += 8 + length;
  }
  if (root === null || typeof root !== 'object') throw damaged('it has no JSON');
  return { root, binary };
}

class Reader {
  #root;
  #binary;
  #left = { ...MOST };
  /** @type {number[]} */ #positions = [];
  /** @type {number[]} */ #colours = [];
  /** @type {number[]} */ #triangles = [];

  constructor(root, binary) {
    [this.#root, this.#binary] = [root, binary];
  }

  /** @returns {Model} */
  model() {
    if (this.#triangles.length === 0) throw new TypeError('the model has no triangles');
    const [positions, colours] = [new Float32Array(this.#positions), new Uint8Array(this.#colours)];
    return { positions, colours, triangles: new Uint32Array(this.#triangles) };
  }

  /** Adds a node with those below it. @param {number} index @param {number[]} above Matrix, column by column. @param {number} depth */
  addNode(index, above, depth) {
    const node = list(this.#root.nodes)[index];
    if (!node) throw damaged(`there is no node ${index}`);
    this.#take('nodes', 1);
    if (depth > MAX_DEPTH) throw damaged('its nodes are nested too deeply');
    const matrix = product(above, matrixOf(node));
    const mesh = node.mesh === undefined ? null : list(this.#root.meshes)[node.mesh];
    list(mesh?.primitives).forEach((primitive) => this.#addPrimitive(primitive, matrix));
    list(node.children).forEach((child) => this.addNode(child, matrix, depth + 1));
  }

  #addPrimitive({ attributes, indices, material, mode = TRIANGLES }, matrix) {
    if (![TRIANGLES, STRIP, FAN].includes(mode) || attributes?.POSITION === undefined) return;
    const first = this.#positions.length / 3;
    const places = this.#numbers(attributes.POSITION, ['VEC3'], 'vertices');
    const count = places.length / 3;
    for (let i = 0; i < places.length; i += 3) {
      const along = (row, axis) => matrix[4 * axis + row] * places[i + axis];
      const [x, y, z] = [0, 1, 2].map((row) => along(row, 0) + along(row, 1) + along(row, 2) + matrix[12 + row]);
      if (![x, y, z].every(Number.isFinite)) throw damaged('a position is no number');
      // y up becomes z up.
      this.#positions.push(x, -z, y);
    }
    this.#addColours(attributes.COLOR_0, material, count);
    const order = indices === undefined ? places.slice(0, count).map((_, i) => i) : this.#numbers(indices, ['SCALAR'], 'triangles');
    const isMirrored = determinant(matrix) < 0;
    for (const [a, b, c] of corners(order, mode)) {
      if (Math.max(a, b, c) >= count) throw damaged('a triangle has a corner that does not exist');
      if (a === b || b === c || c === a) continue;
      this.#take('triangles', 1);
      this.#triangles.push(first + a, first + (isMirrored ? c : b), first + (isMirrored ? b : c));
    }
  }

  /** Colours of corners times that of the material. Both are linear. */
  #addColours(accessor, material, count) {
    const base = list(list(this.#root.materials)[material]?.pbrMetallicRoughness?.baseColorFactor ?? [1, 1, 1]);
    const isValid = accessor !== undefined && list(this.#root.accessors)[accessor]?.count === count;
    const of = isValid ? this.#numbers(accessor, ['VEC3', 'VEC4'], 'vertices') : null;
    const width = of ? of.length / count : 0;
    for (let i = 0; i < count; i++) {
      for (let k = 0; k < 3; k++) this.#colours.push(encoded((Number(base[k]) || 0) * (of ? of[i * width + k] : 1)));
    }
  }

  /** The numbers of an accessor, which count as `what`. */
  #numbers(index, types, what) {
    const accessor = list(this.#root.accessors)[index];
    if (!accessor || !types.includes(accessor.type) || !COMPONENTS[accessor.componentType]) throw damaged(`accessor ${index} has another type`);
    const { count, componentType, byteOffset = 0, normalized = false } = accessor;
    if (!Number.isSafeInteger(count) || count < 0) throw damaged(`accessor ${index} has no count`);
    // An index is a third of a triangle, and shared vertices are few.
    if (what === 'vertices') this.#take(what, count);
    else if (count > 3 * MOST.triangles) this.#take(what, count);
    if (accessor.sparse) throw new TypeError('a model with sparse accessors cannot be read: export it without');
    const view = list(this.#root.bufferViews)[accessor.bufferView];
    if (!view || (view.buffer ?? 0) !== 0) throw new TypeError('a model with files beside it cannot be read: export it as one .glb');
    const [[get, size], width] = [COMPONENTS[componentType], TYPES[accessor.type]];
    const stride = view.byteStride ?? width * size;
    const start = (view.byteOffset ?? 0) + byteOffset;
    const end = start + (count - 1) * stride + width * size;
    const isInside = [start, stride, end].every(Number.isSafeInteger) && start >= 0 && stride > 0 && end <= this.#binary.byteLength;
    if (count > 0 && !isInside) throw damaged(`accessor ${index} ends behind the file`);
    const most = normalized ? 2 ** (8 * size - (get.includes('Uint') ? 0 : 1)) - 1 : 1;
    const found = new Float64Array(count * width);
    for (let i = 0; i < found.length; i++) {
      const at = start + Math.floor(i / width) * stride + (i % width) * size;
      found[i] = this.#binary[get](at, true) / most;
    }
    return found;
  }

  #take(what, count) {
    this.#left[what] -= count;
    if (this.#left[what] < 0) throw new RangeError(`the model has too many ${what}: at most ${MOST[what]}`);
  }
}

/** The corners of triangles. @param {ArrayLike<number>} order @param {number} mode */
function* corners(order, mode) {
  if (mode === TRIANGLES) {
    for (let i = 0; i + 2 < order.length; i += 3) yield [order[i], order[i + 1], order[i + 2]];
    return;
  }
  for (let i = 0; i + 2 < order.length; i++) {
    const [a, b] = mode === FAN ? [0, i + 1] : [i + (i % 2), i + 1 - (i % 2)];
    yield [order[a], order[b], order[i + 2]];
  }
}

/** The matrix of a node, column by column. */
function matrixOf({ matrix, translation = [0, 0, 0], rotation = [0, 0, 0, 1], scale = [1, 1, 1] }) {
  if (Array.isArray(matrix) && matrix.length === 16) return matrix.map(Number);
  const [x, y, z, w] = rotation;
  const axes = [
    [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
    [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
    [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
  ];
  return [...axes.flatMap((axis, k) => [...axis.map((value) => value * scale[k]), 0]), ...translation, 1];
}

function product(a, b) {
  return IDENTITY.map((_, i) => [0, 1, 2, 3].reduce((sum, k) => sum + a[4 * k + (i % 4)] * b[4 * Math.floor(i / 4) + k], 0));
}

function determinant([a, b, c, , d, e, f, , g, h, i]) {
  return a * (e * i - f * h) - d * (b * i - c * h) + g * (b * f - c * e);
}

/** A linear part of a colour in sRGB, 0 to 255. */
function encoded(linear) {
  const share = Math.min(Math.max(linear, 0), 1);
  return Math.round(255 * (share <= 0.0031308 ? 12.92 * share : 1.055 * share ** (1 / 2.4) - 0.055));
}

/** A value if it is a list, else an empty one. @returns {any[]} */
function list(value) {
  return Array.isArray(value) ? value : [];
}

function damaged(reason) {
  return new TypeError(`the model is damaged: ${reason}`);
}
