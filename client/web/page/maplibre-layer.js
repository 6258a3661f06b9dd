/** A city as a layer of a MapLibre map: cast at the map's camera, and drawn with its depth. */

import { CastPainter } from './cast-painter.js';
import { castPlace, seenFrom } from './cast-view.js';
import { Caster } from './caster.js';
import { HiddenLabels } from './maplibre-labels.js';
import { mapView } from './maplibre-view.js';

/** What is nearer before a place than this does not hide it: the share of the distance allows for a coarse depth. */
const HIDES_M = 0.5;
const HIDES_SHARE = 0.002;

/** The members are documented for users in insula-maplibre.d.ts of the package. */
class InsulaLayer {
  type = 'custom';
  renderingMode = '3d';
  /** @type {Caster|null} */ caster = null;
  #options;
  /** @type {any} */ #map = null;
  /** @type {CastPainter|null} */ #painter = null;
  /** @type {import('./cast-view.js').CastView|null} */ #view = null;
  /** @type {HiddenLabels|null} */ #labels = null;
  /** The layer above, for the time after a lost context. @type {string|undefined} */ #above;
  #hasWarned = false;
  #listeners = {
    styledata: () => this.#noticeOrder(),
    idle: () => this.#updateLabels(),
    webglcontextlost: () => (this.#painter = null),
    webglcontextrestored: () => this.#addAgain(),
  };

  /** @param {any} options */
  constructor({ id = 'insula', minzoom, maxzoom, ...options }) {
    this.id = id;
    if (minzoom !== undefined) this.minzoom = minzoom;
    if (maxzoom !== undefined) this.maxzoom = maxzoom;
    this.#options = options;
  }

  onAdd(map) {
    this.#map = map;
    this.#labels = new HiddenLabels(map, this.#options.labels ?? []);
    Object.entries(this.#listeners).forEach(([name, listener]) => map.on(name, listener));
    const repaint = () => map.triggerRepaint();
    this.caster ??= new Caster({
      ...this.#options,
      onOpen: (caster) => {
        if (!caster.grid) console.error('it is not known where on Earth this city lies: bake it with --crs');
        this.#options.onOpen?.(caster.manifest);
        repaint();
      },
      onFrame: (frame) => {
        this.#options.onFrame?.(frame);
        repaint();
      },
    });
  }

  onRemove(map, gl) {
    // The context may come back, and the layer with it.
    if (gl.isContextLost()) return;
    this.#painter?.dispose();
    this.#painter = null;
    Object.entries(this.#listeners).forEach(([name, listener]) => map.off(name, listener));
    this.caster?.dispose();
    this.caster = this.#map = this.#view = null;
  }

  render(gl, args) {
    const { mainMatrix } = args.defaultProjectionData ?? {};
    if (!mainMatrix) throw new Error('the layer of a city needs MapLibre GL JS 5 or newer');
    this.#view = this.#isFlat(args) ? this.#look(gl, mainMatrix) : null;
    const frame = this.caster?.frame;
    if (!this.#view || !frame) return;
    if (this.#painter?.gl !== gl) this.#painter = new CastPainter(gl);
    this.#painter.draw(frame, this.#view, gl.drawingBufferHeight, this.caster.lowestM);
  }

  /** What is drawn at a point in CSS pixels of the map. */
  async pick({ x, y }) {
    if (!this.#view) return null;
    const { clientWidth, clientHeight } = this.#map.getCanvas();
    const at = castPlace(this.#view, (2 * x) / clientWidth - 1, 1 - (2 * y) / clientHeight);
    return this.caster.pick(at.x, at.y);
  }

  /** Whether the city stands before a place; `null` where that is not known. */
  hides([lon, lat, height], slackM = 0) {
    const frame = this.caster?.frame;
    if (!this.#view || frame?.camera !== this.#view.camera) return null;
    const ground = this.#map.getTerrain() ? (this.#map.queryTerrainElevation([lon, lat]) ?? 0) : 0;
    const seen = seenFrom(frame, [...this.caster.grid.toXy([lon, lat]), this.#zeroM() + (height ?? ground)]);
    return seen && seen.hit < seen.distance * (1 - HIDES_SHARE) - HIDES_M - slackM;
  }

  async setColors(rules) {
    return this.#inMap.setColors(rules);
  }

  async setFilter(filter) {
    return this.#inMap.setFilter(filter);
  }

  setFeatureState(id, state) {
    this.#inMap.setFeatureState(id, state);
  }

  getFeatureState(id) {
    return this.#inMap.getFeatureState(id);
  }

  /** Whether the city's ground is drawn, or the map's is seen. */
  setGround(isShown) {
    this.#inMap.setGround(isShown);
  }

  /** Whether the picture of the map's view is there, and will not become finer. */
  get isFinal() {
    const frame = this.caster?.frame;
    return Boolean(this.#view && frame?.isFinal && frame.camera === this.#view.camera);
  }

  setTime(time) {
    this.#inMap.setTime(time);
  }

  setOptions(values) {
    this.#inMap.setOptions(values);
  }

  /** What casts. Fails before the layer is in a map. */
  get #inMap() {
    if (!this.caster) throw new Error(`the layer ${this.id} is in no map`);
    return this.caster;
  }

  /** Whether the map is one: on a globe, the city would lie beside its place. */
  #isFlat({ shaderData }) {
    if (shaderData?.variantName === 'mercator') return true;
    if (!this.#hasWarned) console.warn('a city is not drawn on a globe: set the projection of the map to mercator');
    this.#hasWarned = true;
    return false;
  }

  /** Casts at the map's camera. */
  #look({ drawingBufferWidth: width, drawingBufferHeight: height }, matrix) {
    const view = this.caster.manifest && mapView(this.caster, matrix, this.#map.getCenter(), this.#zeroM(), width, height);
    if (view) this.caster.cast(view.camera, view.width, view.height);
    else this.caster.rest();
    return view;
  }

  /** The height of the city that is at the map's height of zero: its ground, unless the map has terrain of its own. */
  #zeroM() {
    const { altitude } = this.#options;
    if (altitude !== undefined) return -altitude;
    return this.#map.getTerrain() ? 0 : this.caster.manifest.ground_z_m;
  }

  #updateLabels() {
    if (this.isFinal) this.#labels?.update((lonLat, slackM) => this.hides(lonLat, slackM));
  }

  #noticeOrder() {
    const order = this.#map.getLayersOrder();
    if (order.includes(this.id)) this.#above = order[order.indexOf(this.id) + 1];
  }

  #addAgain() {
    const map = this.#map;
    const add = () => {
      if (!map.getLayer(this.id)) map.addLayer(this, map.getLayer(this.#above) ? this.#above : undefined);
    };
    Object.entries(this.#listeners).forEach(([name, listener]) => map.off(name, listener));
    if (map.style?._loaded) add();
    else map.once('style.load', add);
  }
}

/** A layer for `map.addLayer`. @param {any} options */
export function insulaLayer(options) {
  return new InsulaLayer(options);
}
