/** Longitudes and latitudes of positions in a city, as `earth.rs` of the protocol has them, and back. */

/** Half-axis of the WGS84 ellipsoid at the equator, and its eccentricity squared. */
const EQUATOR_M = 6_378_137;
const ECCENTRICITY_SQUARED = 6.694_379_990_14e-3;
/** Each step leaves less than a hundredth of the error of the last one in a city. */
const STEPS = 6;
/** A step to the north that tells in which direction it lies. */
const NORTH_STEP_DEG = 1e-4;

/** A place near a city lies within this multiple of its diagonal around its middle. */
const MAX_DIAGONALS = 3;

export const rad = (degrees) => (degrees * Math.PI) / 180;

/**
 * Between degrees on Earth and the first two coordinates of a city in metres.
 * @typedef {object} LonLatGrid
 * @property {(lonLat: number[]) => [number, number]} toXy
 * @property {(position: number[]) => [number, number]} toLonLat
 */

/**
 * The grid of a city, from the location of the middle of its focus: within a thousandth of the distance from there. `null` if the
 * manifest does not know where on Earth the city lies.
 * @param {any} manifest
 * @returns {LonLatGrid|null}
 */
export function lonLatGrid(manifest) {
  const middle = manifest?.location;
  if (!middle) return null;
  const origin = [0, 1].map((i) => (manifest.focus[0][i] + manifest.focus[1][i]) / 2);
  const metres = (latitude) => {
    const shape = 1 - ECCENTRICITY_SQUARED * Math.sin(rad(latitude)) ** 2;
    return [
      (EQUATOR_M / Math.sqrt(shape)) * Math.cos(rad(latitude)),
      (EQUATOR_M * (1 - ECCENTRICITY_SQUARED)) / shape ** 1.5,
    ];
  };
  /** @type {(lonLat: number[]) => [number, number]} */
  const toXy = ([longitude, latitude]) => {
    const east = rad(turn(longitude - middle.longitude_deg));
    const halfway = (latitude + middle.latitude_deg) / 2;
    const [perEast, perNorth] = metres(halfway);
    const [x, y] = [perEast * east, perNorth * rad(latitude - middle.latitude_deg)];
    // The meridian of the city's middle converges to the azimuth at half way. Then to the grid's north.
    const angle = 0.5 * east * Math.sin(rad(halfway)) - rad(middle.north_deg);
    const [sin, cos] = [Math.sin(angle), Math.cos(angle)];
    return [origin[0] + x * cos - y * sin, origin[1] + x * sin + y * cos];
  };
  /** @type {(position: number[]) => [number, number]} */
  const toLonLat = ([x, y]) => {
    let [longitude, latitude] = [middle.longitude_deg, middle.latitude_deg];
    const [sin, cos] = [Math.sin(rad(middle.north_deg)), Math.cos(rad(middle.north_deg))];
    for (let step = 0; step < STEPS; step++) {
      const at = toXy([longitude, latitude]);
      const [dx, dy] = [x - at[0], y - at[1]];
      const [perEast, perNorth] = metres(latitude);
      longitude += ((dx * cos - dy * sin) / perEast) * (180 / Math.PI);
      latitude += ((dx * sin + dy * cos) / perNorth) * (180 / Math.PI);
    }
    return [turn(longitude), latitude];
  };
  return { toXy, toLonLat };
}

/** Azimuth of true north in the grid at a place, in degrees. */
export function northOf({ toXy }, [lon, lat]) {
  const towards = lat < 89 ? NORTH_STEP_DEG : -NORTH_STEP_DEG;
  const [from, to] = [toXy([lon, lat]), toXy([lon, lat + towards])];
  const sign = Math.sign(towards);
  return Math.atan2(sign * (to[0] - from[0]), sign * (to[1] - from[1])) * (180 / Math.PI);
}

/** Degrees from -180 to 180. */
function turn(degrees) {
  return ((((degrees + 180) % 360) + 360) % 360) - 180;
}

/**
 * Whether numbers are a place on Earth.
 * @param {unknown} longitude
 * @param {unknown} latitude
 */
export function isLonLat(longitude, latitude) {
  return Number.isFinite(longitude) && Number.isFinite(latitude) && Math.abs(Number(longitude)) <= 360 && Math.abs(Number(latitude)) <= 90;
}

/**
 * The place near a city that two or three numbers name, else `null`: metres of its system, or degrees, longitude or latitude first.
 * Without a height, that of the ground is taken.
 * @param {number[]} numbers
 * @param {any} manifest
 * @returns {number[]|null}
 */
export function placeNear([x, y, z], manifest) {
  const grid = lonLatGrid(manifest);
  const degrees = [[x, y], [y, x]].filter(([longitude, latitude]) => grid && isLonLat(longitude, latitude));
  const readings = [[x, y], ...degrees.map((lonLat) => /** @type {LonLatGrid} */ (grid).toXy(lonLat))];
  const places = readings.map((plan) => [...plan, z ?? manifest.ground_z_m]);
  return places.find((place) => isNear(place, manifest)) ?? null;
}

/** Whether a position is in a city or around it. */
export function isNear(position, { bounds: [low, high] }) {
  const length = (from, to) => Math.hypot(...to.map((v, i) => v - from[i]));
  const middle = low.map((v, i) => (v + high[i]) / 2);
  return length(middle, position) <= length(low, high) * MAX_DIAGONALS;
}
