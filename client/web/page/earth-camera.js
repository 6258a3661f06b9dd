/** Cameras by longitude and latitude, and what they show: the same as a camera's text, in other units. */

import { isLonLat, northOf, rad } from './lon-lat.js';
import { cameraNumbers } from './view-text.js';

/** Points nearer than this in front of the camera are not projected. */
const NEAR_M = 0.1;

/**
 * A camera in degrees and metres: see `EarthCamera` of insula-viewer.d.ts.
 * @typedef {{lon: number, lat: number, height: number, heading: number, pitch: number, fov: number}} EarthCamera
 */
/** @typedef {import('./lon-lat.js').LonLatGrid} LonLatGrid */

const turned = (degrees) => ((degrees % 360) + 360) % 360;

/**
 * A camera's text as a camera in degrees.
 * @param {LonLatGrid} grid
 * @param {string} text
 * @returns {EarthCamera|null}
 */
export function earthCamera(grid, text) {
  const numbers = cameraNumbers(text);
  if (!numbers) return null;
  const [x, y, height, azimuth, pitch, fov] = numbers;
  const [lon, lat] = grid.toLonLat([x, y]);
  return { lon, lat, height, heading: turned(azimuth - northOf(grid, [lon, lat])), pitch, fov };
}

/**
 * The text of a camera in degrees. Fails if a number is missing or out of range.
 * @param {LonLatGrid} grid
 * @param {EarthCamera} camera
 * @returns {string}
 */
export function cameraText(grid, { lon, lat, height, heading, pitch, fov }) {
  if (!isLonLat(lon, lat)) throw new RangeError('a camera has lon and lat in degrees');
  const [x, y] = grid.toXy([lon, lat]);
  const text = [x, y, height, turned(heading + northOf(grid, [lon, lat])), pitch, fov].join(',');
  if (!cameraNumbers(text)) throw new RangeError('a camera has height in metres, heading, pitch of -90 to 90 and fov of 1 to 170 degrees');
  return text;
}

/** The axes of a camera's text: into the view, to its right, and to its top. */
export function axes(text) {
  const [x, y, z, azimuth, pitch, fov] = text.split(',').map(Number);
  const [sinA, cosA, sinP, cosP] = [Math.sin(rad(azimuth)), Math.cos(rad(azimuth)), Math.sin(rad(pitch)), Math.cos(rad(pitch))];
  const forward = [sinA * cosP, cosA * cosP, sinP];
  const right = [cosA, -sinA, 0];
  const up = [-sinA * sinP, -cosA * sinP, cosP];
  return { position: [x, y, z], forward, right, up, tangent: Math.tan(rad(fov) / 2) };
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/**
 * Projects positions on an element: writes x and y in CSS pixels from its upper left corner, not numbers behind the camera.
 * @param {string} camera
 * @param {{width: number, height: number}} size
 * @returns {(x: number, y: number, z: number, out: Float32Array|number[], at: number) => void}
 */
export function projector(camera, { width, height }) {
  const { position, forward, right, up, tangent } = axes(camera);
  return (x, y, z, out, at) => {
    const to = [x - position[0], y - position[1], z - position[2]];
    const depth = dot(to, forward);
    const scale = depth >= NEAR_M ? height / (2 * tangent * depth) : NaN;
    out[at] = width / 2 + dot(to, right) * scale;
    out[at + 1] = height / 2 - dot(to, up) * scale;
  };
}

/**
 * Place of a position on an element in CSS pixels from its upper left corner; `null` behind the camera.
 * @param {string} camera
 * @param {{width: number, height: number}} size
 * @param {number[]} point
 * @returns {{x: number, y: number}|null}
 */
export function projected(camera, size, [px, py, pz]) {
  const out = [0, 0];
  projector(camera, size)(px, py, pz, out, 0);
  const [x, y] = out;
  return Number.isNaN(x) ? null : { x, y };
}

/**
 * The position at a height, in metres of the city, that a place of the element shows if nothing is before it; `null` for the sky.
 * @param {string} camera
 * @param {{width: number, height: number}} size
 * @param {number} x
 * @param {number} y
 * @param {number} level
 * @returns {number[]|null}
 */
export function unprojected(camera, { width, height }, x, y, level) {
  const { position, forward, right, up, tangent } = axes(camera);
  const scale = (2 * tangent) / height;
  const [dx, dy] = [(x - width / 2) * scale, (height / 2 - y) * scale];
  const direction = [0, 1, 2].map((i) => forward[i] + right[i] * dx + up[i] * dy);
  const distance = (level - position[2]) / direction[2];
  return distance > 0 && Number.isFinite(distance) ? position.map((value, i) => value + direction[i] * distance) : null;
}

/**
 * The text of the nearest camera of a direction that shows all points, with their middle in the middle.
 * @param {number[][]} points
 * @param {{azimuth: number, pitch: number, fov: number}} direction In degrees.
 * @param {{width: number, height: number}} size In CSS pixels.
 * @param {number} padding Free CSS pixels at each side.
 * @returns {string}
 */
export function fitting(points, { azimuth, pitch, fov }, { width, height }, padding) {
  const middle = [0, 1, 2].map((i) => points.reduce((sum, point) => sum + point[i], 0) / points.length);
  const { forward, right, up, tangent } = axes([...middle, azimuth, pitch, fov].join(','));
  // At least a tenth of the view is used, whatever padding leaves.
  const share = (side) => Math.max(1 - (2 * padding) / side, 0.1);
  const [tanX, tanY] = [tangent * (width / height) * share(width), tangent * share(height)];
  const away = points.map((point) => {
    const to = point.map((value, i) => value - middle[i]);
    return Math.max(Math.abs(dot(to, right)) / tanX, Math.abs(dot(to, up)) / tanY) - dot(to, forward);
  });
  const distance = Math.max(...away, 10);
  const position = middle.map((value, i) => (value - forward[i] * distance).toFixed(3));
  return [...position, azimuth, pitch, fov].join(',');
}
