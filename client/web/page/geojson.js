/** Figures of GeoJSON in the coordinates of a city. The text may come from anybody. */

import { isLonLat } from './lon-lat.js';

/** Most positions of all figures of one call. */
const MAX_POSITIONS = 2_000_000;
/** Deepest nesting of geometry collections. */
const MAX_DEPTH = 8;

/**
 * A feature in metres of the city.
 * @typedef {object} Shape
 * @property {string|number|null} id
 * @property {any} properties
 * @property {number[][]} points
 * @property {number[][][]} lines
 * @property {number[][][][]} polygons Rings; the first one is the outer one.
 */

/**
 * The features of a GeoJSON value, with the reason for each that is skipped. Fails if it is no GeoJSON at all, or too large.
 * @param {any} data
 * @param {import('./lon-lat.js').LonLatGrid} grid
 * @returns {{shapes: Shape[], skipped: {index: number, reason: string}[]}}
 */
export function shapesOf(data, grid) {
  const features = featuresOf(data);
  const reader = new Reader(grid);
  /** @type {Shape[]} */
  const shapes = [];
  /** @type {{index: number, reason: string}[]} */
  const skipped = [];
  features.forEach((feature, index) => {
    const { id, properties, geometry } = feature ?? {};
    const known = typeof id === 'string' || typeof id === 'number' ? id : null;
    const shape = { id: known, properties: properties ?? {}, points: [], lines: [], polygons: [] };
    const reason = reader.read(geometry, shape, 0);
    if (reason === '') shapes.push(shape);
    else skipped.push({ index, reason });
  });
  return { shapes, skipped };
}

function featuresOf(data) {
  if (data?.type === 'FeatureCollection' && Array.isArray(data.features)) return data.features;
  if (data?.type === 'Feature') return [data];
  if (typeof data?.type === 'string') return [{ geometry: data }];
  throw new TypeError('not GeoJSON: a FeatureCollection, a Feature or a geometry is expected');
}

class Reader {
  #grid;
  #left = MAX_POSITIONS;

  constructor(grid) {
    this.#grid = grid;
  }

  /** Adds a geometry to a shape. Returns why it cannot, or an empty text. */
  read(geometry, shape, depth) {
    const { type, coordinates, geometries } = geometry ?? {};
    if (type === 'GeometryCollection' && Array.isArray(geometries) && depth < MAX_DEPTH) {
      return geometries.reduce((reason, part) => reason || this.read(part, shape, depth + 1), '');
    }
    const readers = {
      Point: () => shape.points.push(this.#position(coordinates)),
      MultiPoint: () => shape.points.push(...this.#positions(coordinates, 0)),
      LineString: () => shape.lines.push(this.#positions(coordinates, 2)),
      MultiLineString: () => list(coordinates).forEach((line) => shape.lines.push(this.#positions(line, 2))),
      Polygon: () => shape.polygons.push(this.#rings(coordinates)),
      MultiPolygon: () => list(coordinates).forEach((rings) => shape.polygons.push(this.#rings(rings))),
    };
    if (!Object.hasOwn(readers, String(type))) return `${String(type).slice(0, 40)} is not a geometry`;
    try {
      readers[/** @type {keyof typeof readers} */ (type)]();
      return '';
    } catch (error) {
      if (!(error instanceof ShapeError)) throw error;
      return error.message;
    }
  }

  #rings(rings) {
    const read = list(rings).map((ring) => this.#positions(ring, 4));
    if (read.length === 0) throw new ShapeError('a polygon without rings');
    return read;
  }

  #positions(positions, least) {
    const all = list(positions);
    if (all.length < least) throw new ShapeError(`${all.length} positions: at least ${least} are needed`);
    return all.map((position) => this.#position(position));
  }

  #position(position) {
    if (this.#left-- <= 0) throw new RangeError(`more than ${MAX_POSITIONS} positions: add them in parts`);
    if (!Array.isArray(position) || !isLonLat(position[0], position[1])) {
      throw new ShapeError('a position is not longitude and latitude in degrees');
    }
    return this.#grid.toXy(position);
  }
}

class ShapeError extends Error {}

function list(value) {
  if (!Array.isArray(value)) throw new ShapeError('coordinates are not a list');
  return value;
}
