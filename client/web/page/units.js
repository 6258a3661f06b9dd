/** Lengths as text and as bars, with the rules of the native client. */

import { strings } from './strings.js';

/**
 * The longest bar of 1, 2 or 5 times a power of ten metres that fits; `null` if the scale is not a positive number.
 * @param {number|null} metresPerPixel
 * @param {number} maxPixels
 * @returns {{lengthM: number, pixels: number}|null}
 */
export function scaleBar(metresPerPixel, maxPixels) {
  const longest = Number(metresPerPixel) * maxPixels;
  if (!Number.isFinite(longest) || longest < 1e-6) return null;
  const unit = 10 ** Math.floor(Math.log10(longest));
  // The logarithm may be rounded up to the next power of ten.
  const lengthM = [5, 2, 1, 0.5].map((step) => step * unit).find((length) => length <= longest);
  return lengthM === undefined ? null : { lengthM, pixels: lengthM / Number(metresPerPixel) };
}

/**
 * The length of a scale bar as text.
 * @param {number} metres
 * @returns {string}
 */
export function lengthText(metres) {
  const [value, unit] = metres >= 1000 ? [metres / 1000, 'km'] : metres >= 1 ? [metres, 'm'] : [metres * 100, 'cm'];
  return `${new Intl.NumberFormat(strings.language, { maximumSignificantDigits: 3 }).format(value)} ${unit}`;
}

/**
 * Coordinates below the pointer. A digit that is smaller than a pixel says nothing.
 * @param {number[]} position
 * @param {number|null} metresPerPixel
 * @returns {string}
 */
export function coordinatesText([x, y, z], metresPerPixel) {
  const digits = metresPerPixel !== null && metresPerPixel < 0.5 ? 1 : 0;
  // What rounds to zero has no sign.
  const fixed = (/** @type {number} */ value) => value.toFixed(digits).replace(/^-(0(\.0)?)$/, '$1');
  return strings.furniture.coordinates(fixed(x), fixed(y), fixed(z));
}

/**
 * A number of bytes with a decimal unit.
 * @param {number} bytes
 * @returns {string}
 */
export function bytesText(bytes) {
  return bytes < 1e6 ? `${(bytes / 1e3).toFixed(0)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}
