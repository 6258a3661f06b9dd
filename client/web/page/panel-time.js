/** Time of day and date of the light, and the running day. */

import { element } from './dom.js';
import { setIcon } from './icons.js';
import { strings } from './strings.js';
import { versionSlider } from './version-slider.js';
import { button, slider } from './widgets.js';

const texts = strings.time;
const MINUTE_STEP = 5;
const DAY_MS = 86_400_000;
/** Months of an equinox and the solstices, each on this day, which studies of shadows compare. */
const PRESETS = [3, 6, 12];
const PRESET_DAY = 21;

/**
 * The panel of the time.
 * @param {import('./page-context.js').PageContext} page
 * @returns {import('./panels.js').Panel}
 */
export function timePanel(page) {
  const { city, panels } = page;
  // Until a view is drawn.
  let shown = { year: 2025, day: 172, minute: 990 };
  const change = (values) => {
    shown = { ...shown, ...values };
    city.setTime(format(shown));
    show();
  };
  const hour = slider({
    text: texts.hour,
    min: 0,
    max: 24 * 60 - MINUTE_STEP,
    step: MINUTE_STEP,
    value: shown.minute,
    format: clock,
    input: (minute) => change({ minute }),
  });
  const date = slider({
    text: texts.date,
    min: 1,
    max: 365,
    step: 1,
    value: shown.day,
    format: (day) => dayText(shown.year, day),
    input: (day) => change({ day }),
  });
  const run = button({ icon: 'run', text: texts.run, press: () => city.setOptions({ day: !city.options.day }) });
  const presets = PRESETS.map((month) => {
    const ordinal = () => ordinalOf(shown.year, month, PRESET_DAY);
    return button({ text: dayText(shown.year, ordinal()), class: 'chip', press: () => change({ day: ordinal() }) });
  });
  const show = () => {
    hour.set(shown.minute);
    date.set(shown.day);
  };
  const showRunning = () => {
    setIcon(run, city.options.day ? 'pause' : 'run');
    run.querySelector('span')?.replaceChildren(city.options.day ? texts.pause : texts.run);
  };
  const follow = () => {
    const time = parse(city.view?.time);
    if (time && panels.current === 'time' && format(time) !== format(shown)) {
      shown = time;
      show();
    }
  };
  city.addEventListener('frame', follow);
  city.addEventListener('options', showRunning);
  const days = element('div', { class: 'chips', role: 'group', 'aria-label': texts.days }, ...presets);
  const versions = versionSlider(page);
  return { title: texts.title, content: [hour.node, run, date.node, days, ...(versions ? [versions] : [])], opened: follow };
}

/** Year, day of the year and minute of a time; `null` without a time. */
function parse(time) {
  const parts = /^(\d{4})-(\d\d)-(\d\d)T(\d\d):(\d\d)/.exec(time ?? '');
  if (!parts) return null;
  const [year, month, day, hour, minute] = parts.slice(1).map(Number);
  return { year, day: ordinalOf(year, month, day), minute: hour * 60 + minute };
}

function format({ year, day, minute }) {
  const date = new Date(Date.UTC(year, 0, day));
  return `${date.toISOString().slice(0, 10)}T${clock(minute)}`;
}

function ordinalOf(year, month, day) {
  return Math.round((Date.UTC(year, month - 1, day) - Date.UTC(year, 0, 1)) / DAY_MS) + 1;
}

function clock(minutes) {
  const two = (n) => String(n).padStart(2, '0');
  return `${two(Math.floor(minutes / 60))}:${two(minutes % 60)}`;
}

function dayText(year, day) {
  const parts = new Intl.DateTimeFormat(strings.language, { day: 'numeric', month: 'long', timeZone: 'UTC' });
  return parts.format(new Date(Date.UTC(year, 0, day)));
}
