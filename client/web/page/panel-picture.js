/** Pictures of the view with a caption, as PNG files. */

import { alarm, announce } from './announcer.js';
import { attributionLines } from './attribution.js';
import { element, printable, setText } from './dom.js';
import { strings } from './strings.js';
import { button, choice } from './widgets.js';

const texts = strings.picture;
/** Sizes in pixels besides that of the window. */
const SIZES = [
  [1920, 1080],
  [3840, 2160],
];
/** Names of files are in use for this long after a download began. */
const REVOKE_MS = 60_000;

/**
 * The panel of pictures.
 * @param {import('./page-context.js').PageContext} page
 * @returns {import('./panels.js').Panel}
 */
export function picturePanel(page) {
  let size = 'window';
  const caption = [page.title, ...attributionLines(page.manifest)];
  const captionList = element('ul', { class: 'caption', dir: 'auto' }, ...caption.map((line) => element('li', {}, line)));
  const state = element('p', { class: 'hint' });
  const sizes = element('div');
  const save = button({ icon: 'picture', text: texts.save, class: 'primary', press: () => draw() });

  const windowSize = () => [page.city.clientWidth, page.city.clientHeight].map((v) => Math.round(v * devicePixelRatio));
  const opened = () => {
    const [width, height] = windowSize();
    const choices = SIZES.map(([w, h]) => [`${w}x${h}`, texts.size2(String(w), String(h))]);
    choices.unshift(['window', texts.window(String(width), String(height))]);
    const change = (value) => (size = value);
    sizes.replaceChildren(choice({ title: texts.size, choices, value: size, change }).node);
    setText(state, '');
  };
  const draw = async () => {
    const chosen = SIZES.find(([w, h]) => `${w}x${h}` === size) ?? windowSize();
    save.disabled = true;
    setText(state, texts.busy);
    announce(texts.busy);
    try {
      const blob = await page.city.screenshot({ width: chosen[0], height: chosen[1], caption });
      download(blob, `${fileName(page.manifest)}.png`);
      setText(state, texts.saved);
      announce(texts.saved);
    } catch (error) {
      setText(state, texts.failed(printable(error.message)));
      alarm(texts.failed(printable(error.message)));
    } finally {
      save.disabled = false;
    }
  };
  const head = element('h3', {}, texts.caption);
  return { title: texts.title, content: [sizes, head, captionList, save, state], opened };
}

function fileName(manifest) {
  const time = new Date().toISOString().slice(0, 19).replaceAll(':', '-');
  return `${printable(manifest.name).replaceAll(/[^a-z0-9_-]/gi, '-')}-${time}`;
}

/**
 * Saves a file of the page.
 * @param {Blob} blob
 * @param {string} name
 */
export function download(blob, name) {
  const href = URL.createObjectURL(blob);
  const link = element('a', { href, download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(href), REVOKE_MS);
}
