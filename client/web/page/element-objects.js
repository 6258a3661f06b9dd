/** The objects of an element's city: what is known of them, which are selected, how they are coloured. */

/** Most selected objects. */
const MAX_SELECTED = 500;
/** The kind of land. All of it is one object, so that an outline of it would be one of the city. */
const GROUND = 'relief';

/**
 * What is known of an object: see ObjectDescription in insula-viewer.d.ts.
 * @typedef {import('./messages.js').ObjectMessage} ObjectMessage
 */

/** The objects of one element. */
export class ElementObjects {
  #ask;
  #send;
  #emit;
  /** @type {Map<number, ObjectMessage>} */ #selected = new Map();
  /** The object under the mouse. @type {number|null} */ #hovered = null;
  #hovers = 0;
  /** @type {object|null} */ #rules = null;
  /** Changes of the selection so far: a later one wins over one that still waits. */
  #turn = 0;

  /**
   * @param {{ask: (op: string, values?: object) => Promise<any>, send: (op: string, values: object) => void,
   *   emit: (name: string, detail: object) => void}} actions
   */
  constructor({ ask, send, emit }) {
    [this.#ask, this.#send, this.#emit] = [ask, send, emit];
  }

  /** The selected objects. @returns {ObjectMessage[]} */
  get selection() {
    return [...this.#selected.values()];
  }

  /** What is known of an object; `null` if there is none of this number. @param {number} id */
  async describe(id) {
    return (await this.#ask('describe', { object: Number(id) })) ?? null;
  }

  /** Hits of a text; `null` if the city has no search. @param {string} text @param {number} limit */
  async search(text, limit) {
    return (await this.#ask('search', { text: String(text), limit })) ?? null;
  }

  /** Attributes and palettes. */
  async schema() {
    return this.#ask('schema');
  }

  /** Colours and filters objects. Fails if the rules are invalid, and then changes nothing. @param {object|null} rules */
  async setColors(rules) {
    const found = await this.#ask('colors', { rules: rules ?? {} });
    this.#rules = rules;
    this.#emit('colors', { ...found, rules: rules ?? null });
    return found;
  }

  /**
   * Selects objects and no others. Numbers without an object are left out.
   * @param {number[]} ids
   */
  async select(ids) {
    const turn = ++this.#turn;
    const known = [...new Set(ids)].slice(0, MAX_SELECTED).map((id) => this.#selected.get(id) ?? this.describe(id));
    const objects = await Promise.all(known);
    if (turn === this.#turn) this.#setSelection(objects.filter((object) => object !== null));
    return this.selection;
  }

  /**
   * A click on an object or on none. With `adds` it is added to the selection, or removed from it. The ground is none.
   * @param {ObjectMessage|null} object
   * @param {boolean} adds
   */
  click(object, adds) {
    this.#turn++;
    if (!object || object.kind === GROUND) {
      if (!adds && this.#selected.size > 0) this.#setSelection([]);
      return;
    }
    const isRemoved = adds && this.#selected.has(object.id);
    const others = adds ? this.selection.filter(({ id }) => id !== object.id) : [];
    this.#setSelection(isRemoved ? others : [...others, object].slice(-MAX_SELECTED));
  }

  /**
   * The object under the mouse, or none: it is outlined, too.
   * @param {Promise<number|null>} object
   */
  async hover(object) {
    const hover = ++this.#hovers;
    const found = await object;
    const isGround = found !== null && (await this.describe(found).catch(() => null))?.kind === GROUND;
    const id = isGround ? null : found;
    if (hover !== this.#hovers || id === this.#hovered) return;
    this.#hovered = id;
    this.#outline();
  }

  /** Draws a new viewer's objects like those of the last one. */
  restart() {
    this.#hovered = null;
    if (this.#selected.size > 0) this.#outline();
    // The element reports why a city cannot be shown; without its objects, it is shown without colours.
    if (this.#rules) this.setColors(this.#rules).catch(() => {});
  }

  /** Another city has other objects. */
  forget() {
    this.#turn++;
    this.#hovered = null;
    this.#rules = null;
    if (this.#selected.size > 0) this.#setSelection([]);
  }

  #setSelection(objects) {
    this.#selected = new Map(objects.map((object) => [object.id, object]));
    this.#outline();
    this.#emit('selection', { objects });
  }

  #outline() {
    const hovered = this.#hovered === null ? [] : [this.#hovered];
    this.#send('outline', { objects: [...this.selection.flatMap(({ id, parts }) => [id, ...parts]), ...hovered] });
  }
}
