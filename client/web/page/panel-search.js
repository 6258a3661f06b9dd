/** The search: coordinates in the city's system, and bookmarks by name. Nothing is sent anywhere. */

import { announce } from './announcer.js';
import { element, setText } from './dom.js';
import { parseCoordinates } from './place-search.js';
import { strings } from './strings.js';
import { button, field } from './widgets.js';

const texts = strings.search;
const MAX_RESULTS = 20;

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
  input.addEventListener('input', showResults);
  form.addEventListener('submit', (event) => {
    event.preventDefault();
    const [bookmark] = page.bookmarks.find(input.value);
    const place = parseCoordinates(input.value, page.manifest);
    if ('position' in place) {
      page.city.flyTo(place.position);
      announce(texts.moved(input.value));
    } else if (bookmark) open(bookmark);
    setText(error, 'position' in place || bookmark ? '' : place.error);
  });
  showResults();
  return { title: texts.title, content: [form, error, results], opened: () => input.select(), focus: input };
}
