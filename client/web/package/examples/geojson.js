/** Degrees: a district, a way and a stop lie on the city, a model stands in it, and a clicked object gets a colour of its own. */

import '../insula-city.js';

const city = document.querySelector('#city');
const show = (id, text) => (document.getElementById(id).textContent = text);
const colours = { district: '#1f7a4d', way: '#c2185b', stop: '#0b57a4' };

city.addEventListener('pick', ({ detail: { lon, lat, height, object } }) => {
  show('picked', `${lon.toFixed(6)}, ${lat.toFixed(6)}, ${height.toFixed(1)} m`);
  if (object) city.setFeatureState(object.id, city.getFeatureState(object.id).color ? null : { color: '#e07b00' });
});

/** Features around the middle of the city, of a few hundred metres. */
function features({ longitude_deg: lon, latitude_deg: lat }) {
  const at = (east, north) => [lon + east * 0.001, lat + north * 0.0007];
  const feature = (id, type, coordinates) => ({ type: 'Feature', id, properties: { id }, geometry: { type, coordinates } });
  return [
    feature('district', 'Polygon', [[at(-2, -2), at(2, -2), at(3, 1), at(0, 2), at(-2, 1), at(-2, -2)]]),
    feature('way', 'LineString', [at(-4, -3), at(0, 0), at(4, 1)]),
    feature('stop', 'Point', at(0, 0)),
  ];
}

async function start() {
  const { title, location } = await city.whenReady();
  if (!location) throw new Error(`It is not known where ${title} lies on Earth.`);
  const style = ({ id }) => ({ color: colours[id], fill: 'rgb(31 122 77 / 35%)', width: 4 });
  const { ids } = await city.addGeoJson({ type: 'FeatureCollection', features: features(location) }, style);
  show('state', `${ids.join(', ')} on ${title}`);
  const { longitude_deg: lon, latitude_deg: lat } = location;
  const bounds = [lon - 0.003, lat - 0.002, lon + 0.003, lat + 0.002];
  document.getElementById('fit').addEventListener('click', () => city.fitBounds(bounds, { pitch: -50 }));
  document.getElementById('file').addEventListener('change', async ({ target }) => {
    const data = JSON.parse(await target.files[0].text());
    const { ids: added, skipped } = await city.addGeoJson(data);
    show('state', `${added.length} features, ${skipped.length} skipped`);
  });
  let model = null;
  document.getElementById('model').addEventListener('change', async ({ target }) => {
    if (model !== null) city.removeModel(model);
    model = null;
    try {
      model = await city.addModel({ bytes: await target.files[0].arrayBuffer(), lon, lat, heading: 20 });
      show('state', `model ${model}`);
    } catch ({ message }) {
      show('state', message);
    }
  });
}

// Set last, so that no event is missed.
city.src = new URLSearchParams(location.search).get('src') ?? '/v1/cities/demo';
start().catch(({ message }) => show('state', message));
