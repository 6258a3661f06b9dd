/** The search: objects of the city by their texts, coordinates in the city's system, and bookmarks by name. */

import { announce } from './announcer.js';
import { element, printable, setText } from './dom.js';
import { parseCoordinates } from './place-search.js';
import { reasonOf } from './reasons.js';
import { strings } from './strings.js';
import { button, field } from './widgets.js';

const texts = strings.search;
const MAX_RESULTS = 20;
/** Objects are searched when nothing was typed for this time. */
const PAUSE_MS = 200;

/**
 * The panel of the search.
 * @param {import('./page-context.js').PageContext} page
 * @returns {import('./panels.js').Panel}
 */
export function searchPanel(page) {
  const [low, high] = page.manifest.bounds;
  const middle = [0, 1].map((i) => ((low[i] + high[i]) / 2).toFixed(0));
  const placeholder = texts.example(middle[0], middle[1]);
  const hint = texts.hint(page.system);
  const { node, input } = field({ text: texts.label, type: 'search', placeholder, hint });
  const error = element('p', { class: 'error', role: 'alert' });
  const results = element('ul', { class: 'results', 'aria-label': texts.results });
  const objects = element('ul', { class: 'results', 'aria-label': texts.objects, hidden: true });
  const submit = element('button', { type: 'submit', class: 'primary' }, texts.go);
  const form = element('form', { class: 'search-form', role: 'search' }, node, submit);

  const open = (bookmark) => {
    page.open(bookmark);
    announce(texts.moved(bookmark.name));
  };
  const showResults = () => {
    const found = page.bookmarks.find(input.value).slice(0, MAX_RESULTS);
    const row = (bookmark) => {
      const go = button({ text: bookmark.name, class: 'row', label: texts.goTo(bookmark.name), press: () => open(bookmark) });
      return element('li', { dir: 'auto' }, go);
    };
    results.replaceChildren(...found.map(row));
    results.hidden = found.length === 0;
    setText(error, '');
    if (found.length > 0) announce(texts.found(found.length));
  };
  const search = objectSearch(page, objects, (why) => setText(error, why));
  input.addEventListener('input', () => {
    showResults();
    search.later(input.value);
  });
  form.addEventListener('submit', async (event) => {
    event.preventDefault();
    const [bookmark] = page.bookmarks.find(input.value);
    const found = parseCoordinates(input.value, page.manifest);
    if ('place' in found) {
      page.city.flyTo(found.place);
      announce(texts.moved(input.value));
    } else if (bookmark) open(bookmark);
    else if (!(await search.visitFirst(input.value))) setText(error, error.textContent || found.error);
  });
  showResults();
  return { title: texts.title, content: [form, error, results, objects], opened: () => input.select(), focus: input };
}

/** Searches objects while the user types, and lists them. */
function objectSearch({ city }, list, report) {
  let [timer, turn] = [0, 0];
  const fail = (why) => report(texts.failed(reasonOf(why)));
  const visit = async ({ object, text }) => {
    const [found] = await city.select([object]);
    if (!found?.centre) return;
    await city.flyTo(found.centre);
    announce(texts.moved(printable(text)));
  };
  const row = (hit) => {
    const text = printable(hit.text);
    const press = () => visit(hit).catch(fail);
    const go = button({ text, class: 'row', label: texts.goTo(text), press });
    return element('li', { dir: 'auto' }, go, hit.typos > 0 ? element('span', { class: 'hint' }, texts.typos) : null);
  };
  /** The hits of a text; `null` if another text was searched meanwhile or the search failed. */
  const search = async (text) => {
    const own = ++turn;
    try {
      const hits = text.trim() === '' ? [] : ((await city.search(text.trim(), { limit: MAX_RESULTS })) ?? []);
      if (own !== turn) return null;
      list.replaceChildren(...hits.map(row));
      list.hidden = hits.length === 0;
      if (hits.length > 0) announce(texts.found(hits.length));
      return hits;
    } catch (why) {
      if (own === turn) fail(why);
      return null;
    }
  };
  const later = (text) => {
    clearTimeout(timer);
    timer = setTimeout(() => search(text), PAUSE_MS);
  };
  /** Goes to the best hit. Returns whether there is one. */
  const visitFirst = async (text) => {
    clearTimeout(timer);
    const [first] = (await search(text)) ?? [];
    if (first) await visit(first).catch(fail);
    return first !== undefined;
  };
  return { later, visitFirst };
}
