/** Steering, shading, and what is shown. */

import { announce } from './announcer.js';
import { element, setText } from './dom.js';
import { LOOKS, MODES, SHADINGS } from './key-table.js';
import { save } from './storage.js';
import { strings } from './strings.js';
import { collides } from './viewer-options.js';
import { checkbox, choice, field, iconButton, slider } from './widgets.js';

const texts = strings.view;
/** Range of the tolerated error in pixels. The slider is logarithmic. */
const [MIN_TAU, MAX_TAU] = [0.5, 16];
const DETAIL_STEPS = 100;
const TURN_RAD = Math.PI / 12;

/**
 * The panel of the view.
 * @param {import('./page-context.js').PageContext} page
 * @param {{counters: (shown: boolean) => void}} actions
 * @returns {import('./panels.js').Panel}
 */
export function viewPanel({ city }, actions) {
  const { options } = city;
  const set = (changes) => city.setOptions(changes);
  const named = (keys, names) => keys.map((key) => [key, names[key]]);
  const mode = choice({
    title: texts.mode,
    choices: named(MODES, texts.modes),
    value: options.mode,
    isRow: true,
    change: (value) => set({ mode: value }),
  });
  const modeHint = element('p', { class: 'hint' });
  const look = choice({
    title: texts.look,
    choices: named(LOOKS, texts.looks),
    value: options.look,
    isRow: true,
    change: (value) => set({ look: value }),
  });
  const shading = choice({
    title: texts.shading,
    choices: named(SHADINGS, texts.shadings),
    value: options.shading,
    change: (value) => set({ shading: value }),
  });
  const shadows = checkbox({ text: texts.shadows, checked: options.shadows, change: (on) => set({ shadows: on }) });
  const collision = checkbox({ text: texts.collision, checked: false, change: (on) => set({ collision: on }) });
  const counters = checkbox({ text: texts.counters, checked: false, change: actions.counters });
  const detail = slider({
    text: texts.detail,
    min: 0,
    max: DETAIL_STEPS,
    step: 1,
    value: stepOf(options.tau),
    format: (step) => (step < DETAIL_STEPS / 2 ? texts.fine : texts.coarse),
    input: (step) => set({ tau: tauOf(step) }),
  });
  const error = element('p', { class: 'hint' });
  const ends = element('div', { class: 'slider-ends', 'aria-hidden': 'true' });
  ends.append(element('span', {}, texts.fine), element('span', {}, texts.coarse));

  const distances = field({ text: texts.distances, placeholder: '50, 100, 200' });
  distances.input.addEventListener('change', () => {
    set({ distances: distances.input.value });
    // What is no list of distances is not taken.
    distances.input.value = options.distances;
  });

  const show = () => {
    mode.set(options.mode);
    setText(modeHint, texts.modeHints[options.mode]);
    look.set(options.look);
    shading.set(options.shading);
    shadows.set(options.shadows);
    collision.set(collides(options));
    detail.set(stepOf(options.tau));
    setText(error, texts.detailValue(tauText(options.tau)));
  };
  city.addEventListener('options', ({ detail: { changes } }) => {
    show();
    remember(changes);
    announceChanges(changes);
  });
  const shown = element('fieldset', {}, element('legend', {}, texts.layers), shadows.node, collision.node);
  const developer = element('details', { class: 'developer' }, element('summary', {}, texts.developer));
  developer.append(shading.node, error, distances.node, counters.node);
  const content = [mode.node, modeHint, turnButtons(city), look.node, shown, detail.node, ends, developer];
  return { title: texts.title, content, opened: show };
}

/** Buttons that turn and tilt, for people who cannot drag. */
function turnButtons(city) {
  const tip = (icon, op, rad) => iconButton({ icon, label: texts[icon], press: () => city.steer(op, { rad }) });
  const buttons = [
    tip('turnLeft', 'turn', TURN_RAD),
    tip('turnRight', 'turn', -TURN_RAD),
    tip('tiltUp', 'tilt', TURN_RAD),
    tip('tiltDown', 'tilt', -TURN_RAD),
  ];
  return element('div', { class: 'turn', role: 'group', 'aria-label': texts.move }, ...buttons);
}

/** Stores what should be the same at the next visit. */
function remember({ tau, shadows }) {
  if (tau !== undefined) save('tau', tau);
  if (shadows !== undefined) save('shadows', shadows);
}

function announceChanges({ mode, shading, look, shadows, collision, day }) {
  const { announcements, time } = strings;
  const onOff = (on, name) => announce(on ? announcements.on(name) : announcements.off(name));
  if (mode !== undefined) announce(announcements.mode(texts.modes[mode]));
  if (look !== undefined) announce(texts.looks[look]);
  if (shading !== undefined) announce(announcements.shading(texts.shadings[shading]));
  if (shadows !== undefined) onOff(shadows, texts.shadows);
  if (collision !== undefined) onOff(collision, texts.collision);
  if (day !== undefined) announce(day ? time.running : time.paused);
}

function tauOf(step) {
  return MIN_TAU * (MAX_TAU / MIN_TAU) ** (step / DETAIL_STEPS);
}

function stepOf(tau) {
  return Math.round((DETAIL_STEPS * Math.log(tau / MIN_TAU)) / Math.log(MAX_TAU / MIN_TAU));
}

function tauText(tau) {
  return new Intl.NumberFormat(strings.language, { maximumFractionDigits: 1 }).format(tau);
}
