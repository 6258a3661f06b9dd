/** Entry of the application page. The viewer starts first; the controls follow once there is something to see. */

import { prepareEngine } from './engine-client.js';
import { follow } from './events.js';
import { InsulaCity } from './insula-city.js';
import { load } from './storage.js';
import { loadLanguage, strings } from './strings.js';
import { applyTheme } from './theme.js';
import { parseView } from './view-text.js';
import { registerServiceWorker } from './workers.js';

/** The manifest in the page; `null` if there is none or it is malformed. */
function inlineManifest() {
  try {
    return JSON.parse(document.getElementById('insula-manifest')?.textContent ?? 'null');
  } catch {
    return null;
  }
}

/** The manifest of a city that is not in the page, when the engine has it. */
function loadedManifest(city) {
  return new Promise((resolve) => {
    city.addEventListener('ready', ({ detail }) => resolve(detail.manifest), { once: true });
  });
}

/** When there is something to see, or a reason why not. */
function firstNews(city) {
  return new Promise((resolve) => {
    follow(city, 'ready', resolve);
    follow(city, 'status', ({ detail: { kind } }) => kind !== null && kind !== 'loading' && resolve());
  });
}

/** The languages that lie beside this script, as the page lists them. @returns {string[]} */
function offeredLanguages() {
  const list = document.querySelector('meta[name="insula-languages"]')?.getAttribute('content') ?? '';
  return list.split(' ').filter((code) => /^[a-z]{2,3}$/.test(code));
}

/**
 * Reads the module that the page has preloaded for the worker, which gets it from the browser's cache. Browsers warn of what the page itself
 * never reads.
 */
function readPreloaded() {
  const address = document.querySelector('link[rel="preload"][as="fetch"]')?.getAttribute('href');
  if (address) fetch(address).then((response) => response.arrayBuffer()).catch(() => {});
}

prepareEngine();
readPreloaded();
const language = loadLanguage(navigator.languages ?? [navigator.language], offeredLanguages());
if (!customElements.get('insula-city')) customElements.define('insula-city', InsulaCity);

async function start() {
  const app = document.getElementById('insula-app');
  /** @type {import('./insula-city.js').InsulaCity|null} */
  const city = app?.querySelector('insula-city') ?? null;
  if (!app || !city) return;
  app.classList.add('is-running');
  applyTheme();
  // The element starts after this script has run, and so with these values.
  city.manifest = inlineManifest();
  const { camera, time, look, object } = parseView(location.hash);
  if (camera) city.camera = camera;
  if (time) city.time = time;
  const [tau, shadows] = [load('tau', undefined), load('shadows', undefined)];
  city.setOptions({ tau, shadows, look: look ?? undefined });
  await Promise.all([language, new Promise((resolve) => setTimeout(resolve))]);
  document.documentElement.lang = strings.language;
  document.documentElement.dir = strings.direction;
  city.describeInWords();
  const manifest = city.manifest ?? (await loadedManifest(city));
  await firstNews(city);
  const { startControls } = await import('./controls.js');
  startControls(app, city, manifest);
  if (object !== null && object !== undefined) city.select([object]).catch(() => {});
  const worker = document.querySelector('meta[name="insula-service-worker"]')?.getAttribute('content');
  if (worker) registerServiceWorker(worker);
}

start();
