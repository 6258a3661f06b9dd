/** The panel of the selected objects: what is known of them. It opens with the first selected object. */

import { announce } from './announcer.js';
import { AttributeLabels } from './attribute-labels.js';
import { copyText } from './clipboard.js';
import { element, printable, setText, webAddress } from './dom.js';
import { reasonOf } from './reasons.js';
import { strings } from './strings.js';
import { button, field } from './widgets.js';

const texts = strings.objects;
/** Most objects whose attributes are shown. */
const MAX_SHOWN = 32;

/**
 * The panel of the objects.
 * @param {import('./page-context.js').PageContext} page
 * @returns {import('./panels.js').Panel}
 */
export function objectsPanel(page) {
  const { city, panels } = page;
  const { node: find, input } = field({ text: texts.find, type: 'search' });
  const summary = element('p', { role: 'status' });
  const list = element('div', { class: 'objects' });
  const error = element('p', { class: 'error', role: 'alert' });
  const copy = async () => {
    const copied = await copyText(JSON.stringify(city.selection, null, 2));
    announce(copied ? texts.copied : texts.copyFailed);
  };
  const clear = () => {
    city.select([]);
    panels.close(true);
  };
  const buttons = element('div', { class: 'buttons' });
  buttons.append(button({ text: texts.copy, icon: 'copy', press: copy }), button({ text: texts.clear, press: clear }));

  let labels = new AttributeLabels(null);
  /** @type {Promise<void>|null} */ let fetched = null;
  // Without labels, attributes have the names of the source.
  const fetchLabels = () => city.schema().then((schema) => {
    labels = new AttributeLabels(schema);
    show();
  }, () => (fetched = null));

  const show = () => {
    const objects = city.selection;
    const needle = input.value.trim().toLowerCase();
    setText(summary, objects.length === 0 ? texts.none : texts.count(objects.length));
    list.replaceChildren(...objects.slice(0, MAX_SHOWN).map((object) => card(city, object, needle, labels)));
    [find, buttons].forEach((node) => (node.hidden = objects.length === 0));
  };
  input.addEventListener('input', show);
  city.addEventListener('pick', ({ detail: { error: message, fault } }) => setText(error, message && texts.failed(reasonOf({ message, fault }))));
  city.addEventListener('selection', ({ detail }) => {
    show();
    if (detail.objects.length === 0) return;
    fetched ??= fetchLabels();
    const last = detail.objects.at(-1);
    announce(texts.selected(printable(last.identifier)));
    panels.open('objects', false);
  });
  show();
  return { title: texts.title, content: [summary, find, list, error, buttons] };
}

/** One object. Only attributes whose title, name or value contains `needle` are shown. */
function card(city, object, needle, labels) {
  const { identifier, kind, id, parent, attributes, centre } = object;
  const name = printable(identifier) || texts.unnamed(String(id));
  const visit = () => city.flyTo(centre).catch(() => {});
  const go = centre ? button({ text: texts.goTo, label: texts.goToNamed(name), press: visit }) : null;
  const head = element('div', { class: 'object-head' }, element('h3', { dir: 'auto' }, name), go);
  const word = texts.kinds[kind] ?? kind;
  const ofCity = parent === null ? texts.kind(word, String(id)) : texts.partOf(word, String(id), printable(parent));
  // What a proposal adds has a number that nobody else knows.
  const what = kind === 'proposal' ? word : ofCity;
  const rows = Object.entries(attributes)
    .filter(([key]) => labels.isShown(key))
    .map(([key, value]) => [labels.title(key), labels.text(key, value), key].map(printable))
    .filter((row) => row.some((text) => text.toLowerCase().includes(needle)))
    .flatMap(([title, value, key]) => [
      element('dt', { dir: 'auto', title: key }, title),
      element('dd', { dir: 'auto' }, valueNode(value)),
    ]);
  return element('section', {}, head, element('p', { class: 'hint' }, what), element('dl', {}, ...rows));
}

function valueNode(text) {
  const address = webAddress(text);
  if (!address) return document.createTextNode(text);
  return element('a', { href: address, target: '_blank', rel: 'noopener noreferrer' }, text);
}
