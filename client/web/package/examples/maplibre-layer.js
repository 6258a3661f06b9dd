/** A city as a layer of a MapLibre map: houses hide lines, boxes and labels of the map, and are hidden by them. */

import { insulaLayer } from '../insula-maplibre.js';
import { Map as MapLibreMap } from './vendor/maplibre-gl.mjs';

const state = document.querySelector('#state');
const query = new URLSearchParams(location.search);
const url = query.get('src') ?? '/v1/cities/demo';

/** A map that asks no server. The data come when the city is known. */
const empty = { type: 'FeatureCollection', features: [] };
const style = {
  version: 8,
  sources: { lines: { type: 'geojson', data: empty }, boxes: { type: 'geojson', data: empty }, places: { type: 'geojson', data: empty } },
  layers: [
    { id: 'background', type: 'background', paint: { 'background-color': '#e8ecef' } },
    { id: 'lines', type: 'line', source: 'lines', paint: { 'line-color': '#0b57a4', 'line-width': 3 } },
    {
      id: 'boxes',
      type: 'fill-extrusion',
      source: 'boxes',
      paint: { 'fill-extrusion-color': '#d8432e', 'fill-extrusion-height': ['get', 'height'] },
    },
    { id: 'places', type: 'symbol', source: 'places', layout: { 'icon-image': 'pin', 'icon-allow-overlap': true } },
  ],
};
const map = new MapLibreMap({ container: 'map', style, center: [0, 0], zoom: 16, pitch: 60, bearing: -20, maxPitch: 80 });
// For the console of the browser.
globalThis.map = map;

/** Around the middle of the city. Metres become degrees well enough for an example. */
function show(manifest) {
  if (!manifest.location) {
    state.textContent = 'It is not known where on Earth this city lies.';
    return;
  }
  const { longitude_deg: lon, latitude_deg: lat } = manifest.location;
  const at = (east, north) => [lon + east / (111_320 * Math.cos((lat * Math.PI) / 180)), lat + north / 110_950];
  const feature = (type, coordinates, properties = {}) => ({ type: 'Feature', properties, geometry: { type, coordinates } });
  const ring = [[-15, -15], [15, -15], [15, 15], [-15, 15], [-15, -15]].map(([x, y]) => at(x, y - 60));
  const line = [-400, 400].map((x) => at(x, 0));
  const places = [-200, -100, 0, 100, 200].map((x, i) => ({ ...feature('Point', at(x, 40)), id: i + 1 }));
  map.getSource('boxes').setData(feature('Polygon', [ring], { height: 40 }));
  map.getSource('lines').setData(feature('LineString', line));
  map.getSource('places').setData({ type: 'FeatureCollection', features: places });
  map.jumpTo({ center: [lon, lat] });
  state.textContent = `${manifest.title}. Click a house.`;
}

const layer = insulaLayer({ url, time: query.get('time'), labels: ['places'], onOpen: show });
globalThis.layer = layer;

map.on('load', () => {
  const size = 24;
  const pin = new Uint8Array(4 * size * size).map((_, i) => [138, 43, 226, 255][i % 4]);
  map.addImage('pin', { width: size, height: size, data: pin });
  // Below the labels: what stands above the city in the style lies over it.
  map.addLayer(layer, 'places');
});
map.on('click', async ({ point }) => {
  const hit = await layer.pick(point);
  const at = hit && [hit.lon.toFixed(5), hit.lat.toFixed(5), `${hit.height.toFixed(1)} m`].join(', ');
  state.textContent = hit ? `${hit.object?.kind ?? 'surface'} at ${at}` : 'nothing';
});
document.querySelector('#filter').addEventListener('click', () => layer.setFilter('height > 10'));
document.querySelector('#ground').addEventListener('click', () => layer.setGround(false));
