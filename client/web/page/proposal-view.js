/**
 * Proposals in a city: models that are added, and buildings that are hidden, without a bake. Only pages with proposals fetch this module.
 */

import { AddedModels } from './added-models.js';
import { element, printable } from './dom.js';
import { ObjectStates } from './object-states.js';

const FILE = 'proposals.json';
/** Of the page's address, which names the proposal that is shown. */
const PARAMETER = 'proposal';
/** Plaster, in sRGB. */
const PLASTER = [228, 219, 205];
const MOST_BORDER = 1000;
/** Kind of what a proposal adds. */
const ADDED = 'proposal';

/**
 * @typedef {{name: string, title: string, hidden: number[], added: {name: string, origin: number[], triangles_cm: number[]}[]}} Proposal
 * @typedef {{texts: any, checkbox: Function, choice: Function, say: (text: string) => void, fail: (error: Error) => void}} Tools
 */

/**
 * Fetches the proposals of a city, and shows the one that the page's address names, else the first. Returns what shows them; `null` if
 * there are none.
 * @param {import('./page-context.js').PageContext} page
 * @param {Tools} tools
 * @param {HTMLElement} content Gets the controls.
 * @returns {Promise<ProposalView|null>}
 */
export async function openProposals(page, tools, content) {
  const proposals = await fetchProposals(page);
  if (proposals.length === 0) {
    tools.say(tools.texts.none);
    return null;
  }
  if (!page.city.last.ready) await new Promise((resolve) => page.city.addEventListener('ready', resolve, { once: true }));
  const wanted = new URLSearchParams(location.search).get(PARAMETER);
  const view = new ProposalView(page, tools, proposals);
  await view.choose((proposals.find(({ name }) => name === wanted) ?? proposals[0]).name);
  content.replaceChildren(...view.nodes());
  return view;
}

/** @param {import('./page-context.js').PageContext} page @returns {Promise<Proposal[]>} */
async function fetchProposals({ city }) {
  const url = new URL(city.src, document.baseURI);
  url.pathname = url.pathname.replace(/\/*$/, `/${FILE}`);
  const lost = (error) => Promise.reject(Object.assign(error, { fault: { code: 'network' } }));
  const response = await fetch(url).catch(lost);
  if (!response.ok) throw new Error(`HTTP ${response.status}`);
  return (await response.json()).proposals;
}

class ProposalView {
  #page;
  #tools;
  #proposals;
  #models;
  #states;
  #swipe;
  /** Of the city, whose objects the proposals number. */
  #version;
  /** @type {Proposal} */ #shown;
  /** Whether the city is shown as it would be. */
  #isAfter = true;
  /** @type {{node: HTMLElement, set: (value: string) => void}} */ #side;
  /** @type {{node: HTMLElement, set: (isChecked: boolean) => void}} */ #both;

  /** @param {import('./page-context.js').PageContext} page @param {Tools} tools @param {Proposal[]} proposals */
  constructor(page, tools, proposals) {
    [this.#page, this.#tools, this.#proposals, this.#shown] = [page, tools, proposals, proposals[0]];
    const { city } = page;
    this.#version = city.manifest?.version;
    this.#models = new AddedModels((op, values) => city.ask(op, values));
    this.#states = new ObjectStates((op, values) => city.steer(op, values));
    const { texts, choice, checkbox } = tools;
    this.#swipe = new Swipe(page, texts.border, (isAfter) => this.#apply(isAfter), tools.fail);
    const sides = [
      ['before', texts.before],
      ['after', texts.after],
    ];
    const change = (value) => this.#show(value === 'after');
    this.#side = choice({ title: texts.side, choices: sides, value: 'after', isRow: true, change });
    this.#both = checkbox({ text: texts.swipe, checked: false, change: (isOn) => (isOn ? this.#startSwipe() : this.#show(true)) });
    city.addEventListener('ready', () => this.#resume().catch(tools.fail));
  }

  /** The controls. */
  nodes() {
    const { texts, choice, fail } = this.#tools;
    const choices = this.#proposals.map(({ name, title }) => [name, printable(title)]);
    const change = (name) => this.choose(name).catch(fail);
    const list = choice({ title: texts.which, choices, value: this.#shown.name, change });
    return [list.node, this.#side.node, this.#both.node];
  }

  /** Shows another proposal, and names it in the page's address. Fails if its models are too large. @param {string} name */
  async choose(name) {
    this.#swipe.stop();
    this.#apply(false);
    this.#deselectAdded();
    this.#models.clear();
    this.#shown = this.#proposals.find((proposal) => proposal.name === name) ?? this.#shown;
    await Promise.all(this.#shown.added.map((added) => this.#models.put(modelOf(added), added.origin)));
    const url = new URL(location.href);
    url.searchParams.set(PARAMETER, this.#shown.name);
    history.replaceState(history.state, '', url);
    this.#show(true);
  }

  /** Shows the city before instead of after, or the other way. */
  toggle() {
    this.#show(!this.#isAfter);
  }

  #show(isAfter) {
    this.#swipe.stop();
    this.#both.set(false);
    this.#side.set(isAfter ? 'after' : 'before');
    this.#apply(isAfter);
    if (!isAfter) this.#deselectAdded();
    const { texts, say } = this.#tools;
    say((isAfter ? texts.shown : texts.hidden)(printable(this.#shown.title)));
  }

  /** Shows the proposal in an engine that begins again, perhaps with a city that was replaced. */
  async #resume() {
    const { city } = this.#page;
    if (city.manifest?.version !== this.#version) {
      this.#version = city.manifest?.version;
      this.#states.clear();
      this.#proposals = await fetchProposals(this.#page);
      const { name } = this.#shown;
      this.#shown = this.#proposals.find((proposal) => proposal.name === name) ?? { ...this.#shown, hidden: [] };
    }
    this.#models.sendAll();
    this.#apply(this.#isAfter);
  }

  /** What is not shown is not selected. */
  #deselectAdded() {
    const { city } = this.#page;
    if (city.selection.some(({ kind }) => kind === ADDED)) city.select([]).catch(() => {});
  }

  #startSwipe() {
    this.#side.set('after');
    this.#swipe.start();
  }

  #apply(isAfter) {
    const { city } = this.#page;
    this.#isAfter = isAfter;
    this.#shown.hidden.forEach((id) => this.#states.set(id, isAfter ? { hidden: true } : null));
    this.#states.sendChanged();
    city.steer('showModels', { shown: isAfter });
    if (isAfter && city.selection.some(({ id }) => this.#shown.hidden.includes(id))) city.select([]).catch(() => {});
  }
}

/** Triangles of plaster, with the name that a click shows. */
function modelOf({ name, triangles_cm: corners }) {
  const positions = Float32Array.from(corners, (value) => value / 100);
  const colours = Uint8Array.from(corners, (_, i) => PLASTER[i % 3]);
  return { name, positions, colours, triangles: Uint32Array.from({ length: corners.length / 3 }, (_, i) => i) };
}

/** A picture of the city before over the left part of the city after, while the view rests. */
class Swipe {
  #page;
  #apply;
  #fail;
  #canvas = /** @type {HTMLCanvasElement} */ (element('canvas', { 'aria-hidden': 'true' }));
  #line = element('div', { 'aria-hidden': 'true' });
  #border;
  #node;
  /** Pictures that were begun: only the last one is shown. */
  #turn = 0;
  #isOn = false;

  /**
   * @param {import('./page-context.js').PageContext} page
   * @param {string} label Of the border.
   * @param {(isAfter: boolean) => void} apply Shows the city after or before.
   * @param {(error: Error) => void} fail
   */
  constructor(page, label, apply, fail) {
    [this.#page, this.#apply, this.#fail] = [page, apply, fail];
    const border = { type: 'range', min: 0, max: MOST_BORDER, value: MOST_BORDER / 2, 'aria-label': label };
    this.#border = /** @type {HTMLInputElement} */ (element('input', { ...border, input: () => this.#cut() }));
    this.#node = element('div', { hidden: true }, this.#canvas, this.#line, this.#border);
    const over = { position: 'absolute', inset: '0' };
    Object.assign(this.#node.style, { ...over, pointerEvents: 'none', direction: 'ltr' });
    Object.assign(this.#canvas.style, { ...over, width: '100%', height: '100%' });
    Object.assign(this.#line.style, { ...over, width: '2px', background: '#fff', boxShadow: '0 0 3px #000' });
    Object.assign(this.#border.style, { ...over, inset: 'auto 0 35%', width: '100%', margin: '0', pointerEvents: 'auto' });
    const { city } = page;
    city.append(this.#node);
    city.addEventListener('camera', () => this.#isOn && this.#hide());
    page.addEventListener('rest', () => this.#isOn && this.#take());
  }

  start() {
    this.#isOn = true;
    this.#take();
  }

  stop() {
    this.#isOn = false;
    this.#hide();
  }

  /** Shows the city after alone. */
  #hide() {
    this.#turn++;
    if (this.#isOn) this.#apply(true);
    this.#node.hidden = true;
  }

  async #take() {
    const { city } = this.#page;
    const turn = ++this.#turn;
    this.#node.hidden = true;
    this.#apply(false);
    try {
      const [width, height] = [city.clientWidth, city.clientHeight].map((side) => side * devicePixelRatio);
      const picture = await createImageBitmap(await city.screenshot({ width, height }));
      if (turn !== this.#turn) return;
      Object.assign(this.#canvas, { width: picture.width, height: picture.height });
      this.#canvas.getContext('2d')?.drawImage(picture, 0, 0);
      this.#cut();
      this.#node.hidden = false;
    } catch (error) {
      if (turn === this.#turn) this.#fail(error);
    } finally {
      if (turn === this.#turn) this.#apply(true);
    }
  }

  #cut() {
    const left = (100 * Number(this.#border.value)) / MOST_BORDER;
    this.#canvas.style.clipPath = `inset(0 ${100 - left}% 0 0)`;
    this.#line.style.left = `${left}%`;
  }
}
