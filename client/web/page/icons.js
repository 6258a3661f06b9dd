/** Icons: strokes on a grid of 24 x 24, drawn with the colour of the text. */

import { svg } from './dom.js';

const CIRCLE = 'M3.5 12a8.5 8.5 0 1 0 17 0a8.5 8.5 0 1 0-17 0';

/** @type {Record<string, string>} */
const PATHS = {
  search: 'M4.5 11a6.5 6.5 0 1 0 13 0a6.5 6.5 0 1 0-13 0M15.8 15.8l4.7 4.7',
  view: 'M12 3.5l8.5 4.5-8.5 4.5L3.5 8zM3.5 12l8.5 4.5 8.5-4.5M3.5 16l8.5 4.5 8.5-4.5',
  objects: 'M4 20.5V9.5l6-4v15M10 8.5l10 3v9M2.5 20.5h19M6.8 12v.1M6.8 16v.1M13.5 13.5v.1M16.7 14.5v.1M13.5 17v.1M16.7 17.6v.1',
  colors:
    'M12 3.5a8.5 8.5 0 1 0 0 17c1.4 0 2-.8 2-1.7 0-1.2-1-1.5-1-2.6 0-.9.8-1.7 1.9-1.7h1.8c2.3 0 3.8-1.6 3.8-3.6 0-4.1-3.9-7.4' +
    '-8.5-7.4zM7.5 12.5v.1M9 8.5v.1M13.5 7.2v.1M17 10v.1',
  time: `${CIRCLE}M12 7v5l3.5 2`,
  measure: 'M3.5 16.5l13-13 4 4-13 13zM6.8 13.2l2 2M10 10l2.6 2.6M13.2 6.8l2 2',
  analyse: 'M8 9.5a4 4 0 1 0 8 0a4 4 0 1 0-8 0M12 1.5v1.5M4 9.5h1.5M18.5 9.5H20M6.3 3.8l1.1 1.1M17.7 3.8l-1.1 1.1M3.5 20.5h17M6 20.5v-3M12 20.5v-4M18 20.5v-2',
  proposals: 'M3.5 20.5h17M5 20.5V11h5.5v9.5M12 3v2M12 7v2M12 11v2M12 15v2M13.5 20.5V5.5H19v15',
  bookmarks: 'M6.5 3.5h11v17L12 16l-5.5 4.5z',
  share: 'M12 15V3.5M8 7.2l4-3.7 4 3.7M8 11H5v9.5h14V11h-3',
  picture: 'M3.5 7.5h4L9 5h6l1.5 2.5h4v12h-17zM8.5 13.2a3.5 3.5 0 1 0 7 0a3.5 3.5 0 1 0-7 0',
  fullScreen: 'M4 9V4h5M20 9V4h-5M4 15v5h5M20 15v5h-5',
  endFullScreen: 'M9 4v5H4M15 4v5h5M9 20v-5H4M15 20v-5h5',
  dark: 'M20 14.5A8.5 8.5 0 1 1 9.5 4 7 7 0 0 0 20 14.5z',
  light:
    'M8 12a4 4 0 1 0 8 0a4 4 0 1 0-8 0M12 2.5V5M12 19v2.5M2.5 12H5M19 12h2.5M5.3 5.3l1.8 1.8M16.9 16.9l1.8 1.8' +
    'M5.3 18.7l1.8-1.8M16.9 7.1l1.8-1.8',
  help: `${CIRCLE}M9.5 9.7a2.5 2.5 0 1 1 3.7 2.2c-.8.5-1.2 1-1.2 1.9M12 16.7v.1`,
  about: `${CIRCLE}M12 11v5.5M12 7.6v.1`,
  more: 'M5.5 12h.01M12 12h.01M18.5 12h.01',
  close: 'M6 6l12 12M18 6L6 18',
  zoomIn: 'M12 5v14M5 12h14',
  zoomOut: 'M5 12h14',
  home: 'M4 11.5l8-7 8 7M6.5 10v9.5h11V10',
  run: 'M8 5.5v13L18.5 12z',
  pause: 'M8.5 6v12M15.5 6v12',
  undo: 'M8.5 5L4 9.5 8.5 14M4 9.5h10a5.25 5.25 0 0 1 0 10.5h-3',
  remove: 'M4.5 7h15M9.5 7V4.5h5V7M6.5 7l1 13h9l1-13',
  copy: 'M9 9h11v11H9zM15 9V4H4v11h5',
  turnLeft: 'M19 12H5M11 6l-6 6 6 6',
  turnRight: 'M5 12h14M13 6l6 6-6 6',
  tiltUp: 'M12 19V5M6 11l6-6 6 6',
  tiltDown: 'M12 5v14M6 13l6 6 6-6',
};

/**
 * An icon without a meaning of its own: its button has a label.
 * @param {string} name
 * @returns {SVGElement}
 */
export function icon(name) {
  const path = svg('path', { d: PATHS[name] });
  return svg('svg', { class: `icon icon-${name}`, viewBox: '0 0 24 24', 'aria-hidden': 'true', focusable: 'false' }, path);
}

/**
 * Replaces the icon of a button.
 * @param {Element} button
 * @param {string} name
 */
export function setIcon(button, name) {
  button.querySelector('.icon')?.replaceWith(icon(name));
}
