/** What the parts of the page share: the city, its view, its bookmarks and its panels. */

import { BookmarkStore } from './bookmark-store.js';
import { printable } from './dom.js';
import { Panels } from './panels.js';
import { strings } from './strings.js';

/** The page of one city. Its event `rest` says that the view has not moved for a moment. */
export class PageContext extends EventTarget {
  panels = new Panels();
  /** @type {any} */ city;
  /** @type {any} */ manifest;
  /** @type {BookmarkStore} */ bookmarks;

  /**
   * @param {import('./insula-city.js').InsulaCity} city
   * @param {object} manifest
   */
  constructor(city, manifest) {
    super();
    [this.city, this.manifest] = [city, manifest];
    this.bookmarks = new BookmarkStore(printable(this.manifest.name));
  }

  /** Name of the city for people. */
  get title() {
    return printable(this.manifest.title) || printable(this.manifest.name);
  }

  /** Name of the coordinates' system. */
  get system() {
    return printable(this.manifest.crs) || strings.search.localMetres;
  }

  /** The shown view. @returns {import('./view-text.js').View} */
  get view() {
    const { camera, time } = this.city.view ?? {};
    const { selection } = this.city;
    // What a proposal adds has no number in the city.
    const object = selection.length === 1 && selection[0].kind !== 'proposal' ? selection[0].id : null;
    return { camera: camera ?? this.city.camera, time: time ?? this.city.time, look: this.city.options.look, object };
  }

  /**
   * Goes to a view. What is not known stays as it is.
   * @param {import('./view-text.js').View} view
   */
  open({ camera, time, look, object = null }) {
    if (look) this.city.setOptions({ look });
    if (camera) this.city.flyTo(camera).catch(() => {});
    if (time) this.city.setTime(time);
    // A link may name an object that the city no longer has.
    if (object !== null) this.city.select([object]).catch(() => {});
  }
}
