/** Notices over the view: loading, offline, errors, and why the CPU draws. */

import { alarm, announce } from './announcer.js';
import { element, printable, setText } from './dom.js';
import { follow } from './events.js';
import { load, save } from './storage.js';
import { strings } from './strings.js';
import { button, iconButton } from './widgets.js';

const DISMISSED = 'dismissed-adapter';

/**
 * What draws the picture, and why if that is the CPU. An unknown reason stays as the engine says it.
 * @param {{kind: string, name?: string, why?: string}} adapter
 * @returns {string}
 */
export function adapterText({ kind, name, why }) {
  const texts = strings.adapter;
  if (kind !== 'cpu') return printable(name) || texts.gpu;
  const reason = printable(why);
  if (reason === '') return texts.cpu;
  const lost = /^the device was lost:?\s*(.*)$/.exec(reason);
  return texts.cpuBecause(lost ? texts.lost(lost[1]) : (texts.reasons[reason] ?? reason));
}

/**
 * The status notice.
 * @param {import('./insula-city.js').InsulaCity} city
 * @param {string} title
 * @returns {HTMLElement}
 */
export function statusNotice(city, title) {
  const texts = strings.status;
  const text = element('span', { dir: 'auto' });
  const retry = button({ text: texts.retry, class: 'primary', press: () => city.restart() });
  const node = element('div', { class: 'notice status' }, element('span', { class: 'spinner' }), text, retry);
  const defaults = { loading: texts.loadingCity(title), offline: texts.offline, error: texts.error };
  let last = null;
  const show = ({ kind = null, text: said = '' }) => {
    // A new attempt to reach the server is no news.
    if (kind === 'loading' && last === 'waiting') return;
    const shown = kind === null ? '' : printable(said) || defaults[kind] || '';
    node.hidden = kind === null;
    node.dataset.kind = kind ?? '';
    retry.hidden = kind !== 'error';
    setText(text, shown);
    if (kind === 'error' && last !== 'error') alarm(shown);
    else if ((kind === 'offline' || kind === 'waiting') && last !== kind) announce(shown);
    else if (kind === null && last === 'offline') announce(texts.online);
    last = kind;
  };
  show({ kind: 'loading' });
  follow(city, 'ready', () => {
    if (last === 'loading' || last === 'waiting') show({ kind: null });
    announce(texts.ready(title));
  });
  follow(city, 'status', ({ detail }) => show(detail));
  return node;
}

/**
 * The notice that the CPU draws, until it is dismissed. The reason is remembered, so that another one is shown again.
 * @param {import('./insula-city.js').InsulaCity} city
 * @returns {HTMLElement}
 */
export function adapterNotice(city) {
  let why = '';
  const text = element('span', { dir: 'auto' });
  const dismiss = () => {
    save(DISMISSED, why);
    node.hidden = true;
  };
  const close = iconButton({ icon: 'close', label: strings.adapter.dismiss, press: dismiss });
  const node = element('div', { class: 'notice adapter', hidden: true }, text, close);
  follow(city, 'adapter', ({ detail }) => {
    // The style blurs what lies behind panels only where a graphics adapter does it.
    document.documentElement.dataset.adapter = detail.kind;
    why = printable(detail.why);
    // Without a reason, a graphics adapter may still be found.
    node.hidden = detail.kind !== 'cpu' || why === '' || load(DISMISSED, null) === why;
    setText(text, strings.adapter.notice(adapterText(detail)));
  });
  return node;
}
