/** What a user typed into the search: coordinates in the city's system. */

import { printable } from './dom.js';
import { strings } from './strings.js';

/** Coordinates must lie within this multiple of the city's diagonal around its centre. */
const MAX_DIAGONALS = 3;
const MAX_SHOWN_CHARS = 40;

/**
 * Two or three numbers between commas, semicolons or spaces, or the reason why they are none. Without a height, the ground's
 * height is taken.
 * @param {string} text
 * @param {any} manifest
 * @returns {{position: number[]}|{error: string}}
 */
export function parseCoordinates(text, manifest) {
  const parts = text.split(/[,;\s]+/).filter((part) => part !== '');
  const invalid = parts.find((part) => !/^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(part));
  if (invalid !== undefined) return { error: strings.search.notNumber(printable(text).slice(0, MAX_SHOWN_CHARS)) };
  if (parts.length !== 2 && parts.length !== 3) return { error: strings.search.twoOrThree };
  const [x, y, z = manifest.ground_z_m] = parts.map(Number);
  const [low, high] = manifest.bounds;
  const middle = low.map((v, i) => (v + high[i]) / 2);
  const length = (v) => Math.hypot(...v);
  const away = length([x, y, z].map((v, i) => v - middle[i]));
  const isNear = away <= length(high.map((v, i) => v - low[i])) * MAX_DIAGONALS;
  if (isNear) return { position: [x, y, z] };
  const rounded = (v) => v.toFixed(0);
  return { error: strings.search.far(rounded(low[0]), rounded(high[0]), rounded(low[1]), rounded(high[1])) };
}
