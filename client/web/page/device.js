/** What the device offers, for the start of the viewer. */

/**
 * Values of the message `init` that depend on the device.
 * @returns {{secure: boolean, hasGpu: boolean}}
 */
export function deviceValues() {
  return { secure: isSecureContext, hasGpu: Boolean(navigator.gpu) };
}

/** Whether the user asked for less motion. @returns {boolean} */
export function wantsLessMotion() {
  return matchMedia('(prefers-reduced-motion: reduce)').matches;
}
