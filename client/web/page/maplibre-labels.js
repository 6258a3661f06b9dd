/** Labels of a map that houses hide. */

/** A label may stand this far behind what hides it: inside of its own house. */
const SLACK_M = 15;
const STATE = 'insulaHidden';

/** The labels of some layers of symbols. Their features need ids. */
export class HiddenLabels {
  #map;
  #layers;
  /** What the map knows. @type {Map<string, boolean>} */ #known = new Map();

  /**
   * @param {any} map
   * @param {string[]} layers
   */
  constructor(map, layers) {
    [this.#map, this.#layers] = [map, layers];
  }

  /**
   * Hides and shows the labels that are in view.
   * @param {(lonLat: number[], slackM: number) => boolean|null} isHidden
   */
  update(isHidden) {
    const layers = this.#layers.filter((id) => this.#map.getLayer(id));
    layers.forEach((id) => this.#prepare(id));
    if (layers.length === 0) return;
    for (const { id, source, sourceLayer, geometry } of this.#map.queryRenderedFeatures({ layers })) {
      if (id === undefined || geometry.type !== 'Point') continue;
      const hidden = isHidden(geometry.coordinates, SLACK_M);
      const key = [source, sourceLayer, id].join('\n');
      if (hidden === null || hidden === (this.#known.get(key) ?? false)) continue;
      this.#known.set(key, hidden);
      this.#map.setFeatureState({ source, sourceLayer, id }, { [STATE]: hidden });
    }
  }

  /** Makes the opacity of a layer depend on the state. */
  #prepare(id) {
    for (const name of ['text-opacity', 'icon-opacity']) {
      const shown = this.#map.getPaintProperty(id, name) ?? 1;
      if (JSON.stringify(shown).includes(STATE)) continue;
      this.#map.setPaintProperty(id, name, ['case', ['boolean', ['feature-state', STATE], false], 0, shown]);
    }
  }
}
