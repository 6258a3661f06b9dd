/** The controls of the application page, put together. */

import { liveRegions } from './announcer.js';
import { attributionNodes } from './attribution.js';
import { imprintLink, logo } from './brand.js';
import { aboutDialog, helpDialog } from './dialogs.js';
import { element } from './dom.js';
import { furniture, navigation } from './furniture.js';
import { syncHash } from './hash-sync.js';
import { adapterNotice, statusNotice } from './notices.js';
import { hasSingleKeys, listenForPageKeys } from './page-keys.js';
import { PageContext } from './page-context.js';
import { analysePanel, offeredRules } from './panel-analyse.js';
import { bookmarksPanel } from './panel-bookmarks.js';
import { colorsPanel, legendBox } from './panel-colors.js';
import { measurePanel } from './panel-measure.js';
import { objectsPanel } from './panel-objects.js';
import { picturePanel } from './panel-picture.js';
import { hasProposals, proposalsPanel } from './panel-proposals.js';
import { searchPanel } from './panel-search.js';
import { sharePanel } from './panel-share.js';
import { timePanel } from './panel-time.js';
import { viewPanel } from './panel-view.js';
import { strings } from './strings.js';
import { applyTheme } from './theme.js';
import { toolbar } from './toolbar.js';

/**
 * Adds the controls of a city to the page.
 * @param {HTMLElement} app The container of the city.
 * @param {import('./insula-city.js').InsulaCity} city
 * @param {object} manifest
 */
export function startControls(app, city, manifest) {
  applyTheme();
  const page = new PageContext(city, manifest);
  const { panels } = page;
  const fixed = furniture(page);
  const about = aboutDialog(page, app.querySelector('#insula-about'));
  const help = helpDialog({ singleKeys: hasSingleKeys(), change: (singleKeys) => keys.set(singleKeys) });
  const toggles = ['search', 'view', 'objects', 'colors', 'time', 'measure', 'analyse', 'proposals', 'bookmarks', 'share', 'picture'];
  const { node, buttons, closeMore } = toolbar({
    ...Object.fromEntries(toggles.map((name) => [name, () => panels.toggle(name)])),
    more: () => panels.close(false),
    help: () => help.showModal(),
    about: () => about.showModal(),
  });

  const rules = offeredRules();
  const [measure, bookmarks, share] = [measurePanel(page), bookmarksPanel(page), sharePanel(page)];
  const proposals = hasProposals() ? proposalsPanel(page) : null;
  const all = {
    search: searchPanel(page),
    view: viewPanel(page, { counters: fixed.showCounters }),
    objects: objectsPanel(page),
    colors: colorsPanel(page),
    time: timePanel(page),
    measure,
    ...(rules.length > 0 && { analyse: analysePanel(page, rules) }),
    ...(proposals && { proposals }),
    bookmarks,
    share,
    picture: picturePanel(page),
  };
  buttons.analyse.hidden = rules.length === 0;
  buttons.proposals.hidden = proposals === null;
  Object.entries(all).forEach(([name, panel]) => panels.add(name, buttons[name], panel));
  const toggled = Object.fromEntries(['search', 'colors', 'time', 'bookmarks', 'picture'].map((n) => [n, () => panels.toggle(n)]));
  const keys = listenForPageKeys(city, {
    ...toggled,
    ...(proposals && { proposal: proposals.toggle }),
    bookmark: bookmarks.add,
    copyLink: share.copyLink,
    measure: measure.next,
    undo: () => panels.current === 'measure' && city.measure('undo'),
    counters: () => fixed.showCounters(!fixed.areCountersShown()),
    help: () => help.showModal(),
    escape: () => closeMore() || panels.close(true) || city.select([]),
  });

  const title = element('h1', { class: 'title' }, logo(), element('bdi', {}, page.title));
  const notices = element('div', { class: 'notices' }, statusNotice(city, page.title), adapterNotice(city));
  const sources = element('div', { class: 'sources', role: 'group', 'aria-label': strings.furniture.attribution });
  sources.append(...attributionNodes(page.manifest));
  const imprint = imprintLink();
  if (imprint) sources.append(sources.hasChildNodes() ? ' · ' : '', imprint);
  sources.hidden = sources.childNodes.length === 0;
  const corner = element('div', { class: 'corner' }, navigation(page), sources);
  app.append(title, node, panels.node, notices, fixed.node, legendBox(city), corner, about, help, ...liveRegions);
  app.classList.add('has-controls');
  syncHash(page);
}
