/** The panel of analyses: the server computes sun, sky or shadow around the middle of the view, and the result lies on the city as colours. */

import { alarm, announce } from './announcer.js';
import { element, setText } from './dom.js';
import { strings } from './strings.js';
import { button, choice, select } from './widgets.js';

const texts = strings.analyse;
const KINDS = ['sun', 'sky', 'solar', 'shadow'];
const SIDES_M = ['200', '300', '500', '1000'];
const DEFAULT_SIDE_M = '300';
/** Units of shares, which people read in percent. */
const SHARES = ['sky', 'share'];
/** How opaque colours are on the city, as the last digits of a colour. */
const OPACITY = 'b0';
/** Where questions and numbers have no room at once. The first width is that of the style. */
const SMALL = '(max-width: 46rem), (max-height: 52rem)';

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
  const { city, panels } = page;
  // Where the city lies on Earth says where the sun stands.
  const kinds = page.manifest.location ? KINDS : ['sky'];
  const asked = { kind: kinds[0], rule: rules[0], side: DEFAULT_SIDE_M };
  /** The request that runs. @type {AbortController|null} */ let running = null;
  /** The answer on the city, and what takes its colours away. @type {{answer: any, remove: () => void}|null} */ let shown = null;

  const rule = select({ text: texts.rule, change: (value) => (asked.rule = value) });
  rule.fill(rules.map((name) => [name, texts.rules[name] ?? name]));
  const change = (value) => {
    asked.kind = value;
    rule.node.hidden = value !== 'sun';
  };
  change(asked.kind);
  const kind = choice({ title: texts.kind, choices: kinds.map((name) => [name, texts.kinds[name]]), value: asked.kind, change });
  const sides = SIDES_M.map((side) => [side, texts.metres(Number(side))]);
  const side = choice({ title: texts.area, choices: sides, value: asked.side, isRow: true, change: (value) => (asked.side = value) });
  const bar = element('progress', { 'aria-label': texts.busy, hidden: true });
  const state = element('p', { class: 'hint' });
  const result = element('div', { class: 'analysis', role: 'group', 'aria-label': texts.result });
  const run = button({ text: texts.run, class: 'primary', press: () => (running ? running.abort() : compute()) });
  const questions = element('div', { class: 'questions' }, kind.node, rule.node, side.node);
  const unfold = () => {
    fold(false);
    kind.node.querySelector(':checked')?.focus();
  };
  const again = button({ text: texts.kind, press: unfold });
  const buttons = element('div', { class: 'chips' }, again, run);
  /** Leaves out the questions, so that a small screen has room for a result. */
  const fold = (isFolded) => {
    questions.hidden = isFolded;
    again.hidden = !isFolded;
  };
  fold(false);

  /** Says where it stands, and shows that in a panel that scrolls. */
  const tell = (text, say = announce) => {
    setText(state, text);
    state.scrollIntoView({ block: 'nearest' });
    say(text);
  };
  const clear = () => {
    fold(false);
    shown?.remove();
    shown = null;
    result.replaceChildren();
    setText(state, '');
  };
  const showBusy = (isBusy) => {
    bar.hidden = !isBusy;
    run.querySelector('span')?.replaceChildren(isBusy ? texts.cancel : texts.run);
    if (isBusy) tell(texts.busy);
  };
  const compute = async () => {
    const own = (running = new AbortController());
    clear();
    showBusy(true);
    try {
      const answer = await ask(city, await questionOf(page, asked), own.signal);
      const figures = await figuresOn(city).catch(lost);
      own.signal.throwIfAborted();
      showBusy(false);
      shown = { answer, remove: lay(figures, answer) };
      result.replaceChildren(...resultNodes(answer));
      fold(matchMedia(SMALL).matches);
      tell(texts.done);
    } catch ({ message }) {
      showBusy(false);
      tell(own.signal.aborted ? '' : texts.failed(message), alarm);
    } finally {
      running = null;
    }
  };
  city.addEventListener('pick', (event) => {
    if (!shown || panels.current !== 'analyse') return;
    // The panel of the objects would take the place of this one.
    event.preventDefault();
    const { answer } = shown;
    const found = answer.features.find(({ geometry }) => isIn(geometry.coordinates, event.detail.position));
    tell(found ? texts.here(rangeText(found, answer)) : texts.noValue);
  });
  const closed = () => {
    running?.abort();
    clear();
  };
  return { title: texts.title, content: [questions, buttons, bar, state, result], closed };
}

/** What the server is asked. Fails if the middle of the view shows the sky. */
async function questionOf({ city, view }, { kind, rule, side }) {
  const hit = await city.pick(city.clientWidth / 2, city.clientHeight / 2);
  if (!hit) throw new Error(texts.noMiddle);
  const half = Number(side) / 2;
  const [x, y] = hit.position;
  const own = { sun: { rule }, shadow: { time: view.time } };
  return { kind, ...own[kind], bbox_metres: [x - half, y - half, x + half, y + half] };
}

/** Asks the server. What it says of a problem is English, so that the page has its own words for its type or status. */
async function ask({ src }, question, signal) {
  const url = new URL(src, document.baseURI);
  url.pathname = url.pathname.replace(/\/*$/, '/analyse');
  const headers = { 'content-type': 'application/json' };
  const response = await fetch(url, { method: 'POST', headers, body: JSON.stringify(question), signal }).catch(lost);
  if (response.ok) return response.json().catch(lost);
  const { type } = await response.json().catch(() => ({}));
  throw new Error(texts.reasons[type] ?? texts.reasons[response.status] ?? `HTTP ${response.status}`);
}

/** @returns {never} */
function lost() {
  throw new Error(texts.reasons.lost);
}

/** What draws on the city, which is fetched when it is needed first. @type {Promise<any>|null} */
let drawer = null;

function figuresOn(city) {
  drawer ??= import('./draped-figures.js').then(({ DrapedFigures }) => {
    const figures = new DrapedFigures(city, (op, values) => city.ask(op, values));
    city.addEventListener('frame', ({ detail }) => figures.show(detail));
    return figures;
  });
  drawer.catch(() => (drawer = null));
  return drawer;
}

/** Lays the classes on the city. Returns what takes them away. */
function lay(figures, { features }) {
  const shapes = features.map(({ id, properties, geometry }) => {
    return { id, properties, points: [], lines: [], polygons: geometry.coordinates };
  });
  return figures.add(shapes, ({ properties }) => ({ fill: properties.fill + OPACITY, width: 0 })).remove;
}

/** The legend, what is asked for, and the numbers of each kind of place. */
function resultNodes(answer) {
  const { features, unit, asked } = answer;
  const classes = features.toReversed().map((feature) => {
    const swatch = element('span', { class: 'swatch', 'aria-hidden': 'true' });
    swatch.style.backgroundColor = feature.properties.fill;
    return element('li', {}, swatch, rangeText(feature, answer));
  });
  const places = ['ground', 'roofs', 'walls'].flatMap((place) => placeTexts(place, answer));
  return [
    element('h3', {}, texts.units[unit] ?? unit),
    element('ul', { class: 'classes' }, ...classes),
    ...(asked === null ? [] : [element('p', {}, texts.asked(asked))]),
    element('ul', {}, ...places.map((text) => element('li', {}, text))),
  ];
}

/** The values of a kind of place in sentences; none without a value. */
function placeTexts(place, answer) {
  const { count, mean, least, most, share_reaching: reaching } = answer[place];
  if (count === 0) return [];
  const ofSky = answer.unit === 'sky' && place === 'walls';
  const name = ofSky ? texts.wallsOfSky : texts[place];
  const unit = ofSky ? 'percent' : answer.unit;
  const values = [mean, least, most].map((value) => shownValue(value, unit));
  if (unit === 'share') return [texts.shaded(name, values[0])];
  const share = reaching === null ? [] : [texts.reaching(name, shownValue(reaching, 'share'))];
  return [texts.mean(name, ...values), ...share];
}

function rangeText({ properties: { from, to } }, { unit }) {
  if (unit === 'share') return texts.units.share;
  return texts.range(shownValue(from, unit), shownValue(to, unit));
}

function shownValue(value, unit) {
  return Number((SHARES.includes(unit) ? value * 100 : value).toPrecision(3));
}

/** Whether a position is in a polygon: on the inside of an odd number of rings. */
function isIn(polygons, [x, y]) {
  const crosses = ([[ax, ay], [bx, by]]) => ay > y !== by > y && x < ax + ((y - ay) / (by - ay)) * (bx - ax);
  const crossings = polygons.flat().flatMap((ring) => ring.slice(1).filter((end, i) => crosses([ring[i], end])));
  return crossings.length % 2 === 1;
}
