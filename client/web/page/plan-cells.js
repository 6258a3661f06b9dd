/** Cuts lines and polygons of a plan into pieces that follow the surface below them. */

/** Longest piece of a line, and side of a cell of a polygon, in metres. */
const PIECE_M = 6;
/** Most pieces of a part of a line, and most cells along a side of a polygon: larger ones get larger pieces. */
const MAX_PIECES = 256;
const MAX_SIDE = 64;

/**
 * A line with points between its own.
 * @param {number[][]} line
 * @returns {number[][]}
 */
export function dense(line) {
  const out = [line[0]];
  for (let i = 1; i < line.length; i++) {
    const [from, to] = [line[i - 1], line[i]];
    const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
    const pieces = Math.min(Math.max(Math.ceil(length / PIECE_M), 1), MAX_PIECES);
    for (let piece = 1; piece <= pieces; piece++) {
      const share = piece / pieces;
      out.push([from[0] + (to[0] - from[0]) * share, from[1] + (to[1] - from[1]) * share]);
    }
  }
  return out;
}

/**
 * A polygon in cells: each a list of parts of rings. Outer ones go anticlockwise and holes clockwise, so that holes stay free when all are
 * filled as one path.
 * @param {number[][][]} rings
 * @returns {number[][][][]}
 */
export function cells(rings) {
  const turned = rings.map((ring, i) => (area(ring) > 0 === (i === 0) ? ring : ring.toReversed()));
  const [low, high] = bounds(turned[0]);
  const counts = [0, 1].map((k) => Math.min(Math.max(Math.ceil((high[k] - low[k]) / PIECE_M), 1), MAX_SIDE));
  const steps = [0, 1].map((k) => (high[k] - low[k]) / counts[k]);
  const out = [];
  for (let column = 0; column < counts[0]; column++) {
    // Strips first: a ring is cut once for each column, and only its part in the column for each row.
    const x = low[0] + column * steps[0];
    const strip = turned.map((ring) => between(ring, 0, x, x + steps[0])).filter((part) => part.length > 2);
    for (let row = 0; row < counts[1] && strip.length > 0; row++) {
      const y = low[1] + row * steps[1];
      const cell = strip.map((ring) => between(ring, 1, y, y + steps[1])).filter((part) => part.length > 2);
      if (cell.length > 0) out.push(cell);
    }
  }
  return out;
}

/** The part of a ring between two values of a coordinate. */
function between(ring, k, low, high) {
  return half(half(ring, k, low, 1), k, high, -1);
}

/** The part of a ring on one side of a value (Sutherland and Hodgman). */
function half(ring, k, limit, side) {
  const out = [];
  for (let i = 0; i < ring.length; i++) {
    const [from, to] = [ring[(i + ring.length - 1) % ring.length], ring[i]];
    const [before, after] = [(from[k] - limit) * side, (to[k] - limit) * side];
    if (before >= 0 !== after >= 0) {
      const share = before / (before - after);
      out.push([from[0] + (to[0] - from[0]) * share, from[1] + (to[1] - from[1]) * share]);
    }
    if (after >= 0) out.push(to);
  }
  return out;
}

/** Twice the area; positive if the ring goes anticlockwise. */
function area(ring) {
  const [x0, y0] = ring[0];
  let sum = 0;
  for (let i = 1; i < ring.length; i++) {
    sum += (ring[i - 1][0] - x0) * (ring[i][1] - y0) - (ring[i][0] - x0) * (ring[i - 1][1] - y0);
  }
  return sum;
}

function bounds(ring) {
  const [low, high] = [[Infinity, Infinity], [-Infinity, -Infinity]];
  for (const point of ring) {
    for (const k of [0, 1]) {
      low[k] = Math.min(low[k], point[k]);
      high[k] = Math.max(high[k], point[k]);
    }
  }
  return [low, high];
}
