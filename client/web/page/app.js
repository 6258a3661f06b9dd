/** Entry of the application page. The viewer starts first; the controls follow while it works. */

import { startControls } from './controls.js';
import { prepareEngine } from './engine-client.js';
import { InsulaCity } from './insula-city.js';
import { load } from './storage.js';
import { strings } from './strings.js';
import { applyTheme } from './theme.js';
import { parseView } from './view-text.js';

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

/** Registers the worker that keeps visited cities for offline use, if the page names one. */
function registerServiceWorker() {
  const path = document.querySelector('meta[name="insula-service-worker"]')?.getAttribute('content');
  // Without it, the page works online. Browsers offer it only on https and localhost.
  if (path && 'serviceWorker' in navigator) navigator.serviceWorker.register(path, { updateViaCache: 'none' }).catch(() => {});
}

prepareEngine();
if (!customElements.get('insula-city')) customElements.define('insula-city', InsulaCity);

async function start() {
  const app = document.getElementById('insula-app');
  /** @type {import('./insula-city.js').InsulaCity|null} */
  const city = app?.querySelector('insula-city') ?? null;
  if (!app || !city) return;
  document.documentElement.lang = strings.language;
  document.documentElement.dir = strings.direction;
  app.classList.add('is-running');
  applyTheme();
  // The element starts after this script has run, and so with these values.
  city.manifest = inlineManifest();
  const { camera, time, look, object } = parseView(location.hash);
  if (camera) city.camera = camera;
  if (time) city.time = time;
  const [tau, shadows] = [load('tau', null), load('shadows', null)];
  city.setOptions({ tau, shadows, look });
  await new Promise((resolve) => setTimeout(resolve));
  startControls(app, city, city.manifest ?? (await loadedManifest(city)));
  if (object !== null && object !== undefined) city.select([object]).catch(() => {});
  registerServiceWorker();
}

start();
