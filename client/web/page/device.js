/** What the device offers, for the start of the viewer. */

/**
 * Memory for tiles in MiB. Browsers that do not tell the device's memory get the share of a phone of 2 GiB if they are on
 * one, else the largest.
 * @returns {number}
 */
function cacheMib() {
  const isPhone = matchMedia('(pointer: coarse)').matches;
  const gib = navigator.deviceMemory ?? (isPhone ? 4 : 8);
  if (gib <= 1) return 32;
  if (gib <= 2) return 64;
  return gib <= 4 ? 128 : 256;
}

/**
 * Values of the message `init` that depend on the device.
 * @returns {{cacheMib: number, workers: number, secure: boolean, hasGpu: boolean}}
 */
export function deviceValues() {
  // One core is left to the page and one to the viewer.
  const workers = Math.min(Math.max((navigator.hardwareConcurrency ?? 2) - 2, 1), 4);
  return { cacheMib: cacheMib(), workers, secure: isSecureContext, hasGpu: Boolean(navigator.gpu) };
}

/** Whether the user asked for less motion. @returns {boolean} */
export function wantsLessMotion() {
  return matchMedia('(prefers-reduced-motion: reduce)').matches;
}
