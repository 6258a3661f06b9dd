/** A map beside a city. The view that the user touched last leads, and the other one follows. */

import '../insula-city.js';
import { cityCamera, mapView } from './linked-views.js';
import { Map as MapLibreMap, Marker } from './vendor/maplibre-gl.mjs';

const city = document.querySelector('#city');
const box = document.querySelector('#map');
const state = document.querySelector('#state');

let leader = city;
for (const element of [city, box]) {
  const lead = () => (leader = element);
  ['pointerdown', 'wheel', 'keydown'].forEach((name) => element.addEventListener(name, lead, { capture: true }));
}

/** A map that asks no server: a background and the city's extent. */
function makeMap(manifest, toLonLat) {
  const [[x0, y0], [x1, y1]] = manifest.bounds;
  const ring = [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]].map(toLonLat);
  const data = { type: 'Feature', properties: {}, geometry: { type: 'Polygon', coordinates: [ring] } };
  const style = {
    version: 8,
    sources: { extent: { type: 'geojson', data } },
    layers: [
      { id: 'background', type: 'background', paint: { 'background-color': '#e8ecef' } },
      { id: 'extent', type: 'fill', source: 'extent', paint: { 'fill-color': '#b9c8d6' } },
      { id: 'edge', type: 'line', source: 'extent', paint: { 'line-color': '#0b57a4', 'line-width': 2 } },
    ],
  };
  const attributionControl = { customAttribution: manifest.attribution.map(({ text }) => escaped(text)) };
  return new MapLibreMap({ container: box, style, center: ring[0], zoom: 13, maxPitch: 80, attributionControl });
}

/** The map takes attributions as markup. */
function escaped(text) {
  const node = document.createElement('span');
  node.textContent = text;
  return node.innerHTML;
}

city.addEventListener('ready', ({ detail: { manifest } }) => {
  if (!manifest.location) {
    state.textContent = 'It is not known where on Earth this city lies.';
    return;
  }
  const toLonLat = (position) => {
    const { lon, lat } = city.toLonLat(position);
    return [lon, lat];
  };
  const toXy = ([lon, lat]) => city.toPosition({ lon, lat });
  const groundZ = manifest.ground_z_m;
  const map = makeMap(manifest, toLonLat);
  const eye = new Marker({ color: '#d8432e' }).setLngLat(toLonLat(city.view.position)).addTo(map);

  const showOnMap = () => {
    const { camera, position } = city.view;
    eye.setLngLat(toLonLat(position));
    if (leader === city) map.jumpTo(mapView({ camera, groundZ, height: city.clientHeight, toLonLat }));
  };
  city.addEventListener('camera', showOnMap);
  map.on('move', () => {
    if (leader !== box) return;
    const fov = Number(city.view.camera.split(',')[5]);
    const view = { zoom: map.getZoom(), bearing: map.getBearing(), pitch: map.getPitch(), fov };
    const camera = cityCamera({ ...view, center: map.getCenter().toArray(), groundZ, height: city.clientHeight, toXy });
    city.flyTo(camera, { seconds: 0 });
  });
  showOnMap();
}, { once: true });
city.src = new URLSearchParams(location.search).get('src') ?? '/v1/cities/demo';
