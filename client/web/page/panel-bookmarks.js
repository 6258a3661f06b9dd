/** Views that the user saves in this browser. */

import { announce } from './announcer.js';
import { element } from './dom.js';
import { strings } from './strings.js';
import { button, field, iconButton } from './widgets.js';

const texts = strings.bookmarks;

/**
 * The panel of the bookmarks. `add` saves the shown view under the next default name.
 * @param {import('./page-context.js').PageContext} page
 * @returns {import('./panels.js').Panel & {add: () => void}}
 */
export function bookmarksPanel(page) {
  const { bookmarks } = page;
  const { node, input } = field({ text: texts.name });
  const list = element('ul', { class: 'results', 'aria-label': texts.list });
  const empty = element('p', { class: 'hint' }, texts.empty);
  const defaultName = () => texts.defaultName(bookmarks.list.length + 1);

  const show = () => {
    input.placeholder = defaultName();
    list.replaceChildren(...bookmarks.list.map(row));
    list.hidden = bookmarks.list.length === 0;
    empty.hidden = !list.hidden;
  };
  const row = (bookmark) => {
    const { name } = bookmark;
    const open = button({ text: name, class: 'row', label: texts.open(name), press: () => page.open(bookmark) });
    const remove = () => {
      bookmarks.remove(bookmark);
      show();
      announce(texts.removed(name));
      input.focus({ preventScroll: true });
    };
    return element('li', { dir: 'auto' }, open, iconButton({ icon: 'remove', label: texts.remove(name), press: remove }));
  };
  const add = () => {
    const { camera, time } = page.view;
    if (!camera) return;
    const name = input.value.trim() || defaultName();
    const lasts = bookmarks.add({ name, camera, time });
    input.value = '';
    show();
    announce(lasts ? texts.added(name) : `${texts.added(name)}. ${texts.temporary}`);
  };
  const submit = element('button', { type: 'submit', class: 'primary' }, texts.add);
  const form = element('form', { class: 'search-form' }, node, submit);
  form.addEventListener('submit', (event) => {
    event.preventDefault();
    add();
  });
  show();
  return { title: texts.title, content: [form, list, empty], opened: show, add };
}
