/** Links to the shown view. */

import { announce } from './announcer.js';
import { copyField } from './clipboard.js';
import { element, setText } from './dom.js';
import { strings } from './strings.js';
import { formatView, nativeLink } from './view-text.js';
import { button, field } from './widgets.js';

const texts = strings.share;

/**
 * The panel of the links. `copyLink` copies the page's link.
 * @param {import('./page-context.js').PageContext} page
 * @returns {import('./panels.js').Panel & {copyLink: () => void}}
 */
export function sharePanel(page) {
  const state = element('p', { class: 'hint' });
  const report = (text) => {
    setText(state, text);
    announce(text);
  };
  const copy = async (input) => report((await copyField(input)) ? texts.copied : texts.failed);
  const link = copyRow(texts.link, copy);
  const native = copyRow(texts.nativeLink, copy);
  const send = button({
    icon: 'share',
    text: texts.send,
    // People close the system's dialog, which is reported as an error.
    press: () => navigator.share({ title: page.title, url: link.input.value }).catch(() => {}),
  });
  send.hidden = !('share' in navigator);

  const show = () => {
    const hash = formatView(page.view);
    link.input.value = location.href.replace(/#.*$/, '') + (hash && `#${hash}`);
    const insula = nativeLink(page.city.src, page.view);
    native.input.value = insula ?? '';
    native.node.hidden = insula === null;
  };
  // The links follow the view when it rests; text that is selected must not change all the time.
  page.addEventListener('rest', () => page.panels.current === 'share' && show());
  const opened = () => {
    setText(state, '');
    show();
  };
  const copyLink = () => {
    page.panels.open('share');
    show();
    copy(link.input);
  };
  return { title: texts.title, content: [link.node, native.node, send, state], opened, copyLink };
}

/**
 * A field that is read-only, with a button that copies it.
 * @param {string} text
 * @param {(input: HTMLInputElement) => void} copy
 * @returns {{node: HTMLElement, input: HTMLInputElement}}
 */
export function copyRow(text, copy) {
  const { node, input } = field({ text, readOnly: true });
  input.dir = 'ltr';
  input.addEventListener('focus', () => input.select());
  const label = texts.copyNamed(text);
  const row = element('div', { class: 'search-form' }, node);
  row.append(button({ icon: 'copy', text: texts.copy, label, press: () => copy(input) }));
  return { node: row, input };
}
