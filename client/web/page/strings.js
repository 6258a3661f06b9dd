/**
 * All texts of the page, in the language of the browser. A language is one file, `language-CODE.json`, with the keys of
 * `language-en.json`; a text that it lacks is English.
 *
 * `{name}` in a text is a place for a value, so that languages may order the words freely: such a text becomes a function of the
 * values in the order of the English text. Texts that depend on a number have a form for each plural (`one`, `few`, `other`, ...)
 * with `#` for the number. In every language, `zero` is the text for none, if there is one.
 */

import english from './language-en.json' with { type: 'json' };
import { folder } from './workers.js';

const PLACE = /\{(\w+)\}/g;
/** The page waits this long for its language. */
const MAX_WAIT_MS = 5000;
/** Longer files are no languages. */
const MAX_CHARS = 1 << 17;

/** @type {Intl.PluralRules} */ let plurals;
/** @type {Intl.NumberFormat} */ let numbers;

/** The texts. Their objects stay the same when the language changes. @type {any} */
export const strings = {};

useTexts(english);

/**
 * Fetches the texts of the best language that the page offers, and uses them from now on. Without them, the page stays English.
 * @param {readonly string[]} wanted Languages of the reader, the best one first.
 * @param {readonly string[]} offered Codes of languages besides English.
 */
export async function loadLanguage(wanted, offered) {
  const code = bestLanguage(wanted, offered);
  if (code === null) return;
  try {
    const signal = AbortSignal.timeout(MAX_WAIT_MS);
    const response = await fetch(new URL(`${folder}language-${code}.json`), { signal });
    const text = response.ok ? await response.text() : '';
    if (text !== '' && text.length <= MAX_CHARS) useTexts(JSON.parse(text));
  } catch (error) {
    console.warn(`language-${code}.json: ${error?.message ?? error}`);
  }
}

/**
 * The first wanted language that is offered; `null` for English.
 * @param {readonly string[]} wanted
 * @param {readonly string[]} offered
 * @returns {string|null}
 */
function bestLanguage(wanted, offered) {
  for (const tag of wanted) {
    const code = String(tag).toLowerCase().split('-')[0];
    if (code === 'en') return null;
    if (offered.includes(code)) return code;
  }
  return null;
}

/** Uses a language's texts. @param {any} texts */
export function useTexts(texts) {
  const language = typeof texts.language === 'string' ? texts.language : english.language;
  plurals = new Intl.PluralRules(language);
  numbers = new Intl.NumberFormat(language);
  fill(strings, english, texts);
}

/** Puts texts into `into`, as far as they have the form of the English ones. */
function fill(into, model, texts) {
  for (const [key, original] of Object.entries(model)) {
    const text = hasForm(texts?.[key], original) ? texts[key] : original;
    if (typeof original === 'string') into[key] = sentence(original, text);
    else if (Array.isArray(original)) into[key] = text;
    else if (isPlural(original)) into[key] = (n) => plural(n, text);
    else fill((into[key] ??= {}), original, text);
  }
}

function hasForm(text, original) {
  if (typeof text !== typeof original || text === null) return false;
  if (Array.isArray(original)) return Array.isArray(text) && text.length === original.length;
  return !isPlural(original) || typeof text.other === 'string';
}

function isPlural(value) {
  return typeof value.other === 'string';
}

/** A text, or a function of the values that it has places for. */
function sentence(original, text) {
  const names = [...original.matchAll(PLACE)].map((match) => match[1]);
  if (names.length === 0) return text;
  const shown = (value) => (typeof value === 'number' ? numbers.format(value) : String(value));
  return (...values) => text.replace(PLACE, (place, name) => (names.includes(name) ? shown(values[names.indexOf(name)]) : place));
}

function plural(n, forms) {
  const form = forms[n === 0 ? 'zero' : plurals.select(n)] ?? forms[plurals.select(n)] ?? forms.other;
  return form.replaceAll('#', numbers.format(n));
}
