/**
 * Figures of the page on the surfaces of a city. The engine says how high surfaces are and which points are seen; what moves with every
 * frame, the projection and the picture, is done here.
 */

import { element } from './dom.js';
import { projector } from './earth-camera.js';
import { cells, dense } from './plan-cells.js';

/** Points of one question to the engine, which draws in between. */
const CHUNK = 2000;
/** Height over the surface, so that it does not hide the figure. */
const LIFT_M = 0.4;
const DEFAULT_STYLE = { color: '#ffb020', width: 3, fill: 'rgb(255 176 32 / 35%)', radius: 6 };

/**
 * @typedef {{color?: string, width?: number, fill?: string, radius?: number, hidden?: boolean}} FigureStyle
 * @typedef {import('./geojson.js').Shape} Shape
 */

/** The figures of one call: their points, and which of them make up each figure. */
class Layer {
  /** @type {Float64Array} x, y, x, y, ... */ places;
  /** @type {Float64Array} */ heights;
  /** @type {Uint8Array} */ seen;
  /** @type {Float32Array} In CSS pixels. */ pixels;
  /** @type {{id: string|number|null, style: FigureStyle, state: FigureStyle, lines: number[][], cells: number[][][], dots: number[]}[]} */
  figures;
  /** The first points without a height, and without an answer whether they are seen. */
  next = { heights: 0, seen: 0 };

  /** @param {Shape[]} shapes @param {FigureStyle|((feature: {id: any, properties: any}) => FigureStyle)} style */
  constructor(shapes, style) {
    /** @type {number[]} */
    const places = [];
    const add = (points) => {
      const from = places.length / 2;
      points.forEach(([x, y]) => places.push(x, y));
      return [from, places.length / 2];
    };
    this.figures = shapes.map(({ id, properties, points, lines, polygons }) => ({
      id,
      style: checked(typeof style === 'function' ? style({ id, properties }) : style),
      state: {},
      lines: [...lines, ...polygons.flat()].map((line) => add(dense(line))),
      cells: polygons.flatMap((rings) => cells(rings).map((cell) => cell.map(add))),
      dots: points.map((point) => add([point])[0]),
    }));
    this.places = new Float64Array(places);
    this.heights = new Float64Array(this.count).fill(NaN);
    this.seen = new Uint8Array(this.count);
    this.pixels = new Float32Array(2 * this.count);
  }

  get count() {
    return this.places.length / 2;
  }
}

/** Known members of a style, with texts that a canvas takes. */
function checked(style) {
  const { color, fill, width, radius, hidden } = style ?? {};
  const isColour = (value) => typeof value === 'string' && CSS.supports('color', value);
  const isSize = (value) => Number.isFinite(value) && value >= 0;
  return {
    ...(isColour(color) && { color }),
    ...(isColour(fill) && { fill }),
    ...(isSize(width) && { width: Math.min(width, 100) }),
    ...(isSize(radius) && { radius: Math.min(radius, 100) }),
    ...(typeof hidden === 'boolean' && { hidden }),
  };
}

/** All figures of an element. */
export class DrapedFigures {
  /** @type {HTMLCanvasElement} */ #canvas;
  #host;
  #ask;
  /** @type {Set<Layer>} */ #layers = new Set();
  /** The last frame. @type {{camera: string, tiles: number, final?: boolean}|null} */ #frame = null;
  /** Tiles and camera for which the engine was asked last. */
  #asked = { tiles: -1, camera: '' };
  #isAsking = false;

  /**
   * @param {HTMLElement} host The custom element.
   * @param {(op: string, values: object) => Promise<any>} ask Asks the engine.
   */
  constructor(host, ask) {
    [this.#host, this.#ask] = [host, ask];
    this.#canvas = /** @type {HTMLCanvasElement} */ (element('canvas', { class: 'draped', 'aria-hidden': 'true' }));
    Object.assign(this.#canvas.style, { visibility: 'visible', pointerEvents: 'none' });
    host.shadowRoot?.querySelector('.surface')?.after(this.#canvas);
    this.#frame = /** @type {any} */ (host).view;
  }

  /** Adds figures. @param {Shape[]} shapes @param {any} style */
  add(shapes, style) {
    const layer = new Layer(shapes, style);
    this.#layers.add(layer);
    this.#work();
    const setState = (id, state) => {
      layer.figures.filter((figure) => figure.id === id).forEach((figure) => {
        figure.state = state === null ? {} : { ...figure.state, ...checked(state) };
      });
      this.#draw();
    };
    const remove = () => {
      this.#layers.delete(layer);
      this.#draw();
    };
    return { ids: layer.figures.map(({ id }) => id), setState, remove };
  }

  /** Removes all figures. */
  clear() {
    this.#layers.clear();
    this.#draw();
  }

  /** A frame is on the screen. */
  show(frame) {
    this.#frame = frame;
    this.#draw();
    this.#work();
  }

  /** What the engine is to be asked again because tiles came or the camera moved. */
  #renew() {
    const { tiles, camera, final } = this.#frame ?? { tiles: -1, camera: '' };
    const hasTiles = final && tiles !== this.#asked.tiles;
    if (hasTiles) this.#asked.tiles = tiles;
    if (!hasTiles && camera === this.#asked.camera) return;
    this.#asked.camera = camera;
    for (const { next } of this.#layers) {
      if (hasTiles) next.heights = 0;
      next.seen = 0;
    }
  }

  async #work() {
    if (this.#isAsking || !this.#frame) return;
    this.#isAsking = true;
    try {
      this.#renew();
      for (let layer = this.#unfinished(); layer; layer = this.#unfinished()) {
        if (layer.next.heights < layer.count) await this.#askHeights(layer);
        else await this.#askSeen(layer);
        this.#draw();
        // Not before all points have an answer: a moving camera would keep the last ones from it.
        if (!this.#unfinished()) this.#renew();
      }
    } catch (error) {
      // A viewer that was closed. Its next one begins with a frame, from which all is asked again.
      console.warn(error);
      this.#asked = { tiles: -1, camera: '' };
    } finally {
      this.#isAsking = false;
    }
  }

  #unfinished() {
    return [...this.#layers].find(({ next, count }) => next.heights < count || next.seen < count);
  }

  async #askHeights(layer) {
    const from = layer.next.heights;
    const to = Math.min(from + CHUNK, layer.count);
    const heights = await this.#ask('heights', { places: layer.places.slice(2 * from, 2 * to) });
    for (let i = from; i < to; i++) layer.heights[i] = heights[i - from] + LIFT_M;
    layer.next.heights = to;
  }

  /** Asks for the points that are in the view. */
  async #askSeen(layer) {
    const from = layer.next.seen;
    const to = Math.min(from + CHUNK, layer.count);
    const { width, height } = this.#size();
    this.#project(layer, { width, height });
    const inView = [];
    for (let i = from; i < to; i++) {
      const [x, y] = [layer.pixels[2 * i], layer.pixels[2 * i + 1]];
      // What is not a number is behind the camera.
      if (x > -width && x < 2 * width && y > -height && y < 2 * height) inView.push(i);
      else layer.seen[i] = 0;
    }
    const points = new Float64Array(inView.flatMap((i) => [layer.places[2 * i], layer.places[2 * i + 1], layer.heights[i]]));
    const seen = inView.length > 0 ? await this.#ask('seen', { points }) : [];
    inView.forEach((i, at) => (layer.seen[i] = seen[at]));
    layer.next.seen = to;
  }

  /** A picture of the city with the figures over it. @param {Blob} picture @returns {Promise<Blob>} */
  async over(picture) {
    const bitmap = await createImageBitmap(picture);
    const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
    const context = canvas.getContext('2d');
    if (!context || !this.#frame) return picture;
    context.drawImage(bitmap, 0, 0);
    const ratio = bitmap.height / this.#size().height;
    this.#paint(context, { width: bitmap.width / ratio, height: bitmap.height / ratio }, ratio);
    this.#draw();
    return canvas.convertToBlob();
  }

  #size() {
    return { width: Math.max(this.#host.clientWidth, 1), height: Math.max(this.#host.clientHeight, 1) };
  }

  #draw() {
    const { width, height } = this.#size();
    const ratio = globalThis.devicePixelRatio || 1;
    const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
    const canvas = this.#canvas;
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    const context = canvas.getContext('2d');
    if (!context || !this.#frame) return;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, w, h);
    this.#paint(context, { width, height }, ratio);
  }

  /** Paints all figures. @param {any} context @param {{width: number, height: number}} size In CSS pixels. @param {number} ratio */
  #paint(context, size, ratio) {
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    [context.lineJoin, context.lineCap] = ['round', 'round'];
    for (const layer of this.#layers) {
      this.#project(layer, size);
      const shown = layer.figures.map((figure) => ({ ...figure, style: { ...DEFAULT_STYLE, ...figure.style, ...figure.state } }));
      const visible = shown.filter(({ style }) => !style.hidden);
      visible.forEach((figure) => fill(context, layer, figure));
      visible.forEach((figure) => stroke(context, layer, figure));
      visible.forEach((figure) => dot(context, layer, figure));
    }
  }

  /** Where a layer's points are on the screen; not a number behind the camera, and without a height yet. */
  #project({ places, heights, pixels, count }, size) {
    const project = projector(this.#frame?.camera ?? '', size);
    for (let i = 0; i < count; i++) project(places[2 * i], places[2 * i + 1], heights[i], pixels, 2 * i);
  }
}

/** All cells as one path: what two of them share has no seam. */
function fill(context, { pixels, seen }, { cells: all, style }) {
  if (all.length === 0) return;
  context.beginPath();
  for (const [from, to] of all.flat()) {
    let count = 0;
    for (let i = from; i < to; i++) count += seen[i];
    // At an edge of the surface, some corners of a cell are behind it.
    if (2 * count < to - from || Number.isNaN(sumOf(pixels, 2 * from, 2 * to))) continue;
    context.moveTo(pixels[2 * from], pixels[2 * from + 1]);
    for (let i = from + 1; i < to; i++) context.lineTo(pixels[2 * i], pixels[2 * i + 1]);
    context.closePath();
  }
  context.fillStyle = style.fill;
  context.fill('nonzero');
}

function sumOf(values, from, to) {
  let sum = 0;
  for (let i = from; i < to; i++) sum += values[i];
  return sum;
}

/** The parts of lines with both ends seen. */
function stroke(context, { pixels, seen }, { lines, style }) {
  if (lines.length === 0 || style.width === 0) return;
  context.beginPath();
  for (const [from, to] of lines) {
    let isOpen = false;
    for (let i = from + 1; i < to; i++) {
      const isDrawn = seen[i - 1] && seen[i] && !Number.isNaN(pixels[2 * i - 2] + pixels[2 * i]);
      if (isDrawn && !isOpen) context.moveTo(pixels[2 * i - 2], pixels[2 * i - 1]);
      if (isDrawn) context.lineTo(pixels[2 * i], pixels[2 * i + 1]);
      isOpen = isDrawn;
    }
  }
  [context.strokeStyle, context.lineWidth] = [style.color, style.width];
  context.stroke();
}

function dot(context, { pixels, seen }, { dots, style }) {
  [context.fillStyle, context.strokeStyle, context.lineWidth] = [style.color, '#fff', 1.5];
  for (const i of dots) {
    if (!seen[i] || Number.isNaN(pixels[2 * i])) continue;
    context.beginPath();
    context.arc(pixels[2 * i], pixels[2 * i + 1], style.radius, 0, 2 * Math.PI);
    context.fill();
    context.stroke();
  }
}
