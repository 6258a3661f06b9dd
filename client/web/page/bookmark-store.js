/** Views that the user saved, per city, in this browser. */

import { load, save } from './storage.js';
import { cameraNumbers, isTime } from './view-text.js';

const MAX_BOOKMARKS = 200;
const MAX_NAME_CHARS = 80;

/**
 * A saved view.
 * @typedef {{name: string, camera: string, time: string|null}} Bookmark
 */

/** The saved views of one city. Other tabs change them, too, so they are read at each use. */
export class BookmarkStore {
  /** @type {string} */ #key;

  /** @param {string} city Name of the city. */
  constructor(city) {
    this.#key = `bookmarks.${city}`;
  }

  /** All views, the newest first. @returns {Bookmark[]} */
  get list() {
    const stored = load(this.#key, []);
    return (Array.isArray(stored) ? stored : []).filter(isBookmark).slice(0, MAX_BOOKMARKS);
  }

  /**
   * Saves a view in front. Returns whether it will outlast the page.
   * @param {Bookmark} bookmark
   * @returns {boolean}
   */
  add({ name, camera, time }) {
    return save(this.#key, [{ name: name.slice(0, MAX_NAME_CHARS), camera, time }, ...this.list]);
  }

  /**
   * Deletes a view.
   * @param {Bookmark} bookmark
   */
  remove(bookmark) {
    save(this.#key, this.list.filter((other) => JSON.stringify(other) !== JSON.stringify(bookmark)));
  }

  /**
   * Views whose names contain a text.
   * @param {string} text
   * @returns {Bookmark[]}
   */
  find(text) {
    const wanted = text.trim().toLocaleLowerCase();
    return wanted === '' ? [] : this.list.filter(({ name }) => name.toLocaleLowerCase().includes(wanted));
  }
}

/** Whether a stored value is a view. Other scripts of the origin may have changed it. */
function isBookmark(value) {
  return (
    typeof value?.name === 'string' &&
    typeof value.camera === 'string' &&
    cameraNumbers(value.camera) !== null &&
    (value.time === null || isTime(value.time))
  );
}
