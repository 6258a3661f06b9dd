/** What lies over the picture: markers, lines and the measured figure. The engine projects their points. */

import { element, setText, svg } from './dom.js';
import { measureText } from './measure-text.js';
import { strings } from './strings.js';

const DEFAULT_COLOR = '#ffb020';
const DEFAULT_WIDTH_PX = 3;

/**
 * A projected point in device pixels, with whether nothing hides it; `null` where a line leaves the view.
 * @typedef {[number, number, boolean]|null} Projected
 */

/** The layers over the canvases of one viewer. */
export class Overlay {
  /** Parts for the shadow root, in their order. @type {Element[]} */
  nodes;
  #lineLayer = svg('g');
  #measureLine = svg('g', { class: 'measure' });
  #boxLines = svg('g', { class: 'measure' });
  #measureText = element('div', { class: 'measure-text', part: 'measure', hidden: true });
  #markerLayer = element('div', { class: 'markers' });
  /** @type {{position: number[], node: HTMLElement, content: Element|null}[]} */
  #markers = [];
  /** @type {{points: number[][], node: SVGElement}[]} */
  #lines = [];
  #nextSlot = 1;
  #hasMeasure = false;
  #host;
  #changed;

  /**
   * @param {HTMLElement} host The custom element: content of markers becomes its child, so that the page's styles apply.
   * @param {(what: 'markers'|'lines') => void} changed Called when points must be projected again.
   */
  constructor(host, changed) {
    this.#host = host;
    this.#changed = changed;
    const figures = svg('svg', { class: 'figures', 'aria-hidden': 'true' }, this.#lineLayer, this.#boxLines, this.#measureLine);
    this.nodes = [figures, this.#markerLayer, this.#measureText];
  }

  /** Points of all markers. @returns {number[][]} */
  get markerPoints() {
    return this.#markers.map(({ position }) => position);
  }

  /** Points of all lines. @returns {number[][][]} */
  get linePoints() {
    return this.#lines.map(({ points }) => points);
  }

  /**
   * Adds a marker: an element of the page, or a label.
   * @param {{position: number[], element?: HTMLElement, text?: string}} marker
   */
  addMarker({ position, element: content = null, text = '' }) {
    const node = element('div', { class: 'marker', hidden: true });
    if (content) {
      const name = `insula-marker-${this.#nextSlot++}`;
      content.slot = name;
      node.append(element('slot', { name }));
      this.#host.append(content);
    } else {
      node.append(element('span', { class: 'label', part: 'marker', dir: 'auto' }, String(text)));
    }
    const marker = { position: [...position], node, content };
    this.#markers.push(marker);
    this.#markerLayer.append(node);
    this.#changed('markers');
    const update = (next) => {
      marker.position = [...next];
      this.#changed('markers');
    };
    return { remove: () => this.#remove('markers', this.#markers, marker), moveTo: update };
  }

  /**
   * Adds a line.
   * @param {{points: number[][], color?: string, width?: number}} line
   */
  addLine({ points, color = DEFAULT_COLOR, width = DEFAULT_WIDTH_PX }) {
    const stroke = CSS.supports('color', color) ? color : DEFAULT_COLOR;
    const path = svg('path', { stroke, 'stroke-width': Math.min(Math.max(Number(width) || 0, 0.5), 40) });
    const line = { points: points.map((point) => [...point]), node: path, content: null };
    this.#lines.push(line);
    this.#lineLayer.append(path);
    this.#changed('lines');
    return { remove: () => this.#remove('lines', this.#lines, line) };
  }

  /**
   * Places everything where the engine projected it.
   * @param {{markers?: Projected[], lines?: Projected[][], measure?: object|null, boxes?: number[][]}} frame
   * @param {number} ratio Device pixels per CSS pixel.
   */
  update({ markers = [], lines = [], measure = null, boxes = [] }, ratio) {
    // A frame that was drawn before the last change has another number of points.
    if (markers.length === this.#markers.length) {
      this.#markers.forEach(({ node }, i) => placeMarker(node, markers[i], ratio));
    }
    if (lines.length === this.#lines.length) {
      this.#lines.forEach(({ node }, i) => node.setAttribute('d', pathOf(lines[i], ratio)));
    }
    this.#boxLines.replaceChildren(...outlined(boxes, ratio));
    if (measure || this.#hasMeasure) this.#showMeasure(measure, ratio);
    this.#hasMeasure = measure !== null;
  }

  #remove(what, list, item) {
    const at = list.indexOf(item);
    if (at < 0) return;
    list.splice(at, 1);
    item.node.remove();
    item.content?.remove();
    this.#changed(what);
  }

  #showMeasure(measure, ratio) {
    const points = measure?.points ?? [];
    const last = points.at(-1);
    this.#measureText.hidden = !last;
    const dots = points.map(([x, y]) => svg('circle', { cx: x / ratio, cy: y / ratio, r: 4 }));
    this.#measureLine.replaceChildren(...outlined(measure?.lines ?? [], ratio), ...dots);
    if (!last) return;
    setText(this.#measureText, measureText(measure) || strings.measured.next);
    place(this.#measureText, last[0] / ratio, last[1] / ratio);
  }
}

/** Lines with a dark outline, which keeps them visible over bright scenes. */
function outlined(lines, ratio) {
  if (lines.length === 0) return [];
  const d = lines.map(([x0, y0, x1, y1]) => `M${text([x0, y0], ratio)}L${text([x1, y1], ratio)}`).join('');
  return [svg('path', { d, class: 'outline' }), svg('path', { d })];
}

function placeMarker(node, projected, ratio) {
  node.hidden = !projected || !projected[2];
  if (!node.hidden) place(node, projected[0] / ratio, projected[1] / ratio);
}

function place(node, x, y) {
  node.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
}

/** The visible parts of a line as the data of a path. A part is visible if both of its ends are. */
function pathOf(points, ratio) {
  let [d, last, isOpen] = ['', null, false];
  for (const point of points) {
    const isDrawn = Boolean(point?.[2] && last?.[2]);
    if (isDrawn) d += `${isOpen ? '' : `M${text(last, ratio)}`}L${text(point, ratio)}`;
    [last, isOpen] = [point, isDrawn];
  }
  return d;
}

function text([x, y], ratio) {
  return `${(x / ratio).toFixed(1)} ${(y / ratio).toFixed(1)}`;
}
