/** What an office sets of its pages: logo, colour and imprint, which the server writes into the page. */

import { element, webAddress } from './dom.js';
import { strings } from './strings.js';

/** Smallest contrast of text to its background. */
const CONTRAST = 4.5;
/** Share of black or white that is mixed into a colour at once, until its contrast suffices. */
const STEP = 0.06;
const [WHITE, BLACK] = [[255, 255, 255], [0, 0, 0]];
/** The page in its dark appearance, about. */
const DARK = [22, 26, 31];

/** @param {string} name @returns {string|null} */
function setting(name) {
  return document.querySelector(`meta[name="insula-${name}"]`)?.getAttribute('content') ?? null;
}

/** The logo as an image without words, before the title that says whose it is; `null` without one. */
export function logo() {
  const address = setting('logo');
  return address?.startsWith('data:image/') ? element('img', { class: 'logo', src: address, alt: '' }) : null;
}

/** The link to the imprint; `null` without one. */
export function imprintLink() {
  const address = webAddress(setting('imprint'));
  return address && element('a', { href: address, rel: 'noopener noreferrer', target: '_blank' }, strings.about.imprint);
}

/** Sets the colour of buttons and links, lighter or darker where it could not be read. @param {boolean} isDark */
export function applyAccent(isDark) {
  const digits = /^#([0-9a-f]{6})$/i.exec(setting('accent') ?? '')?.[1];
  if (!digits) return;
  let color = [0, 2, 4].map((at) => parseInt(digits.slice(at, at + 2), 16));
  const [ground, towards] = isDark ? [DARK, WHITE] : [WHITE, BLACK];
  while (contrast(color, ground) < CONTRAST) color = color.map((v, i) => v + Math.sign(towards[i] - v) * Math.max(Math.abs(towards[i] - v) * STEP, 1));
  const { style } = document.documentElement;
  style.setProperty('--accent', css(color));
  style.setProperty('--on-accent', css(contrast(color, WHITE) >= contrast(color, BLACK) ? WHITE : BLACK));
}

function contrast(a, b) {
  const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y);
  return (high + 0.05) / (low + 0.05);
}

/** Relative luminance as in the Web Content Accessibility Guidelines. */
function luminance(rgb) {
  const [r, g, b] = rgb.map((v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

function css(rgb) {
  return `rgb(${rgb.map((v) => Math.min(Math.max(Math.round(v), 0), 255)).join(' ')})`;
}
