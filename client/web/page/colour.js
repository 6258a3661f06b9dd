/** Colours of CSS as numbers. */

/** @type {any} */
let context = null;
/** Many objects in a row have the same colour. */
let last = { color: '', number: 0 };

/**
 * A colour of CSS as 0xRRGGBB. Fails if it is none.
 * @param {string} color
 * @returns {number}
 */
export function cssColour(color) {
  if (color === last.color && color !== '') return last.number;
  if (!CSS.supports('color', color)) throw new RangeError(`${color} is not a colour of CSS`);
  context ??= new OffscreenCanvas(1, 1).getContext('2d', { willReadFrequently: true });
  context.clearRect(0, 0, 1, 1);
  context.fillStyle = color;
  context.fillRect(0, 0, 1, 1);
  const [r, g, b] = context.getImageData(0, 0, 1, 1).data;
  last = { color, number: (r << 16) | (g << 8) | b };
  return last.number;
}
