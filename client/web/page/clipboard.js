/** The clipboard. Its interface exists only on https and localhost; servers in a local network are often plain http. */

/**
 * Copies the text of a field. If that is refused, the text stays selected.
 * @param {HTMLInputElement} input
 * @returns {Promise<boolean>} Whether it was copied.
 */
export async function copyField(input) {
  try {
    await navigator.clipboard.writeText(input.value);
    return true;
  } catch {
    input.focus();
    input.select();
    return document.execCommand('copy');
  }
}

/**
 * Copies a text.
 * @param {string} text
 * @returns {Promise<boolean>} Whether it was copied.
 */
export async function copyText(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    return false;
  }
}
