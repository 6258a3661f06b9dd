/** What a user typed into the search: coordinates in the city's system, degrees as maps show them, or a camera. */

import { printable } from './dom.js';
import { placeNear } from './lon-lat.js';
import { strings } from './strings.js';
import { cameraNumbers } from './view-text.js';

const MAX_SHOWN_CHARS = 40;

/**
 * Two or three numbers between commas, semicolons or spaces, or the six of a camera, or the reason why they are none. Without a
 * height, the ground's height is taken.
 * @param {string} text
 * @param {any} manifest
 * @returns {{place: number[]|string}|{error: string}} A place as `flyTo` takes it.
 */
export function parseCoordinates(text, manifest) {
  const parts = text.split(/[,;\s]+/).filter((part) => part !== '');
  const invalid = parts.find((part) => !/^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(part));
  if (invalid !== undefined) return { error: strings.search.notNumber(printable(text).slice(0, MAX_SHOWN_CHARS)) };
  if (cameraNumbers(parts.join())) return { place: parts.join() };
  if (parts.length !== 2 && parts.length !== 3) return { error: strings.search.twoOrThree };
  const place = placeNear(parts.map(Number), manifest);
  if (place) return { place };
  const [low, high] = manifest.bounds;
  const rounded = (v) => v.toFixed(0);
  return { error: strings.search.far(rounded(low[0]), rounded(high[0]), rounded(low[1]), rounded(high[1])) };
}
