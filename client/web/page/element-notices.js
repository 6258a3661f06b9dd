/** Notices of the element itself, for pages without controls of their own: what is wrong, and who must be named. */

import { attributionNodes } from './attribution.js';
import { element, printable, setText } from './dom.js';
import { strings } from './strings.js';

/** The hint about gestures stays this long. */
const GESTURE_MS = 1500;

/** The status line and the attribution in the shadow root. A page hides them through their parts. */
export class ElementNotices {
  #status = element('div', { class: 'status', part: 'status', role: 'status', hidden: true });
  #attribution = element('div', { class: 'attribution', part: 'attribution', hidden: true });
  #gesture = element('div', { class: 'gesture', part: 'gesture', 'aria-hidden': 'true', hidden: true });
  #gestureTimer = 0;
  /** Parts for the shadow root. */
  nodes = [this.#status, this.#attribution, this.#gesture];

  /**
   * Shows a status, or hides it without a kind.
   * @param {{kind: string|null, text?: string}} status
   */
  showStatus({ kind, text }) {
    this.#status.hidden = kind === null;
    this.#status.dataset.kind = kind ?? '';
    setText(this.#status, kind === null ? '' : printable(text) || strings.status[kind] || '');
  }

  /**
   * Says for a moment how to use a gesture that the page got.
   * @param {'wheel'|'fingers'} what
   */
  showGesture(what) {
    setText(this.#gesture, strings.element[what]);
    this.#gesture.hidden = false;
    clearTimeout(this.#gestureTimer);
    this.#gestureTimer = setTimeout(() => (this.#gesture.hidden = true), GESTURE_MS);
  }

  /**
   * Names the sources of a city.
   * @param {object|null} manifest
   */
  showAttribution(manifest) {
    const nodes = attributionNodes(manifest);
    this.#attribution.hidden = nodes.length === 0;
    this.#attribution.replaceChildren(...nodes);
  }
}
