/** The versions of a city in time: a slider that opens the page of another one at the same view. */

import { strings } from './strings.js';
import { formatView } from './view-text.js';
import { slider } from './widgets.js';

const texts = strings.time;
/** A version opens when the slider has rested for this time. */
const REST_MS = 500;
/** In the location's hash of a page that the slider has opened. The slider is at hand there. */
const MARK = 'versions';

/** Days and addresses of the versions, the earliest first, as the page lists them. @returns {[string, string][]} */
function listedVersions() {
  const text = document.querySelector('meta[name="insula-versions"]')?.getAttribute('content') ?? '';
  const words = text.split(' ').filter(Boolean);
  return Array.from({ length: words.length >> 1 }, (_, i) => [words[2 * i], words[2 * i + 1]]);
}

/** A day as people write it. @param {string} date */
function dayText(date) {
  return new Intl.DateTimeFormat(strings.language, { dateStyle: 'long', timeZone: 'UTC' }).format(new Date(date));
}

/**
 * The slider; `null` if the city has no other version.
 * @param {import('./page-context.js').PageContext} page
 * @returns {HTMLElement|null}
 */
export function versionSlider(page) {
  const versions = listedVersions();
  const shown = versions.findIndex(([date]) => date === page.manifest.release?.date);
  if (versions.length < 2 || shown < 0) return null;
  const open = (index) => {
    const url = new URL(versions[index][1], document.baseURI);
    url.hash = [formatView(page.view), MARK].filter(Boolean).join('&');
    location.replace(url);
  };
  let timer = 0;
  const { node } = slider({
    text: texts.version,
    min: 0,
    max: versions.length - 1,
    step: 1,
    value: shown,
    format: (index) => dayText(versions[index][0]),
    input: (index) => {
      clearTimeout(timer);
      if (index !== shown) timer = setTimeout(() => open(index), REST_MS);
    },
  });
  if (new URLSearchParams(location.hash.slice(1)).has(MARK)) {
    // When the panels are in the page.
    queueMicrotask(() => {
      page.panels.open('time', false);
      node.querySelector('input')?.focus({ preventScroll: true });
    });
  }
  return node;
}
