/** The panel of analyses. What asks the server and shows results is fetched when the panel is opened first, or when a link names a result. */

import { alarm, announce } from './announcer.js';
import { copyField } from './clipboard.js';
import { element, setText } from './dom.js';
import { download } from './panel-picture.js';
import { copyRow } from './panel-share.js';
import { strings } from './strings.js';
import { formatView } from './view-text.js';
import { button, choice, select } from './widgets.js';

const texts = strings.analyse;

/** Names of the rules by which the server computes hours of sun; empty if it makes no analyses. @returns {string[]} */
export function offeredRules() {
  const list = document.querySelector('meta[name="insula-analyses"]')?.getAttribute('content') ?? '';
  return list.split(' ').filter((name) => name !== '');
}

/**
 * The panel of the analyses.
 * @param {import('./page-context.js').PageContext} page
 * @param {string[]} rules
 * @returns {import('./panels.js').Panel}
 */
export function analysePanel(page, rules) {
  // Gives way to the controls.
  const content = element('p', { class: 'hint' });
  /** @type {Promise<any>|null} */ let view = null;
  const open = () => {
    // The other file is joined with modules of its own: what has a state is of this one.
    const tools = { texts, links: strings.share, alarm, announce, button, choice, select, copyField, copyRow, download, formatView };
    view ??= import('./analysis-view.js').then(({ openAnalyses }) => openAnalyses(page, rules, tools, content));
    view.catch(() => {
      view = null;
      setText(content, texts.failed(texts.reasons.lost));
    });
    return view;
  };
  const follow = () => {
    const asked = new URLSearchParams(location.hash.slice(1).replaceAll('+', '%2B')).get('analyse');
    if (asked === null) return;
    // When the panels are in the page.
    queueMicrotask(() => {
      page.panels.open('analyse', false);
      open().then((shown) => shown.follow(asked), () => {});
    });
  };
  follow();
  addEventListener('hashchange', follow);
  const closed = () => {
    view?.then((shown) => shown.closed(), () => {});
  };
  return { title: texts.title, content: [content], opened: open, closed };
}
