/** The element as pages of others have it: with degrees, figures of GeoJSON, and states of single objects. */

import { AddedModels } from './added-models.js';
import { DrapedFigures } from './draped-figures.js';
import { cameraText, earthCamera, fitting, projected, unprojected } from './earth-camera.js';
import { shapesOf } from './geojson.js';
import { InsulaCity as Element } from './insula-city.js';
import { isLonLat, lonLatGrid } from './lon-lat.js';
import { ObjectStates } from './object-states.js';
import { useTexts } from './strings.js';

/** Field of view of a camera that does not say it, before there is a view. */
const DEFAULT_FOV_DEG = 40;
const DEFAULT_FIT_PITCH_DEG = -45;
const DEFAULT_PADDING_PX = 32;
/** Cameras further from the middle of the city show none of it. */
const FAR_KM = 500;

/** The members are documented for users in insula-viewer.d.ts of the package. */
export class InsulaCity extends Element {
  /** @type {{manifest: any, grid: import('./lon-lat.js').LonLatGrid|null}} */
  #known = { manifest: null, grid: null };
  /** @type {DrapedFigures|null} */ #figures = null;
  #models = new AddedModels((op, values) => this.ask(op, values));
  #states = new ObjectStates((op, values) => this.steer(op, values));

  constructor() {
    super();
    this.addEventListener('frame', ({ detail }) => this.#figures?.show(detail));
    this.addEventListener('ready', () => {
      this.#states.sendAll();
      this.#models.sendAll();
    });
  }

  /** Numbers of objects and places on Earth are those of one city. */
  attributeChangedCallback(name, before, value) {
    if (name === 'src' && before !== null && before !== value) {
      this.#states.clear();
      this.#figures?.clear();
      this.#models.clear();
    }
    super.attributeChangedCallback(name, before, value);
  }

  whenReady() {
    const { ready, status } = this.last;
    if (ready) return Promise.resolve(this.manifest);
    if (status?.kind === 'error') return Promise.reject(new Error(status.text));
    return new Promise((resolve, reject) => {
      const end = new AbortController();
      const settle = (act) => (event) => act(event.detail) !== false && end.abort();
      const fail = ({ kind, text }) => kind === 'error' && reject(new Error(text));
      this.addEventListener('ready', settle(() => resolve(this.manifest)), end);
      this.addEventListener('status', settle(fail), end);
    });
  }

  get place() {
    const { grid } = this;
    return grid && this.view ? earthCamera(grid, this.view.camera) : null;
  }

  toLonLat(position) {
    const [lon, lat] = this.#needGrid().toLonLat(position);
    return { lon, lat, height: position[2] ?? this.manifest.ground_z_m };
  }

  toPosition(place) {
    const { lon, lat, height } = placeOf(place);
    return [...this.#needGrid().toXy([lon, lat]), height ?? this.manifest.ground_z_m];
  }

  async flyTo(place, options) {
    if (place === null || typeof place !== 'object' || Array.isArray(place)) return super.flyTo(place, options);
    await this.whenReady();
    if (place.lon !== undefined || place.lat !== undefined) this.#checkNear({ ...this.place, ...place });
    const now = this.place ?? { lon: NaN, lat: NaN, height: NaN, heading: 0, pitch: DEFAULT_FIT_PITCH_DEG, fov: DEFAULT_FOV_DEG };
    return super.flyTo(cameraText(this.#needGrid(), { ...now, ...place }), options);
  }

  async fitBounds(bounds, { heading, pitch = DEFAULT_FIT_PITCH_DEG, padding = DEFAULT_PADDING_PX, seconds } = {}) {
    await this.whenReady();
    const [west, south, east, north] = bounds.flat().map(Number);
    if (!isLonLat(west, south) || !isLonLat(east, north)) throw new RangeError('bounds are west, south, east and north in degrees');
    this.#checkNear({ lon: (west + east) / 2, lat: (south + north) / 2 });
    const corners = [[west, south], [east, south], [east, north], [west, north]].map((corner) => this.toPosition(corner));
    const fov = this.place?.fov ?? DEFAULT_FOV_DEG;
    const middle = { lon: (west + east) / 2, lat: (south + north) / 2, height: this.manifest.ground_z_m };
    const text = cameraText(this.#needGrid(), { ...middle, heading: heading ?? this.place?.heading ?? 0, pitch, fov });
    const azimuth = Number(text.split(',')[3]);
    return super.flyTo(fitting(corners, { azimuth, pitch, fov }, this.#size(), padding), seconds === undefined ? {} : { seconds });
  }

  project(place) {
    return this.view ? projected(this.view.camera, this.#size(), this.toPosition(place)) : null;
  }

  unproject(x, y, { height = this.manifest?.ground_z_m } = {}) {
    const position = this.view && unprojected(this.view.camera, this.#size(), x, y, height);
    return position ? this.toLonLat(position) : null;
  }

  async pick(x, y) {
    const hit = await super.pick(x, y);
    return hit && this.grid ? { ...hit, ...this.toLonLat(hit.position) } : hit;
  }

  async screenshot(options) {
    this.#states.sendChanged();
    const picture = await super.screenshot(options);
    return this.#figures ? this.#figures.over(picture) : picture;
  }

  setFeatureState(id, state) {
    this.#states.set(id, state);
  }

  getFeatureState(id) {
    return this.#states.get(id);
  }

  async addGeoJson(data, style = {}) {
    await this.whenReady();
    const { shapes, skipped } = shapesOf(data, this.#needGrid());
    this.#figures ??= new DrapedFigures(this, (op, values) => this.ask(op, values));
    return { ...this.#figures.add(shapes, style), skipped };
  }

  async addModel({ url, bytes, lon, lat, height, heading = 0, scale = 1 }) {
    if (!Number.isFinite(heading) || !(Number.isFinite(scale) && scale > 0)) throw new RangeError('a heading is a number, a scale one above 0');
    await this.whenReady();
    this.#checkNear({ lon, lat });
    const [x, y, z] = this.toPosition({ lon, lat, height });
    const ground = height ?? (await this.ask('heights', { places: new Float64Array([x, y]) }))[0];
    const level = { lon, lat, height: z, pitch: 0, fov: DEFAULT_FOV_DEG };
    const azimuth = Number(cameraText(this.#needGrid(), { ...level, heading }).split(',')[3]);
    return this.#models.add({ url, bytes }, [x, y, ground], azimuth, scale);
  }

  removeModel(id) {
    return this.#models.remove(id);
  }

  /** The grid of the city's longitudes and latitudes; `null` before the manifest, and if it does not say where the city lies. */
  get grid() {
    if (this.#known.manifest !== this.manifest) this.#known = { manifest: this.manifest, grid: lonLatGrid(this.manifest) };
    return this.#known.grid;
  }

  #needGrid() {
    const { grid } = this;
    if (grid) return grid;
    const isLoaded = Boolean(this.manifest);
    throw new Error(isLoaded ? 'it is not known where on Earth this city lies: bake it with --crs' : 'no city yet: wait for whenReady()');
  }

  /** Fails for places far from the city. @param {{lon: number, lat: number}} place */
  #checkNear({ lon, lat }) {
    const [low, high] = this.manifest?.focus ?? [];
    if (!high || !isLonLat(lon, lat)) return;
    const [x, y] = this.#needGrid().toXy([lon, lat]);
    const km = Math.hypot(x - (low[0] + high[0]) / 2, y - (low[1] + high[1]) / 2) / 1000;
    if (km > FAR_KM) throw new RangeError(`longitude ${lon}, latitude ${lat} are ${Math.round(km)} km from the city: the longitude comes first`);
  }

  #size() {
    return { width: Math.max(this.clientWidth, 1), height: Math.max(this.clientHeight, 1) };
  }
}

/** Gives the elements of the page the words of a language: those of a file `language-CODE.json`, or some of them. @param {any} texts */
export function setTexts(texts) {
  useTexts(texts);
  document.querySelectorAll('insula-city').forEach((city) => city.describeInWords?.());
}

/** A place as users give it, `[lon, lat, height]` or with names. */
function placeOf(place) {
  const { lon, lat, height } = Array.isArray(place) ? { lon: place[0], lat: place[1], height: place[2] } : place;
  if (isLonLat(lon, lat)) return { lon, lat, height };
  throw new RangeError('a place has a longitude of -360 to 360 and a latitude of -90 to 90 degrees');
}

if (globalThis.customElements && !customElements.get('insula-city')) customElements.define('insula-city', InsulaCity);
