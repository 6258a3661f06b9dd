/** Draws a city with the package, does what a page does with it, and reports to the test. */
import '@insula/viewer';
import { createCaster } from '@insula/viewer/caster';
import { insulaLayer } from '@insula/viewer/maplibre';
import { insulaObject } from '@insula/viewer/three';

const query = new URLSearchParams(location.search);
const send = (kind, body) => fetch(`${query.get('report')}/${kind}`, { method: 'POST', mode: 'no-cors', body });
const fail = (error) => send('error', String(error?.stack ?? error));
addEventListener('error', ({ message }) => fail(message));
addEventListener('unhandledrejection', ({ reason }) => fail(reason));

const counts = {};
const city = document.createElement('insula-city');
city.style.cssText = 'inline-size: 640px; block-size: 400px';
for (const kind of ['ready', 'frame', 'status']) city.addEventListener(kind, () => (counts[kind] = (counts[kind] ?? 0) + 1));
city.setAttribute('adapter', 'cpu');
city.src = query.get('src');
document.body.append(city);

function equal(what, found, expected, tolerance) {
  const isNear = Object.entries(expected).every(([key, value]) => Math.abs(found?.[key] - value) <= tolerance);
  if (!isNear) throw new Error(`${what}: ${JSON.stringify(found)}, not ${JSON.stringify(expected)}`);
}

/** Resolves after the next picture that nothing can improve and that shows this camera. */
function settled() {
  return new Promise((resolve) => {
    city.addEventListener('frame', function listen({ detail }) {
      if (!detail.final || !detail.isSettled) return;
      city.removeEventListener('frame', listen);
      resolve(detail);
    });
  });
}

/** The bytes of the pixels of a picture of the city. */
async function pixels() {
  const bitmap = await createImageBitmap(await city.screenshot({ width: 640, height: 400 }));
  const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext('2d');
  context.drawImage(bitmap, 0, 0);
  return context.getImageData(0, 0, bitmap.width, bitmap.height).data;
}

/** Number of different colours of a picture, to 5 bits. */
async function coloursOf() {
  const data = await pixels();
  const seen = new Set();
  for (let i = 0; i < data.length; i += 4) seen.add(((data[i] >> 3) << 10) | ((data[i + 1] >> 3) << 5) | (data[i + 2] >> 3));
  return seen.size;
}

/** Share of the pixels that are clearly red. */
async function redShare() {
  const data = await pixels();
  let red = 0;
  for (let i = 0; i < data.length; i += 4) red += data[i] > 2 * data[i + 1] && data[i] > 2 * data[i + 2] ? 4 : 0;
  return red / data.length;
}

/** Draws all objects in a colour, and then as they are. */
async function useStates() {
  const { objects } = await city.schema();
  const set = (state) => Array.from({ length: objects }, (_, id) => city.setFeatureState(id, state));
  const before = await redShare();
  set({ color: 'rgb(255 0 0)' });
  const coloured = await redShare();
  set(null);
  const after = await redShare();
  if (coloured < before + 0.02 || after !== before) throw new Error(`red: ${before}, ${coloured}, ${after}`);
}

async function useDegrees() {
  const { lon, lat, height } = city.toLonLat(city.view.position);
  equal('place', city.place, { lon, lat, height }, 1e-3);
  const here = city.unproject(320, 300);
  equal('project', city.project(here), { x: 320, y: 300 }, 0.01);
  const [d, e] = [0.0005, 0.0008];
  await city.fitBounds([here.lon - e, here.lat - d, here.lon + e, here.lat + d], { heading: 30, pitch: -50, seconds: 0 });
  const frame = await settled();
  equal('heading', city.place, { heading: 30, pitch: -50 }, 0.01);
  equal('middle', city.project(here), { x: 320, y: 200 }, 2);
  const hit = await city.pick(320, 200);
  equal('pick', hit, { lon: here.lon, lat: here.lat }, 0.002);
  const ring = [[-e, -d], [e, -d], [e, d], [-e, d], [-e, -d]].map(([x, y]) => [here.lon + x / 2, here.lat + y / 2]);
  const feature = (id, type, coordinates) => ({ type: 'Feature', id, properties: {}, geometry: { type, coordinates } });
  const features = [
    feature('area', 'Polygon', [ring]),
    feature('way', 'LineString', [[here.lon - e, here.lat - d], [here.lon + e, here.lat + d]]),
    feature('spot', 'Point', [here.lon, here.lat]),
    feature('bad', 'Point', ['x']),
  ];
  const layer = await city.addGeoJson({ type: 'FeatureCollection', features }, { color: '#d01060', fill: 'rgb(208 16 96 / 50%)' });
  if (layer.skipped.length !== 1 || layer.skipped[0].index !== 3) throw new Error(JSON.stringify(layer.skipped));
  const draped = city.shadowRoot.querySelector('canvas.draped');
  const isDrawn = () => draped.getContext('2d').getImageData(0, 0, draped.width, draped.height).data.some((v, i) => i % 4 === 3 && v > 0);
  while (!isDrawn()) await new Promise(requestAnimationFrame);
  return frame;
}

/** A glTF file in one piece: a large red triangle that faces up. */
function triangle() {
  const json = JSON.stringify({
    asset: { version: '2.0' },
    nodes: [{ mesh: 0 }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0 }, material: 0 }] }],
    materials: [{ pbrMetallicRoughness: { baseColorFactor: [0.5, 0, 0, 1] } }],
    accessors: [{ bufferView: 0, componentType: 5126, count: 3, type: 'VEC3' }],
    bufferViews: [{ buffer: 0, byteLength: 36 }],
    buffers: [{ byteLength: 36 }],
  });
  const words = (...numbers) => new Uint32Array(numbers);
  const positions = new Float32Array([-60, 60, 60, 60, 60, 60, 0, 60, -60]);
  const parts = [words(json.length, 0x4e4f534a), json, words(36, 0x004e4942), positions];
  return new Blob([words(0x46546c67, 2, 12 + 8 + json.length + 8 + 36), ...parts]).arrayBuffer();
}

/** A model stands in the middle of the view until it is removed. */
async function useModel() {
  const [{ lon, lat }, before] = [city.unproject(320, 200), await redShare()];
  const model = await city.addModel({ bytes: await triangle(), lon, lat, heading: 20 });
  const shown = await redShare();
  if (!city.removeModel(model)) throw new Error('there is no model');
  const after = await redShare();
  if (shown < before + 0.02 || after > before + 0.01) throw new Error(`red: ${before}, ${shown} with a model, ${after}`);
}

/** A caster has a worker of its own. */
async function useCaster() {
  if (insulaLayer({ url: city.src }).id !== 'insula' || typeof insulaObject !== 'function') throw new Error('no layer');
  const frame = new Promise((resolve) => createCaster({ url: city.src, adapter: 'cpu', onFrame: (cast) => cast.isFinal && resolve(cast) })
    .then((caster) => caster.setCamera(city.view.camera, { width: 64, height: 40 }), fail));
  const { distances } = await frame;
  if (!distances.some(Number.isFinite)) throw new Error('the caster sees nothing');
}

city.addEventListener('ready', async () => {
  try {
    await city.whenReady();
    await settled();
    const colours = await coloursOf();
    await useStates();
    await useDegrees();
    await useModel();
    await useCaster();
    const picture = await city.screenshot({ width: 640, height: 400 });
    await send('picture', picture);
    await send('done', JSON.stringify({ colours, ready: counts.ready }));
  } catch (error) {
    await fail(error);
  }
});
city.addEventListener('status', ({ detail: { kind, text } }) => kind === 'error' && fail(text));
