/** Gestures of two fingers: pan, pinch and rotate together, or tilt by a parallel vertical drag. */

/** Fingers must move this far before the gesture is known. */
const DECIDE_PX = 8;
/** Browsers report one finger after the other: a finger alone must move this far. */
const DECIDE_ALONE_PX = 20;
/** Angle of the camera per pixel of a vertical drag. */
const TILT_RAD_PER_PX = 0.005;
/** Fingers that tilt lie beside each other: their line is flatter than this. */
const MAX_TILT_SLOPE = 0.7;

/**
 * A position in pixels.
 * @typedef {[number, number]} Point
 */

/**
 * What two fingers asked for since the last call.
 * @typedef {{pan?: Point, zoom?: number, turn?: number, tilt?: number}} Motion
 */

/** One gesture, from the second finger's touch until one is lifted. */
export class TwoFingers {
  /** @type {Point[]} */ #first;
  /** @type {Point[]} */ #last;
  /** @type {'tilt'|'move'|null} */ #kind = null;

  /**
   * Starts a gesture where the fingers touch.
   * @param {Point[]} points
   */
  constructor(points) {
    this.#first = this.#last = points.map(([x, y]) => [x, y]);
  }

  /**
   * The motion towards new positions of the fingers; `null` until the gesture is known.
   * @param {Point[]} points
   * @returns {Motion|null}
   */
  move(points) {
    this.#kind ??= decide(this.#first, points);
    if (this.#kind === null) return null;
    const [before, after] = [this.#last, points];
    this.#last = points.map(([x, y]) => [x, y]);
    const [from, to] = [middle(before), middle(after)];
    // Fingers that move up raise the view towards the horizon.
    if (this.#kind === 'tilt') return { tilt: (from[1] - to[1]) * TILT_RAD_PER_PX };
    const [a, b] = [span(before), span(after)];
    const angle = Math.atan2(b[1], b[0]) - Math.atan2(a[1], a[0]);
    return {
      pan: [to[0] - from[0], to[1] - from[1]],
      zoom: Math.max(length(b), 1) / Math.max(length(a), 1),
      // The city follows the fingers: clockwise fingers turn the camera to the left.
      turn: Math.atan2(Math.sin(angle), Math.cos(angle)),
    };
  }
}

/** Whether fingers tilt or move the view; `null` if they have hardly moved. */
function decide(first, points) {
  const ways = points.map(([x, y], i) => [x - first[i][0], y - first[i][1]]);
  const [shorter, longer] = ways.map(length).sort((a, b) => a - b);
  if (longer < DECIDE_PX || (shorter < DECIDE_PX / 2 && longer < DECIDE_ALONE_PX)) return null;
  const [dx, dy] = span(first);
  const areBeside = Math.abs(dy) < MAX_TILT_SLOPE * Math.abs(dx);
  const isVertical = ways.every(([x, y]) => Math.abs(y) > 2 * Math.abs(x) && Math.abs(y) > DECIDE_PX / 4);
  const isParallel = ways[0][1] * ways[1][1] > 0;
  return areBeside && isVertical && isParallel ? 'tilt' : 'move';
}

function middle([a, b]) {
  return [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
}

function span([a, b]) {
  return [b[0] - a[0], b[1] - a[1]];
}

function length([x, y]) {
  return Math.hypot(x, y);
}
