/** The panel of colours and filters, and the legend over the view. */

import { announce } from './announcer.js';
import { AttributeLabels, legendTitle } from './attribute-labels.js';
import { element, printable, setText } from './dom.js';
import { follow } from './events.js';
import { reasonOf } from './reasons.js';
import { strings } from './strings.js';
import { button, checkbox, choice, field, select, slider } from './widgets.js';

const texts = strings.colors;
const MS_PER_DAY = 86_400_000;
/** Steps of the slider between the smallest and the largest value. */
const STEPS = 200;

/** What the user wants to see: the rules of `setColors`. */
const NOTHING = { attribute: '', palette: '', range: null, filter: '', others: 'ghost', upTo: null };

/** Applies rules one after the other; of those that wait, only the last. */
class Coloring {
  #city;
  #report;
  /** @type {object|null} */ #next = null;
  #isBusy = false;

  constructor(city, report) {
    [this.#city, this.#report] = [city, report];
  }

  /** Whether no newer rules wait. */
  get isIdle() {
    return this.#next === null;
  }

  async apply(rules) {
    this.#next = rules;
    if (this.#isBusy) return;
    this.#isBusy = true;
    while (this.#next) {
      const current = this.#next;
      this.#next = null;
      try {
        await this.#city.setColors(current);
      } catch (error) {
        this.#report(error);
      }
    }
    this.#isBusy = false;
  }
}

/**
 * The panel of the colours.
 * @param {import('./page-context.js').PageContext} page
 * @returns {import('./panels.js').Panel}
 */
export function colorsPanel({ city }) {
  let rules = { ...NOTHING };
  /** Ends of the attribute's values. @type {[number, number]|null} */
  let full = null;
  /** @type {any} */ let schema = null;
  const error = element('p', { class: 'error', role: 'alert' });
  const summary = element('p', { class: 'hint', role: 'status' });
  const fail = (why) => setText(error, texts.failed(reasonOf(why)));
  const coloring = new Coloring(city, fail);
  const change = (values) => {
    rules = { ...rules, ...values };
    setText(error, '');
    coloring.apply(rules);
  };
  const isDate = () => schema?.attributes.find(({ name }) => name === rules.attribute)?.type === 'date';
  const shown = (value) => valueText(value, isDate());

  const ends = element('div', { class: 'range-ends' });
  const limits = element('div', { class: 'limits' });
  const showRange = () => {
    const parts = full ? rangeControls({ full, rules, shown, change }) : { ends: [], limits: [] };
    ends.replaceChildren(...parts.ends);
    limits.replaceChildren(...parts.limits);
    ends.hidden = limits.hidden = !full;
  };
  const attribute = select({
    text: texts.attribute,
    change: (value) => {
      full = null;
      change({ attribute: value, range: null, upTo: null });
    },
  });
  const palette = select({ text: texts.palette, change: (value) => change({ palette: value }) });
  const filter = field({ text: texts.filter, placeholder: texts.example, hint: texts.filterHint });
  filter.input.addEventListener('change', () => change({ filter: filter.input.value.trim() }));
  const others = choice({
    title: texts.others,
    choices: [['ghost', texts.ghost], ['hide', texts.hide]],
    value: rules.others,
    isRow: true,
    change: (value) => change({ others: value }),
  });
  const reset = button({ text: texts.reset, press: () => change({ ...NOTHING }) });
  const showRules = () => {
    attribute.set(rules.attribute);
    palette.set(rules.palette);
    palette.node.hidden = rules.attribute === '';
    others.set(rules.others);
    if (document.activeElement !== filter.input) filter.input.value = rules.filter;
  };

  follow(city, 'colors', ({ detail }) => {
    if (!coloring.isIdle) return;
    // Rules may come from elsewhere, too.
    const drawn = { ...NOTHING, ...detail.rules };
    if (drawn.attribute !== rules.attribute) full = null;
    rules = drawn;
    const range = detail.legend?.ramp?.range;
    if (!range) full = null;
    else if (!full && !rules.range) full = [...range].sort((a, b) => a - b);
    if (!isDragging()) showRange();
    showRules();
    setText(summary, rules.filter || rules.upTo !== null ? texts.passing(detail.passing) : '');
    if (summary.textContent) announce(summary.textContent);
  });
  // The control that the user holds is not replaced.
  const isDragging = () => ends.contains(document.activeElement) || limits.contains(document.activeElement);
  const opened = async () => {
    if (schema) return;
    try {
      schema = await city.schema();
    } catch (why) {
      fail(why);
      return;
    }
    const labels = new AttributeLabels(schema);
    const names = schema.colorBy.filter((name) => labels.isShown(name));
    attribute.fill([['', texts.own], ...names.map((name) => [name, printable(labels.title(name))])]);
    palette.fill([['', texts.defaultPalette], ...schema.palettes.map((name) => [name, name])]);
    showRules();
  };
  palette.node.hidden = true;
  showRange();
  const content = [attribute.node, palette.node, ends, limits, filter.node, others.node, summary, error, reset];
  return { title: texts.title, content, opened };
}

/** Fields of the ends of the palette, and the slider of the largest shown value. */
function rangeControls({ full: [low, high], rules, shown, change }) {
  const range = rules.range ?? [low, high];
  const end = (index, text) => {
    const { node, input } = field({ text, type: 'number', value: String(range[index]) });
    input.step = 'any';
    input.addEventListener('change', () => {
      if (!Number.isFinite(input.valueAsNumber)) return;
      range[index] = input.valueAsNumber;
      change({ range: [...range] });
    });
    return node;
  };
  const step = high - low > STEPS / 4 ? 1 : (high - low) / STEPS || 1;
  const limit = slider({
    text: texts.upTo,
    min: low,
    max: high,
    step,
    value: rules.upTo ?? high,
    format: shown,
    input: (value) => change({ upTo: value }),
  });
  limit.node.hidden = rules.upTo === null;
  const isLimited = checkbox({
    text: texts.limit,
    checked: rules.upTo !== null,
    change: (on) => {
      limit.node.hidden = !on;
      limit.set(high);
      change({ upTo: on ? high : null });
    },
  });
  return { ends: [end(0, texts.from), end(1, texts.to)], limits: [isLimited.node, limit.node] };
}

/** A value of an attribute. Dates are days since 1970. */
function valueText(value, isDate) {
  if (isDate) return new Date(value * MS_PER_DAY).toISOString().slice(0, 10);
  return String(Number(value.toPrecision(6)));
}

/**
 * The legend over the view, hidden without colours.
 * @param {import('./insula-city.js').InsulaCity} city
 * @returns {HTMLElement}
 */
export function legendBox(city) {
  const node = element('div', { class: 'legend', role: 'group', 'aria-label': texts.legend, hidden: true });
  follow(city, 'colors', ({ detail: { legend } }) => {
    node.hidden = !legend;
    node.replaceChildren(...(legend ? legendNodes(legend) : []));
  });
  return node;
}

function legendNodes(legend) {
  const { ramp, entries } = legend;
  const heading = element('p', { class: 'legend-title', dir: 'auto' }, printable(legendTitle(legend)));
  const bar = element('div', { class: 'ramp', 'aria-hidden': 'true' });
  if (ramp) bar.style.backgroundImage = `linear-gradient(to right, ${ramp.stops.map(css).join(', ')})`;
  bar.hidden = !ramp;
  // The engine's own words are the last ones; values of the city stay as they are.
  const own = { 'no data': texts.noData, others: texts.otherValues };
  const { kinds } = strings.objects;
  const isOfKinds = legend.title === 'kind' && entries.every(({ label }) => label in own || Object.hasOwn(kinds, label));
  const rows = entries.map(({ rgb, label }, i) => {
    const swatch = element('span', { class: 'swatch', 'aria-hidden': 'true' });
    swatch.style.backgroundColor = css(rgb);
    const text = (i >= entries.length - 2 && own[label]) || (isOfKinds && kinds[label]) || printable(label);
    return element('li', { dir: 'auto' }, swatch, text);
  });
  return [heading, bar, element('ul', {}, ...rows)];
}

function css([r, g, b]) {
  return `rgb(${Number(r)} ${Number(g)} ${Number(b)})`;
}
