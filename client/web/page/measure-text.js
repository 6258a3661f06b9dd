/** What was measured, in words. */

import { strings } from './strings.js';

/**
 * A sentence about the figures of the engine; empty before there is a result.
 * @param {{kind: string, figures: string[]}|null|undefined} measure
 * @returns {string}
 */
export function measureText(measure) {
  if (!measure) return '';
  const { kind, figures } = measure;
  const point = (0.5).toLocaleString(strings.language)[1];
  // How many figures there are tells which ones.
  return strings.measured[kind + figures.length]?.(...figures.map((figure) => figure.replace('.', point))) ?? '';
}
