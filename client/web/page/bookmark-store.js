/** Views that the user saved, per city, in this browser. */

import { load, save } from './storage.js';
import { cameraNumbers, isTime } from './view-text.js';

const MAX_BOOKMARKS = 200;
const MAX_NAME_CHARS = 80;

/**
 * A saved view.
 * @typedef {{name: string, camera: string, time: string|null}} Bookmark
 */

/** The saved views of one city. */
export class BookmarkStore {
  /** @type {string} */ #key;
  /** @type {Bookmark[]} */ #list;

  /**
   * Reads the views of a city.
   * @param {string} city Name of the city.
   */
  constructor(city) {
    this.#key = `bookmarks.${city}`;
    const stored = load(this.#key, []);
    this.#list = (Array.isArray(stored) ? stored : []).filter(isBookmark).slice(0, MAX_BOOKMARKS);
  }

  /** All views, the newest first. @returns {readonly Bookmark[]} */
  get list() {
    return this.#list;
  }

  /**
   * Saves a view in front. Returns whether it will outlast the page.
   * @param {Bookmark} bookmark
   * @returns {boolean}
   */
  add({ name, camera, time }) {
    this.#list = [{ name: name.slice(0, MAX_NAME_CHARS), camera, time }, ...this.#list].slice(0, MAX_BOOKMARKS);
    return save(this.#key, this.#list);
  }

  /**
   * Deletes a view.
   * @param {Bookmark} bookmark
   */
  remove(bookmark) {
    this.#list = this.#list.filter((other) => other !== bookmark);
    save(this.#key, this.#list.length > 0 ? this.#list : null);
  }

  /**
   * Views whose names contain a text.
   * @param {string} text
   * @returns {Bookmark[]}
   */
  find(text) {
    const wanted = text.trim().toLocaleLowerCase();
    return wanted === '' ? [] : this.#list.filter(({ name }) => name.toLocaleLowerCase().includes(wanted));
  }
}

/** Whether a stored value is a view. Other scripts of the origin may have changed it. */
function isBookmark(value) {
  return (
    typeof value?.name === 'string' &&
    typeof value.camera === 'string' &&
    cameraNumbers(value.camera) !== null &&
    (value.time === null || (typeof value.time === 'string' && isTime(value.time)))
  );
}
