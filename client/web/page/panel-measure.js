/** Measuring lines, areas and heights by clicks. The engine does the sums. */

import { element, setText } from './dom.js';
import { MEASURES } from './key-table.js';
import { measureText } from './measure-text.js';
import { strings } from './strings.js';
import { button, choice } from './widgets.js';

const texts = strings.measure;

/**
 * The panel of the measuring tool, which is active while the panel is open.
 * @param {import('./page-context.js').PageContext} page
 * @returns {import('./panels.js').Panel & {next: () => void}}
 */
export function measurePanel({ city, panels }) {
  let kind = MEASURES[0];
  const hint = element('p', { class: 'hint' });
  const result = element('output', { class: 'result', 'aria-label': texts.result }, texts.none);
  const select = (chosen) => {
    kind = chosen;
    kinds.set(kind);
    setText(hint, texts.hints[kind]);
    city.measure('kind', kind);
  };
  const kinds = choice({
    title: texts.kind,
    choices: MEASURES.map((key) => [key, texts.kinds[key]]),
    value: kind,
    isRow: true,
    change: select,
  });
  city.addEventListener('frame', ({ detail }) => {
    if (panels.current === 'measure') setText(result, measureText(detail.measure) || texts.none);
  });
  const buttons = element(
    'div',
    { class: 'buttons' },
    button({ icon: 'undo', text: texts.undo, press: () => city.measure('undo') }),
    button({ icon: 'remove', text: texts.clear, press: () => city.measure('clear') }),
    button({ text: texts.done, class: 'primary', press: () => panels.close(true) }),
  );
  const opened = () => {
    city.measure('start', kind);
    select(kind);
  };
  const closed = () => {
    city.measure('stop');
    setText(result, texts.none);
  };
  /** Opens the tool, goes to its next kind, or closes it after the last one. */
  const next = () => {
    const following = MEASURES[MEASURES.indexOf(kind) + 1];
    if (panels.current !== 'measure') {
      kind = MEASURES[0];
      panels.open('measure');
    } else if (following) select(following);
    else panels.close(true);
  };
  return { title: texts.title, content: [kinds.node, hint, result, buttons], opened, closed, next };
}
