/**
 * Values in localStorage. Browsers may refuse it, for example in private windows: then values last as long as the page.
 */

const PREFIX = 'insula.';
/** What could not be stored. @type {Map<string, string>} */
const fallback = new Map();

/**
 * The stored value of a key, or `otherwise` if there is none or it is not readable.
 * @template T
 * @param {string} key
 * @param {T} otherwise
 * @returns {T}
 */
export function load(key, otherwise) {
  try {
    return JSON.parse(fallback.get(key) ?? localStorage.getItem(PREFIX + key) ?? 'null') ?? otherwise;
  } catch {
    return otherwise;
  }
}

/**
 * Stores a value, or removes the key if the value is `null`. Returns whether it will outlast the page.
 * @param {string} key
 * @param {unknown} value
 * @returns {boolean}
 */
export function save(key, value) {
  const text = JSON.stringify(value);
  try {
    if (value === null) localStorage.removeItem(PREFIX + key);
    else localStorage.setItem(PREFIX + key, text);
    fallback.delete(key);
    return true;
  } catch {
    fallback.set(key, text);
    return false;
  }
}
