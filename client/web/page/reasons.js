/** Why something failed, in the language of the page: the engine says it by a code, and in English for programs. */

import { printable } from './dom.js';
import { strings } from './strings.js';

/**
 * @param {{message: string, fault?: {code: string, at?: number, name?: string|null, why?: string}}} error
 * @returns {string}
 */
export function reasonOf({ message, fault }) {
  const text = strings.faults[fault?.code ?? ''];
  if (typeof text !== 'function') return printable(text ?? message);
  return printable(fault?.name ? text(fault.name) : text(fault?.why, fault?.at));
}
