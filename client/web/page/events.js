/** Events of the element for parts of the page that are loaded after it has started. */

/**
 * Listens to an event, and receives the last one if there was one already.
 * @param {import('./insula-city.js').InsulaCity} city
 * @param {'status'|'adapter'|'progress'|'ready'|'frame'|'camera'|'colors'|'selection'} name
 * @param {(event: {detail: any}) => void} listener
 */
export function follow(city, name, listener) {
  const detail = city.last[name];
  if (detail) listener({ detail });
  city.addEventListener(name, (event) => listener(/** @type {CustomEvent} */ (event)));
}
