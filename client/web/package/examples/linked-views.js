/** Cameras of a city as views of a web map, and back. */

/** Circumference of the sphere of web maps in metres, and pixels of its map at zoom 0. */
const EQUATOR_M = 40_075_016.686;
const TILE_PX = 512;
/** A camera that hardly looks down looks at a point this far ahead at most. */
const MAX_AHEAD_M = 5000;

const rad = (degrees) => (degrees * Math.PI) / 180;

/** The view of a map that shows what a camera looks at. `height` is that of the city's element in CSS pixels. */
export function mapView({ camera, groundZ, height, toLonLat }) {
  const [x, y, z, azimuth, pitch, fov] = camera.split(',').map(Number);
  const above = Math.max(z - groundZ, 1);
  const distance = pitch < 0 ? Math.min(above / Math.sin(rad(-pitch)), MAX_AHEAD_M) : MAX_AHEAD_M;
  const ahead = distance * Math.cos(rad(pitch));
  const center = toLonLat([x + ahead * Math.sin(rad(azimuth)), y + ahead * Math.cos(rad(azimuth))]);
  const metresPerPixel = (2 * distance * Math.tan(rad(fov) / 2)) / height;
  const zoom = Math.log2((EQUATOR_M * Math.cos(rad(center[1]))) / (TILE_PX * metresPerPixel));
  return { center, zoom, bearing: azimuth, pitch: Math.min(Math.max(90 + pitch, 0), 80) };
}

/** The camera of a city that shows what a map shows. */
export function cityCamera({ center, zoom, bearing, pitch, groundZ, height, fov, toXy }) {
  const metresPerPixel = (EQUATOR_M * Math.cos(rad(center[1]))) / (TILE_PX * 2 ** zoom);
  const distance = (metresPerPixel * height) / (2 * Math.tan(rad(fov) / 2));
  const down = rad(Math.max(90 - pitch, 5));
  const [x, y] = toXy(center);
  const ahead = distance * Math.cos(down);
  const azimuth = ((bearing % 360) + 360) % 360;
  const position = [
    x - ahead * Math.sin(rad(azimuth)),
    y - ahead * Math.cos(rad(azimuth)),
    groundZ + distance * Math.sin(down),
  ];
  return [...position.map((v) => v.toFixed(3)), azimuth.toFixed(4), ((-down * 180) / Math.PI).toFixed(4), fov].join(',');
}
