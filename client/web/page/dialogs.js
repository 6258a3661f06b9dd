/** The dialogs: about this city and its sources, and help. */

import { attributionNodes } from './attribution.js';
import { element, printable, setText } from './dom.js';
import { follow } from './events.js';
import { adapterText } from './notices.js';
import { dialog } from './panels.js';
import { strings } from './strings.js';
import { bytesText } from './units.js';
import { checkbox } from './widgets.js';

/**
 * The dialog about a city. The server's description, which pages without scripts show, moves into it.
 * @param {import('./page-context.js').PageContext} page
 * @param {HTMLElement|null} description
 * @returns {HTMLDialogElement}
 */
export function aboutDialog(page, description) {
  const texts = strings.about;
  const drawnBy = element('dd', { dir: 'auto' });
  const transferred = element('dd');
  follow(page.city, 'adapter', ({ detail }) => setText(drawnBy, adapterText(detail)));
  follow(page.city, 'progress', ({ detail }) => setText(transferred, bytesText(detail.bytes ?? 0)));
  const rows = [
    [texts.drawnBy, drawnBy],
    [texts.transferred, transferred],
  ];
  const list = element('dl', {}, ...rows.flatMap(([name, value]) => [element('dt', {}, name), value]));
  if (description) {
    description.remove();
    description.hidden = false;
  }
  const generated = page.manifest.generated_facades ? element('p', { class: 'hint' }, texts.generated) : null;
  // The server describes the city in English.
  const isTranslated = !strings.language.startsWith('en');
  const about = description && !isTranslated ? description : ownDescription(page, description?.querySelector('a[rel="up"]'));
  const nodes = [about, list, generated, element('p', { class: 'hint' }, texts.software)];
  return dialog(texts.title, ...nodes.filter((node) => node !== null));
}

/** A description from the manifest, for pages without one. `up` is the link to the list of cities. */
function ownDescription({ title, system, manifest }, up) {
  const texts = strings.about;
  const [low, high] = manifest.bounds;
  const rows = [
    [texts.extent, texts.metres(Math.round(high[0] - low[0]), Math.round(high[1] - low[1]))],
    [texts.system, system],
    [texts.version, printable(manifest.version)],
  ];
  const terms = rows.flatMap(([name, value]) => [element('dt', {}, name), element('dd', { dir: 'auto' }, value)]);
  const sources = element('dd', {}, ...attributionNodes(manifest));
  const list = element('dl', {}, ...terms, element('dt', {}, texts.sources), sources);
  if (up) up.textContent = texts.allCities;
  return element('section', {}, element('h3', { dir: 'auto' }, title), list, up ? element('p', {}, up) : null);
}

/**
 * The dialog with the keys.
 * @param {{singleKeys: boolean, change: (singleKeys: boolean) => void}} values
 * @returns {HTMLDialogElement}
 */
export function helpDialog({ singleKeys, change }) {
  const texts = strings.help;
  const cell = (kind, text) => element(kind, kind === 'th' ? { scope: 'row' } : {}, text);
  const rowsOf = (table) => table.map(([keys, action]) => element('tr', {}, cell('th', keys), cell('td', action)));
  const heads = [texts.key, texts.action].map((text) => element('th', { scope: 'col' }, text));
  const head = element('thead', { class: 'visually-hidden' }, element('tr', {}, ...heads));
  const table = element('table', {}, element('caption', { class: 'visually-hidden' }, texts.keys), head);
  table.append(element('tbody', {}, ...rowsOf(texts.table)));
  const developer = element('details', {}, element('summary', {}, strings.view.developer));
  developer.append(element('table', {}, element('tbody', {}, ...rowsOf(texts.developer))));
  const single = checkbox({ text: texts.singleKeys, checked: singleKeys, change });
  return dialog(texts.title, table, single.node, element('p', { class: 'hint' }, texts.singleKeysHint), developer);
}
