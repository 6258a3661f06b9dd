/**
 * Views as text: `X,Y,Z,AZIMUTH,PITCH,FOV` in metres and degrees, and times `YYYY-MM-DDThh:mm`.
 *
 * The text may come from anybody, so it is checked as strictly as in the native client.
 */

import { LOOKS } from './key-table.js';

const MAX_CHARS = 2048;
const MAX_COORDINATE_M = 1e10;

/**
 * A camera, a time of the light, a look, and a selected object.
 * @typedef {{camera: string|null, time: string|null, look?: string|null, object?: number|null}} View
 */

/**
 * The six numbers of a camera, or `null` if the text is none.
 * @param {string} text
 * @returns {number[]|null}
 */
export function cameraNumbers(text) {
  if (text.length > MAX_CHARS) return null;
  const parts = text.split(',');
  const numbers = parts.map((part) => (part.trim() === '' ? NaN : Number(part)));
  const [x, y, z, azimuth, pitch, fov] = numbers;
  const isValid =
    numbers.length === 6 &&
    [x, y, z].every((v) => Math.abs(v) < MAX_COORDINATE_M) &&
    Number.isFinite(azimuth) &&
    Math.abs(pitch) <= 90 &&
    fov >= 1 &&
    fov <= 170;
  return isValid ? numbers : null;
}

/**
 * Whether a text is a time of the light: solar time, or with an offset from UTC.
 * @param {string} text
 * @returns {boolean}
 */
export function isTime(text) {
  return /^\d{4}-\d\d-\d\dT\d\d:\d\d(:\d\d)?(Z|[+-]\d\d:\d\d)?$/.test(text);
}

/**
 * The number of an object, or `null` if the text is none.
 * @param {string|null} text
 * @returns {number|null}
 */
function objectNumber(text) {
  const isNumber = text !== null && /^\d{1,10}$/.test(text) && Number(text) < 2 ** 32;
  return isNumber ? Number(text) : null;
}

/**
 * The view of a location's hash, `#camera=...&time=...&look=...&object=...`. What is malformed is left out.
 * @param {string} hash
 * @returns {View}
 */
export function parseView(hash) {
  if (hash.length > MAX_CHARS) return { camera: null, time: null, object: null };
  const values = new URLSearchParams(hash.replace(/^#/, '').replaceAll('+', '%2B'));
  const [camera, time, look] = [values.get('camera'), values.get('time'), values.get('look')];
  return {
    camera: camera !== null && cameraNumbers(camera) ? camera : null,
    time: time !== null && isTime(time) ? time : null,
    look: look !== null && LOOKS.includes(look) ? look : null,
    object: objectNumber(values.get('object')),
  };
}

/**
 * A view as it stands in a hash or in the query of a view link.
 * @param {View} view
 * @returns {string}
 */
export function formatView({ camera, time, look, object = null }) {
  const shown = look && look !== LOOKS[0] && `look=${look}`;
  const parts = [camera && `camera=${camera}`, time && `time=${time}`, shown, object !== null && `object=${object}`];
  return parts.filter(Boolean).join('&');
}

/**
 * The `insula://` link that opens a view in the native client; `null` for a city that is not on a web server.
 * @param {string} src Address of the city.
 * @param {View} view
 * @returns {string|null}
 */
export function nativeLink(src, view) {
  const url = new URL(src, location.href);
  if (url.protocol !== 'http:' && url.protocol !== 'https:') return null;
  const tls = url.protocol === 'https:' ? 'tls=1' : '';
  // The query of a private city's address has the right to see it.
  const query = [url.search.slice(1), formatView(view), tls].filter(Boolean).join('&');
  return `insula://${url.host}${url.pathname}${query && `?${query}`}`;
}
