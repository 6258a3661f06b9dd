/** The panel of proposals. What shows them in the city is fetched when the panel is opened first, or when the link names one. */

import { alarm, announce } from './announcer.js';
import { element, setText } from './dom.js';
import { reasonOf } from './reasons.js';
import { strings } from './strings.js';
import { checkbox, choice } from './widgets.js';

const texts = strings.proposals;

/** Whether there are proposals for the city. */
export function hasProposals() {
  return document.querySelector('meta[name="insula-proposals"]') !== null;
}

/**
 * The panel of the proposals. `toggle` shows the city before or after.
 * @param {import('./page-context.js').PageContext} page
 * @returns {import('./panels.js').Panel & {toggle: () => void}}
 */
export function proposalsPanel(page) {
  const content = element('div');
  const state = element('p', { class: 'hint' });
  const say = (text) => {
    setText(state, text);
    announce(text);
  };
  const fail = (error) => {
    setText(state, texts.failed(reasonOf(error)));
    alarm(state.textContent ?? '');
  };
  /** @type {Promise<any>|null} */ let view = null;
  const open = () => {
    // The other file is joined with modules of its own: what has a state is of this one.
    const tools = { texts, checkbox, choice, say, fail };
    view ??= import('./proposal-view.js').then(({ openProposals }) => openProposals(page, tools, content));
    view.catch((error) => {
      view = null;
      fail(error);
    });
    return view;
  };
  const toggle = () => open().then((shown) => shown?.toggle(), () => {});
  if (new URLSearchParams(location.search).has('proposal')) open();
  return { title: texts.title, content: [content, state], opened: open, toggle };
}
