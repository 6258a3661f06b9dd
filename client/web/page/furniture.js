/** What is always there: compass, scale bar, coordinates below the pointer, and what is being loaded. */

import { element, setText, svg } from './dom.js';
import { follow } from './events.js';
import { strings } from './strings.js';
import { bytesText, coordinatesText, lengthText, scaleBar } from './units.js';
import { iconButton } from './widgets.js';

const texts = strings.furniture;
const MAX_BAR_PX = 140;
/** Coordinates are read this often at most. */
const READ_MS = 150;
const ZOOM_STEP = 1.5;

/** The compass: a needle towards the grid's north. */
function compass(page) {
  const letter = svg('text', { x: 0, y: -13, 'text-anchor': 'middle' });
  letter.append(texts.north);
  const north = svg('path', { class: 'north', d: 'M0-11L5.5 3.5H-5.5z' });
  const south = svg('path', { class: 'south', d: 'M0 18L5.5 3.5H-5.5z' });
  const needle = svg('g', {}, north, south, letter);
  const face = svg('svg', { viewBox: '-24 -24 48 48', 'aria-hidden': 'true', focusable: 'false' }, needle);
  const node = element('button', { type: 'button', class: 'compass', click: () => page.city.steer('north') }, face);
  const label = () => {
    const degrees = Math.round(page.city.view?.azimuth ?? 0);
    const wind = texts.winds[Math.round(degrees / 45) % texts.winds.length];
    node.setAttribute('aria-label', texts.compass(wind, degrees % 360));
  };
  follow(page.city, 'camera', ({ detail }) => needle.setAttribute('transform', `rotate(${-detail.azimuth})`));
  page.addEventListener('rest', label);
  label();
  return node;
}

/** The scale bar: the length of a horizontal line in the middle of the view. */
function scale(page) {
  const bar = element('div', { class: 'bar' });
  const label = element('span', { dir: 'ltr' });
  const node = element('div', { class: 'scale', role: 'img', hidden: true }, label, bar);
  follow(page.city, 'frame', ({ detail }) => {
    const ratio = devicePixelRatio;
    const fitting = scaleBar(detail.metersPerPixel === null ? null : detail.metersPerPixel * ratio, MAX_BAR_PX);
    node.hidden = fitting === null;
    if (!fitting) return;
    const width = `${fitting.pixels.toFixed(1)}px`;
    if (bar.style.inlineSize !== width) bar.style.inlineSize = width;
    const text = lengthText(fitting.lengthM);
    if (label.textContent === text) return;
    label.textContent = text;
    node.setAttribute('aria-label', texts.scale(text));
  });
  return node;
}

/** Coordinates below a mouse pointer that rests over the city. */
function coordinates({ city }) {
  const node = element('div', { class: 'coordinates', dir: 'ltr' });
  let [timer, latest] = [0, 0];
  const read = async (event) => {
    const turn = ++latest;
    const box = city.getBoundingClientRect();
    const hit = await city.pick(event.clientX - box.left, event.clientY - box.top).catch(() => undefined);
    if (turn !== latest || hit === undefined) return;
    setText(node, hit ? coordinatesText(hit.position, city.view?.metersPerPixel ?? null) : texts.sky);
  };
  city.addEventListener('pointermove', (event) => {
    clearTimeout(timer);
    if (event.pointerType === 'mouse' && event.buttons === 0) timer = setTimeout(() => read(event), READ_MS);
  });
  city.addEventListener('pointerleave', () => {
    clearTimeout(timer);
    latest++;
    setText(node, '');
  });
  return node;
}

/** What is being loaded, and the developer counters. */
function works({ city }) {
  const loading = element('div', { class: 'loading' });
  const counters = element('div', { class: 'counters', dir: 'ltr', hidden: true });
  let [bytes, missing] = [0, 0];
  follow(city, 'progress', ({ detail }) => {
    bytes = detail.bytes ?? bytes;
    missing = detail.missing ?? missing;
    setText(loading, missing > 0 ? texts.loading : '');
  });
  follow(city, 'frame', ({ detail }) => {
    const { frameMs, divisor, samples } = detail;
    // Frames that only moved markers were not drawn.
    if (counters.hidden || frameMs === undefined) return;
    setText(counters, texts.counters(frameMs.toFixed(1), divisor, samples, missing, bytesText(bytes)));
  });
  return { loading, counters };
}

/**
 * The furniture of a page.
 * @param {import('./page-context.js').PageContext} page
 * @returns {{node: HTMLElement, showCounters: (shown: boolean) => void, areCountersShown: () => boolean}}
 */
export function furniture(page) {
  const { loading, counters } = works(page);
  const lines = element('div', { class: 'lines' }, scale(page), coordinates(page), loading, counters);
  const node = element('div', { class: 'furniture', role: 'group', 'aria-label': texts.label }, compass(page), lines);
  const showCounters = (shown) => (counters.hidden = !shown);
  return { node, showCounters, areCountersShown: () => !counters.hidden };
}

/**
 * Buttons that zoom and lead back, for people who cannot drag or turn a wheel.
 * @param {import('./page-context.js').PageContext} page
 * @returns {HTMLElement}
 */
export function navigation({ city }) {
  const zoom = (icon, factor) => iconButton({ icon, label: texts[icon], press: () => city.steer('zoom', { factor }) });
  const home = iconButton({ icon: 'home', label: texts.home, key: 'H', press: () => city.steer('home') });
  const buttons = [zoom('zoomIn', ZOOM_STEP), zoom('zoomOut', 1 / ZOOM_STEP), home];
  return element('div', { class: 'navigation', role: 'group', 'aria-label': texts.navigation }, ...buttons);
}
