/** The camera of a MapLibre map in the metres of a city. */

import { castView, product } from './cast-view.js';

/** A step in Mercator units that tells how they lie in the city: at most 40 m. */
const STEP = 1e-6;
/** Eyes further from the middle of the city than this, in its diagonals, see none of it. */
const MAX_DIAGONALS = 100;
const MIN_FAR_M = 20_000;

/** Between Mercator units, 0 to 1 from the north-west corner of the world, and degrees. */
const toDegrees = (x, y) => [360 * x - 180, (Math.atan(Math.sinh(Math.PI * (1 - 2 * y))) * 180) / Math.PI];
const toMercator = ([lon, lat]) => [lon / 360 + 0.5, 0.5 - Math.asinh(Math.tan((lat * Math.PI) / 180)) / (2 * Math.PI)];

/**
 * From metres beside a position of the city to Mercator units, as the two lie to each other there: the same scale in all directions.
 * @param {import('./lon-lat.js').LonLatGrid} grid
 * @param {number[]} lonLat The position.
 * @returns {number[]} Its columns.
 */
function metresToMercator(grid, lonLat) {
  const [x, y] = toMercator(lonLat);
  const at = (dx, dy) => grid.toXy(toDegrees(x + dx, y + dy));
  const [[ax, ay], [bx, by], [cx, cy], [dx, dy]] = [at(-STEP, 0), at(STEP, 0), at(0, STEP), at(0, -STEP)];
  const [east, north] = [[bx - ax, by - ay], [dx - cx, dy - cy]];
  // The nearest turn and scale: Mercator's sphere stretches what is on the ellipsoid by up to 0.7%.
  const [a, b] = [(east[0] + north[1]) / 2, (east[1] - north[0]) / 2];
  const length = Math.hypot(a, b);
  const unit = (2 * STEP) / length;
  const [cos, sin] = [(a / length) * unit, (b / length) * unit];
  return [cos, sin, 0, 0, sin, -cos, 0, 0, 0, 0, unit, 0, x, y, 0, 1];
}

/**
 * How a map sees a city; `null` if it does not.
 * @param {{grid: import('./lon-lat.js').LonLatGrid|null, manifest: any}} city
 * @param {ArrayLike<number>} matrix From Mercator units to clip space.
 * @param {{lng: number, lat: number}} centre Of the map: there, city and map lie exactly on each other.
 * @param {number} zeroM Height of the city that is at the map's height of zero.
 * @param {number} widthPx
 * @param {number} heightPx
 */
export function mapView({ grid, manifest }, matrix, { lng, lat }, zeroM, widthPx, heightPx) {
  if (!grid) return null;
  const anchor = [...grid.toXy([lng, lat]), zeroM];
  const [low, high] = manifest.focus;
  const away = Math.hypot(...[0, 1].map((i) => anchor[i] - (low[i] + high[i]) / 2));
  const far = Math.max(MAX_DIAGONALS * Math.hypot(high[0] - low[0], high[1] - low[1]), MIN_FAR_M);
  if (!(away < far)) return null;
  const view = castView(product(matrix, metresToMercator(grid, [lng, lat])), anchor, widthPx, heightPx);
  return view && Math.hypot(...view.eye) < far ? view : null;
}
