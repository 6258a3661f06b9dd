/** What the device offers, for the start of the viewer. */

/**
 * Memory for tiles in MiB. Some browsers, and all on plain http, do not tell the device's memory: then phones count as 4 GiB.
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
  // The viewer waits while its workers draw, so only the page needs a core of its own.
  const cores = navigator.hardwareConcurrency ?? 2;
  const workers = Math.min(cores > 2 ? cores - 1 : cores, 4);
  return { cacheMib: cacheMib(), workers, secure: isSecureContext, hasGpu: Boolean(navigator.gpu) };
}

/** Whether the user asked for less motion. @returns {boolean} */
export function wantsLessMotion() {
  return matchMedia('(prefers-reduced-motion: reduce)').matches;
}
