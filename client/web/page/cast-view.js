/**
 * Cameras of others, as the city is cast at: from the matrix that brings positions to the screen, and back.
 *
 * Matrices have their columns one after another, as WebGL takes them. A cast has a level horizon and its axis in its middle. Where the
 * other camera rolls, or has its axis elsewhere, the cast is as large as it takes to contain its picture.
 */

import { axes } from './earth-camera.js';

/** Longest side of a cast in pixels, and most pixels of it in those of the screen. */
const MAX_SIDE_PX = 8192;
const MAX_AREA = 3;
/** Tangents of the half fields of view that the engine takes. */
const MAX_TANGENT = Math.tan((85 * Math.PI) / 180);

/** @typedef {[number, number, number]} Vec3 */

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const plus = (a, b, factor) => a.map((value, i) => value + b[i] * factor);
const scaled = (a, factor) => a.map((value) => value * factor);

/**
 * The product of two matrices of 4 x 4.
 * @param {ArrayLike<number>} a
 * @param {ArrayLike<number>} b
 * @returns {number[]}
 */
export function product(a, b) {
  return Array.from({ length: 16 }, (_, i) => {
    const [row, column] = [i % 4, i - (i % 4)];
    return a[row] * b[column] + a[4 + row] * b[column + 1] + a[8 + row] * b[column + 2] + a[12 + row] * b[column + 3];
  });
}

/**
 * How a camera sees a city.
 * @typedef {object} CastView
 * @property {string} camera What the engine takes.
 * @property {number} width Pixels of the cast.
 * @property {number} height
 * @property {number[]} matrix From metres beside the anchor to clip space.
 * @property {number[]} anchor A position of the city.
 * @property {number[]} eye In metres beside the anchor.
 * @property {number[][]} rays What the x and y of clip space, and 1, add to the direction of a pixel's ray.
 */

/**
 * The view of a camera; `null` for one without perspective, or whose picture is too wide for a cast.
 * @param {number[]} matrix From metres beside `anchor` to clip space.
 * @param {number[]} anchor
 * @param {number} widthPx Of the screen.
 * @param {number} heightPx
 * @returns {CastView|null}
 */
export function castView(matrix, anchor, widthPx, heightPx) {
  const row = (i) => [matrix[i], matrix[4 + i], matrix[8 + i]];
  const [x, y, w] = [row(0), row(1), row(3)];
  const length = Math.hypot(...w);
  const volume = dot(x, cross(y, w));
  if (!(length > 0) || !(Math.abs(volume) > 0)) return null;
  // Where all three are zero.
  const eye = scaled(plus(plus(scaled(cross(y, w), matrix[12]), cross(w, x), matrix[13]), cross(x, y), matrix[15]), -1 / volume);
  const forward = scaled(w, 1 / length);
  const side = (of) => {
    const offset = dot(of, w) / length ** 2;
    const across = plus(scaled(of, 1 / length), forward, -offset);
    const size = Math.hypot(...across);
    return { offset, size, axis: scaled(across, 1 / size) };
  };
  const [right, up] = [side(x), side(y)];
  const middle = plus(plus(forward, right.axis, -right.offset / right.size), up.axis, -up.offset / up.size);
  const rays = [scaled(right.axis, 1 / right.size), scaled(up.axis, 1 / up.size), middle];
  return fitted({ matrix, anchor, eye, rays }, { forward, right: right.axis, up: up.axis }, widthPx, heightPx);
}

/** The cast that contains a camera's picture. */
function fitted(view, { forward, right, up }, widthPx, heightPx) {
  const flat = Math.hypot(forward[0], forward[1]);
  const isLevel = Math.abs(right[2]) < 1e-6;
  const azimuth = isLevel ? Math.atan2(-right[1], right[0]) : Math.atan2(forward[0], forward[1]);
  const degrees = (angle) => (angle * 180) / Math.PI;
  const pitch = degrees(Math.atan2(forward[2], flat));
  const level = axes([0, 0, 0, degrees(azimuth), pitch, 90].join(','));
  const corners = [[-1, -1], [1, -1], [-1, 1], [1, 1]].map(([x, y]) => rayOf(view, x, y));
  const reach = (axis) => Math.max(...corners.map((ray) => Math.abs(dot(ray, axis))));
  const [tanX, tanY] = [reach(level.right), reach(level.up)];
  if (!(tanX < MAX_TANGENT && tanY < MAX_TANGENT)) return null;
  // As fine as the screen.
  const fine = heightPx / (2 * Math.hypot(...view.rays[1]));
  const area = (4 * tanX * tanY * fine ** 2) / (widthPx * heightPx);
  const density = Math.min(fine * Math.min(1, Math.sqrt(MAX_AREA / area)), MAX_SIDE_PX / (2 * Math.max(tanX, tanY)));
  const [width, height] = [tanX, tanY].map((tangent) => Math.max(Math.round(2 * tangent * density), 1));
  const position = plus(view.anchor, view.eye, 1);
  const fov = degrees(2 * Math.atan(tanY));
  return { ...view, camera: [...position, degrees(azimuth), pitch, fov].join(','), width, height };
}

/** The direction of the ray of a place in clip space. */
function rayOf({ rays }, x, y) {
  return plus(plus(rays[2], rays[0], x), rays[1], y);
}

/**
 * What the axes of a cast are: in clip space of its own, a direction is (right, up, forward).
 * @param {{camera: string, width: number, height: number}} cast
 */
export function castAxes({ camera, width, height }) {
  const { position, forward, right, up, tangent } = axes(camera);
  return { position, forward, right, up, tanX: (tangent * width) / height, tanY: tangent };
}

/** @typedef {ReturnType<typeof castAxes>} CastAxes */

/**
 * Where a place of the view's clip space is in the clip space of a cast with the same eye: a matrix of 3 x 3 for (x, y, 1).
 * @param {CastView} view
 * @param {CastAxes} cast
 * @returns {number[]}
 */
export function viewToCast({ rays }, { right, up, forward, tanX, tanY }) {
  return rays.flatMap((ray) => [dot(ray, right) / tanX, dot(ray, up) / tanY, dot(ray, forward)]);
}

/**
 * From metres to the right, up and forward of a cast's eye to the view's clip space.
 * @param {CastView} view
 * @param {CastAxes} cast
 * @returns {number[]}
 */
export function castToClip({ matrix, anchor }, { position, right, up, forward }) {
  const eye = plus(position, anchor, -1);
  return product(matrix, [...right, 0, ...up, 0, ...forward, 0, ...eye, 1]);
}

/**
 * What tells whether a position, in the cast's own axes, is as high as a height of the city.
 * @param {CastAxes} cast
 * @param {number} heightM
 * @returns {number[]}
 */
export function aboveHeight({ position, right, up, forward }, heightM) {
  return Number.isFinite(heightM) ? [right[2], up[2], forward[2], position[2] - heightM] : [0, 0, 0, 1];
}

/**
 * Metres between the eyes of a view and a cast.
 * @param {CastView} view
 * @param {CastAxes} cast
 */
export function eyeDistance({ anchor, eye }, { position }) {
  return Math.hypot(...plus(plus(anchor, eye, 1), position, -1));
}

/**
 * Pixels of the screen for one of a cast, of what is as far from both eyes.
 * @param {CastView} view
 * @param {CastAxes} cast
 * @param {number} castPx Height of the cast.
 * @param {number} screenPx
 */
export function pixelSize({ rays, matrix }, { tanY }, castPx, screenPx) {
  // Clip space does not count in metres.
  const unit = Math.hypot(matrix[3], matrix[7], matrix[11]);
  return (screenPx / castPx) * (tanY / Math.hypot(...rays[1])) * unit;
}

/**
 * Place of a view's clip space in its cast, in shares of its width and height from the upper left corner.
 * @param {CastView} view
 * @param {number} x
 * @param {number} y
 */
export function castPlace(view, x, y) {
  const { right, up, forward, tanX, tanY } = castAxes(view);
  const ray = rayOf(view, x, y);
  const depth = dot(ray, forward);
  return { x: 0.5 + dot(ray, right) / (2 * tanX * depth), y: 0.5 - dot(ray, up) / (2 * tanY * depth) };
}

/**
 * Metres to a position of the city, and what the cast has hit there; `null` beside the cast.
 * @param {{camera: string, width: number, height: number, distances: Float32Array}} cast
 * @param {number[]} position
 * @returns {{distance: number, hit: number}|null}
 */
export function seenFrom(cast, position) {
  const { position: eye, right, up, forward, tanX, tanY } = castAxes(cast);
  const to = plus(position, eye, -1);
  const depth = dot(to, forward);
  const [x, y] = [0.5 + dot(to, right) / (2 * tanX * depth), 0.5 - dot(to, up) / (2 * tanY * depth)];
  if (!(depth > 0 && x >= 0 && x < 1 && y >= 0 && y < 1)) return null;
  const at = Math.floor(y * cast.height) * cast.width + Math.floor(x * cast.width);
  return { distance: Math.hypot(...to), hit: cast.distances[at] };
}
