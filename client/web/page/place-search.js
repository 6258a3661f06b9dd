/** What a user typed into the search: coordinates in the city's system, degrees as maps show them, a camera, or a copied link. */

import { printable } from './dom.js';
import { isLonLat, isNear, lonLatGrid, northOf, placeNear } from './lon-lat.js';
import { strings } from './strings.js';
import { cameraNumbers } from './view-text.js';

const MAX_SHOWN_CHARS = 40;
/** Of a camera that does not say it. */
const DEFAULT_FOV_DEG = 60;

/**
 * Two or three numbers between commas, semicolons or spaces, or the five or six of a camera, or the reason why they are none. Without a
 * height, the ground's height is taken.
 * @param {string} text
 * @param {any} manifest
 * @returns {{place: number[]|string}|{error: string}} A place as `flyTo` takes it.
 */
export function parseCoordinates(text, manifest) {
  const [, ofLink] = /camera=([^&#]*)/.exec(text) ?? [];
  const parts = (ofLink ?? text).split(/[,;\s]+/).filter((part) => part !== '');
  const invalid = parts.find((part) => !/^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(part));
  if (invalid !== undefined) return { error: strings.search.notNumber(printable(text).slice(0, MAX_SHOWN_CHARS)) };
  // People type degrees, links have metres.
  const camera = (ofLink === undefined && typedCamera(parts.map(Number), manifest)) || parts.join();
  if (cameraNumbers(camera)) return { place: camera };
  if (parts.length !== 2 && parts.length !== 3) return { error: strings.search.twoOrThree };
  const place = placeNear(parts.map(Number), manifest);
  if (place) return { place };
  const [low, high] = manifest.bounds;
  const rounded = (v) => v.toFixed(0);
  return { error: strings.search.far(rounded(low[0]), rounded(high[0]), rounded(low[1]), rounded(high[1])) };
}

/** The text of a camera near the city by its longitude, latitude, height, heading, pitch and, if wanted, field of view; else `null`. */
function typedCamera(numbers, manifest) {
  const [lon, lat, height, heading, pitch, fov = DEFAULT_FOV_DEG] = numbers;
  const grid = lonLatGrid(manifest);
  if (!grid || numbers.length < 5 || numbers.length > 6 || !isLonLat(lon, lat)) return null;
  const position = [...grid.toXy([lon, lat]), height];
  return isNear(position, manifest) ? [...position, heading + northOf(grid, [lon, lat]), pitch, fov].join() : null;
}
