/**
 * Analyses of what is in view: the server computes sun, sky or shadow of a square, and the result lies on the city as colours, with a link,
 * a sheet of paper, and what a place sees of the sky. Pages fetch this module when the panel "Analyse" is opened first.
 */

import { element, setText } from './dom.js';

const KINDS = ['sun', 'sky', 'solar', 'shadow'];
const SIDES_M = ['200', '300', '500', '1000'];
const DEFAULT_SIDE_M = '300';
/** Units of shares, which people read in percent. */
const SHARES = ['sky', 'share'];
/** How opaque colours are on the city, as the last digits of a colour. */
const OPACITY = 'b0';
/** Where questions and numbers have no room at once. The first width is that of the style. */
const SMALL = '(max-width: 46rem), (max-height: 52rem)';
/** A coordinate in a link. */
const NUMBER = /^-?\d+(\.\d+)?$/;

/**
 * @typedef {{texts: any, links: any, alarm: Function, announce: Function, button: Function, choice: Function, select: Function,
 *   copyField: Function, copyRow: Function, download: Function, formatView: Function}} Tools
 * @typedef {{kind: string, rule?: string, time?: string, bbox_metres: number[]}} Question
 */

/**
 * Puts the controls of analyses in the place of a node. Returns what follows links and ends results.
 * @param {import('./page-context.js').PageContext} page
 * @param {string[]} rules
 * @param {Tools} tools
 * @param {HTMLElement} place
 * @returns {AnalysisView}
 */
export function openAnalyses(page, rules, tools, place) {
  const view = new AnalysisView(page, rules, tools);
  place.replaceWith(...view.nodes);
  return view;
}

/** The controls, and the result that is shown. */
class AnalysisView {
  /** @type {HTMLElement[]} */ nodes;
  #page;
  #city;
  #rules;
  #tools;
  #texts;
  /** @type {string[]} */ #kinds;
  #asked;
  /** @type {any} */ #controls;
  #bar;
  #state = element('p', { class: 'hint' });
  #sky = element('div', { hidden: true });
  #result;
  /** @type {HTMLElement} */ #run;
  #questions;
  #again;
  /** The request that runs. @type {AbortController|null} */ #running = null;
  /** The request for a picture or a sheet. @type {AbortController|null} */ #asking = null;
  /** What is shown, and what takes its colours away. @type {{question: Question, answer: any, remove: () => void}|null} */ #shown = null;
  /** Address of the picture of the sky. */ #picture = '';

  constructor(page, rules, tools) {
    [this.#page, this.#city, this.#rules, this.#tools, this.#texts] = [page, page.city, rules, tools, tools.texts];
    const texts = this.#texts;
    // Where the city lies on Earth says where the sun stands.
    this.#kinds = page.manifest.location ? KINDS : ['sky'];
    this.#asked = { kind: this.#kinds[0], rule: rules[0], side: DEFAULT_SIDE_M };
    this.#bar = element('progress', { 'aria-label': texts.busy, hidden: true });
    this.#result = element('div', { class: 'analysis', role: 'group', 'aria-label': texts.result });
    this.#controls = this.#makeControls();
    const { kind, rule, side } = this.#controls;
    this.#questions = element('div', { class: 'questions' }, kind.node, rule.node, side.node);
    this.#again = tools.button({ text: texts.kind, press: () => this.#unfold() });
    const press = () => (this.#running ? this.#running.abort() : this.#compute(null));
    this.#run = tools.button({ text: texts.run, class: 'primary', press });
    const buttons = element('div', { class: 'chips' }, this.#again, this.#run);
    this.nodes = [this.#questions, buttons, this.#bar, this.#state, this.#sky, this.#result];
    this.#set(this.#asked);
    this.#fold(false);
    this.#city.addEventListener('pick', (event) => this.#pick(event));
  }

  /** Ends what runs, and takes the result away. */
  closed() {
    this.#running?.abort();
    this.#clear();
  }

  /**
   * Computes what a link asks for: `KIND,RULE,X,Y,SIDE,TIME`, with the middle of the square. Does nothing if that is malformed.
   * @param {string} text
   */
  async follow(text) {
    const [kind, rule, x, y, side, time] = text.split(',');
    const isRule = kind !== 'sun' || this.#rules.includes(rule);
    const isKnown = this.#kinds.includes(kind) && isRule && SIDES_M.includes(side) && [x, y].every((metres) => NUMBER.test(metres));
    if (!isKnown) return;
    this.#running?.abort();
    this.#set({ ...this.#asked, kind, side, ...(kind === 'sun' && { rule }) });
    if (!this.#city.last.ready) await new Promise((resolve) => this.#city.addEventListener('ready', resolve, { once: true }));
    if (this.#page.panels.current === 'analyse') this.#compute({ middle: [Number(x), Number(y)], time });
  }

  #makeControls() {
    const { texts, choice, select } = this.#tools;
    const rule = select({ text: texts.rule, change: (value) => (this.#asked.rule = value) });
    rule.fill(this.#rules.map((name) => [name, texts.rules[name] ?? name]));
    const change = (value) => this.#set({ ...this.#asked, kind: value });
    const choices = this.#kinds.map((name) => [name, texts.kinds[name]]);
    const kind = choice({ title: texts.kind, choices, value: this.#asked.kind, change });
    const sides = SIDES_M.map((side) => [side, texts.metres(Number(side))]);
    const setSide = (value) => (this.#asked.side = value);
    const side = choice({ title: texts.area, choices: sides, value: this.#asked.side, isRow: true, change: setSide });
    return { kind, rule, side };
  }

  #set(asked) {
    this.#asked = asked;
    const { kind, rule, side } = this.#controls;
    kind.set(asked.kind);
    rule.set(asked.rule);
    rule.node.hidden = asked.kind !== 'sun';
    side.set(asked.side);
  }

  /** Leaves out the questions, so that a small screen has room for a result. */
  #fold(isFolded) {
    this.#questions.hidden = isFolded;
    this.#again.hidden = !isFolded;
  }

  #unfold() {
    this.#fold(false);
    this.#controls.kind.node.querySelector(':checked')?.focus();
  }

  /** Says where it stands, and shows that in a panel that scrolls. */
  #tell(text, say = this.#tools.announce) {
    setText(this.#state, text);
    this.#state.scrollIntoView({ block: 'nearest' });
    say(text);
  }

  #clear() {
    this.#fold(false);
    this.#asking?.abort();
    this.#asking = null;
    this.#bar.hidden = this.#running === null;
    this.#shown?.remove();
    this.#shown = null;
    this.#showSky(null);
    this.#result.replaceChildren();
    setText(this.#state, '');
  }

  #showBusy(isBusy) {
    const { texts } = this.#tools;
    this.#bar.hidden = !isBusy;
    this.#run.querySelector('span')?.replaceChildren(isBusy ? texts.cancel : texts.run);
    if (isBusy) this.#tell(texts.busy);
  }

  /** Asks about what is in the middle of the view, or about the place of a link. */
  async #compute(linked) {
    const texts = this.#texts;
    const own = (this.#running = new AbortController());
    this.#clear();
    this.#showBusy(true);
    try {
      const question = await this.#question(linked);
      const response = await ask(this.#city, question, texts, own.signal);
      const answer = await response.json().catch(() => lost(texts));
      const figures = await figuresOn(this.#city).catch(() => lost(texts));
      own.signal.throwIfAborted();
      this.#showBusy(false);
      this.#shown = { question, answer, remove: lay(figures, answer) };
      this.#result.replaceChildren(...resultNodes(answer, texts), ...this.#outputs(question));
      this.#fold(matchMedia(SMALL).matches);
      this.#tell(texts.done);
    } catch ({ message }) {
      // Another one may run instead.
      if (this.#running !== own) return;
      this.#showBusy(false);
      this.#tell(own.signal.aborted ? '' : texts.failed(message), this.#tools.alarm);
    } finally {
      if (this.#running === own) this.#running = null;
    }
  }

  /** What the server is asked. Fails if the middle of the view shows the sky. @returns {Promise<Question>} */
  async #question(linked) {
    const { kind, rule, side } = this.#asked;
    const [x, y] = linked?.middle ?? (await this.#middle());
    const half = Number(side) / 2;
    const own = { sun: { rule }, shadow: { time: linked?.time ?? this.#page.view.time } };
    return { kind, ...own[kind], bbox_metres: [x - half, y - half, x + half, y + half] };
  }

  /** The place in the middle of the view, in whole decimetres, as links have it. */
  async #middle() {
    const hit = await this.#city.pick(this.#city.clientWidth / 2, this.#city.clientHeight / 2);
    if (!hit) throw new Error(this.#texts.noMiddle);
    return hit.position.slice(0, 2).map((metres) => Math.round(metres * 10) / 10);
  }

  /** A link that computes the same, and the sheet of paper. */
  #outputs(question) {
    const { texts, links, button, copyField, copyRow, download } = this.#tools;
    const copy = async (input) => this.#tell((await copyField(input)) ? links.copied : links.failed);
    const link = copyRow(texts.link, copy);
    link.input.value = this.#link(question);
    const save = (blob) => {
      download(blob, `${question.kind}.pdf`);
      this.#tell(texts.saved);
    };
    const press = () => {
      this.#tell(texts.busy);
      this.#file({ ...question, format: 'pdf' }, save);
    };
    return [link.node, button({ text: texts.sheet, press })];
  }

  #link({ kind, rule = '', time = '', bbox_metres: [x0, y0, x1, y1] }) {
    const middle = [x0 + x1, y0 + y1].map((sum) => Math.round(5 * sum) / 10);
    const asked = [kind, rule, ...middle, Math.round(x1 - x0), ...(time ? [time] : [])];
    const view = this.#tools.formatView({ ...this.#page.view, object: null });
    const hash = [view, `analyse=${asked.join(',')}`].filter(Boolean).join('&');
    return `${location.href.replace(/#.*$/, '')}#${hash}`;
  }

  #pick(event) {
    if (!this.#shown || this.#page.panels.current !== 'analyse') return;
    // The panel of the objects would take the place of this one.
    event.preventDefault();
    const { texts } = this.#tools;
    const { question, answer } = this.#shown;
    const { position } = event.detail;
    const found = answer.features.find(({ geometry }) => isIn(geometry.coordinates, position));
    this.#tell(found ? texts.here(rangeText(found, answer, texts)) : texts.noValue);
    this.#showSky(null);
    if (!this.#page.manifest.location) return;
    const values = { ...question, bbox_metres: undefined, format: 'png', point_metres: position.slice(0, 2) };
    this.#file(values, (blob) => this.#showSky(blob));
  }

  /** Shows what a place sees of the sky, or nothing. */
  #showSky(blob) {
    URL.revokeObjectURL(this.#picture);
    this.#picture = blob ? URL.createObjectURL(blob) : '';
    this.#sky.hidden = !blob;
    this.#sky.replaceChildren();
    if (!blob) return;
    const image = element('img', { src: this.#picture, alt: this.#texts.sky });
    image.style.inlineSize = '100%';
    this.#sky.append(element('a', { href: this.#picture, download: 'sky.png' }, image));
  }

  /** Asks for a file of the result. A new question ends the one before. */
  async #file(values, use) {
    const texts = this.#texts;
    this.#asking?.abort();
    const own = (this.#asking = new AbortController());
    this.#bar.hidden = false;
    try {
      const response = await ask(this.#city, values, texts, own.signal);
      const blob = await response.blob().catch(() => lost(texts));
      own.signal.throwIfAborted();
      use(blob);
    } catch ({ message }) {
      if (!own.signal.aborted) this.#tell(texts.failed(message), this.#tools.alarm);
    } finally {
      if (this.#asking === own) {
        this.#asking = null;
        this.#bar.hidden = this.#running === null;
      }
    }
  }
}

/** Asks the server. What it says of a problem is English, so that the page has its own words for its type or status. */
async function ask({ src }, question, texts, signal) {
  const url = new URL(src, document.baseURI);
  url.pathname = url.pathname.replace(/\/*$/, '/analyse');
  const headers = { 'content-type': 'application/json' };
  const request = { method: 'POST', headers, body: JSON.stringify(question), signal };
  const response = await fetch(url, request).catch(() => lost(texts));
  if (response.ok) return response;
  const { type } = await response.json().catch(() => ({}));
  throw new Error(texts.reasons[type] ?? texts.reasons[response.status] ?? `HTTP ${response.status}`);
}

/** @returns {never} */
function lost(texts) {
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
function resultNodes(answer, texts) {
  const { features, unit, asked } = answer;
  const classes = features.toReversed().map((feature) => {
    const swatch = element('span', { class: 'swatch', 'aria-hidden': 'true' });
    swatch.style.backgroundColor = feature.properties.fill;
    return element('li', {}, swatch, rangeText(feature, answer, texts));
  });
  const places = ['ground', 'roofs', 'walls'].flatMap((place) => placeTexts(place, answer, texts));
  return [
    element('h3', {}, texts.units[unit] ?? unit),
    element('ul', { class: 'classes' }, ...classes),
    ...(asked === null ? [] : [element('p', {}, texts.asked(asked))]),
    element('ul', {}, ...places.map((text) => element('li', {}, text))),
  ];
}

/** The values of a kind of place in sentences; none without a value. */
function placeTexts(place, answer, texts) {
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

function rangeText({ properties: { from, to } }, { unit }, texts) {
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
