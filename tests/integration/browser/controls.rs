//! The controls of the page: they leave each other and the sources free on screens of any size, and speak the reader's language.

use super::browser;
use super::viewer::{REACTION, ensure_no_problems, keep, serve, url};
use anyhow::{Result, ensure};
use insula_tests::browser::city_page::CityPage;
use insula_tests::browser::{Browser, PageOptions};
use insula_tests::fixtures;
use insula_tests::programs::{ServerProcess, program};
use serde_json::{Value, json};
use std::process::Command;

/// A narrow phone upright; the narrowest upright, a phone on its side, a frame in an article; a larger one on its side, a tablet, a desktop.
pub(super) const PHONE: PageOptions = PageOptions { size: [360, 640], dark: false, touch: true };
const SMALLER: [PageOptions; 3] = [
    PageOptions { size: [320, 568], dark: false, touch: true },
    PageOptions { size: [640, 360], dark: false, touch: true },
    PageOptions { size: [480, 320], dark: false, touch: false },
];
const LARGER: [PageOptions; 3] = [
    PageOptions { size: [740, 360], dark: false, touch: true },
    PageOptions { size: [1024, 768], dark: false, touch: false },
    PageOptions { size: [1440, 900], dark: false, touch: false },
];

/// Code of the language that is a part of the page.
const ENGLISH: &str = "en";

/// What is covered: pairs of boxes that meet although none is a part of the other, buttons that reach out of the window, lines that are
/// lower than their letters, and words that are cut or leave their button.
const COVERED: &str = "(() => {
    const isShown = (e) => e.checkVisibility({ visibilityProperty: true }) && e.getClientRects().length > 0;
    const all = (selector) => [...document.querySelectorAll(selector)].filter(isShown);
    const boxes = all('.title, .toolbar, .panel, .notice, .navigation, .sources, .furniture .lines, .compass, .legend');
    const name = (e) => `${e.className} ${e.getAttribute('aria-label') ?? e.textContent.slice(0, 20)}`;
    const meet = (a, b) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1
        && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1;
    const boxOf = (e) => e.getBoundingClientRect();
    const found = [];
    boxes.forEach((a, at) => boxes.slice(at + 1).forEach((b) => {
        if (!a.contains(b) && !b.contains(a) && meet(boxOf(a), boxOf(b))) found.push(`${name(a)} and ${name(b)}`);
    }));
    for (const button of all('#insula-app button')) {
        const { left, right, top } = boxOf(button);
        if (left < -1 || right > innerWidth + 1 || top < -1) found.push(`${name(button)} reaches out of the window`);
    }
    for (const e of all('#insula-app *')) {
        const { overflowY, lineHeight, fontSize } = getComputedStyle(e);
        const isCut = overflowY === 'hidden' && parseFloat(lineHeight) < 1.2 * parseFloat(fontSize);
        if (isCut) found.push(`${name(e)} cuts the marks of its letters`);
    }
    for (const e of all('.toolbar *, .panel *')) {
        const clips = e.localName !== 'input' && getComputedStyle(e).overflowX !== 'visible';
        if (clips && e.scrollWidth > e.clientWidth) found.push(`${name(e)} cuts its words`);
    }
    for (const e of all('#insula-app :is(button, label)')) {
        const [box, range] = [boxOf(e), document.createRange()];
        range.selectNodeContents(e);
        const leaves = ({ left, right }) => right > left && (left < box.left - 1 || right > box.right + 1);
        if ([...range.getClientRects()].some(leaves)) found.push(`the words of ${name(e)} leave it`);
    }
    return found;
})";

/// All that a measure finds while the city loads and while each of the notices is shown that are the page's own.
const IN_ALL_STATES: &str = "((measure) => {
    const city = document.querySelector('insula-city');
    const emit = (name, detail) => city.dispatchEvent(new CustomEvent(name, { detail }));
    emit('progress', { ...city.last.progress, missing: 3 });
    const found = ['offline', 'error', null].flatMap((kind) => {
        emit('status', { kind });
        return measure().map((what) => `${kind ?? 'no notice'}: ${what}`);
    });
    emit('progress', { ...city.last.progress });
    return found;
})";

/// Whether the open panel is complete, and what lies above it knows its height. Observers report a new height before it is painted, so
/// that only a script can meet the layout in between: what measures it asks for this in the same task.
pub(super) const IS_LAID_OUT: &str = "(() => {
    const panels = document.querySelector('.panels');
    const height = document.documentElement.style.getPropertyValue('--panel-height');
    return panels.querySelector('.panel[aria-busy]:not([hidden])') === null && height === `${panels.clientHeight}px`;
})()";

/// What is covered once the page is laid out.
pub(super) fn covered(page: &CityPage) -> Result<Value> {
    let measure = format!("(globalThis.insulaCovered = {IS_LAID_OUT} ? {IN_ALL_STATES}({COVERED}) : null) !== null");
    page.page.wait_for(&measure, REACTION)?;
    page.page.evaluate("globalThis.insulaCovered")
}

/// A legend, as of a city with objects.
const LEGEND: &str = "(() => {
    const entries = [{ rgb: [9, 9, 9], label: 'no data' }, { rgb: [200, 200, 200], label: 'others' }];
    const legend = { title: 'height', ramp: { stops: [[0, 0, 0], [255, 255, 255]], range: [0, 50] }, entries };
    const detail = { rules: { attribute: 'height' }, passing: 0, legend };
    document.querySelector('insula-city').dispatchEvent(new CustomEvent('colors', { detail }));
})()";

/// Opens a page for a reader of these languages.
fn open_in(browser: &Browser, options: PageOptions, url: &str, languages: &str) -> Result<CityPage> {
    let page = CityPage::new(browser, options)?;
    let agent = page.page.evaluate("navigator.userAgent")?;
    let languages = json!({ "userAgent": agent, "acceptLanguage": languages });
    page.page.call("Emulation.setUserAgentOverride", languages)?;
    page.page.navigate(url)?;
    page.wait_until_ready(0)?;
    Ok(page)
}

/// Opens all panels of a page with all tools that a page can have, in English or in each language.
fn ensure_nothing_is_covered(options: PageOptions, is_in_all_languages: bool) -> Result<()> {
    let (city, proposals) = (fixtures::baked_chiba()?, tempfile::tempdir()?);
    std::fs::create_dir(proposals.path().join(city.file_name().unwrap_or_default()))?;
    let settings = ["analyses.at_once=1".to_owned(), format!("site.proposals={}", proposals.path().display())];
    let mut command = Command::new(program("insula-server")?);
    let server = ServerProcess::start(&mut command, &city, "127.0.0.1:0", &settings.each_ref().map(String::as_str))?;
    let browser = browser(false)?;
    let english = open_in(&browser, options, &url(&server), ENGLISH)?;
    ensure_panels_cover_nothing(&english, options, ENGLISH)?;
    let offered = english.page.evaluate("document.querySelector('meta[name=insula-languages]').content")?;
    drop(english);
    let others = offered.as_str().unwrap_or_default().split(' ').filter(|code| *code != ENGLISH);
    ensure!(others.clone().count() >= 5, "languages: {offered}");
    for language in others.filter(|_| is_in_all_languages) {
        let page = open_in(&browser, options, &url(&server), language)?;
        ensure_panels_cover_nothing(&page, options, language)?;
    }
    Ok(())
}

fn ensure_panels_cover_nothing(page: &CityPage, options: PageOptions, language: &str) -> Result<()> {
    let [width, height] = options.size;
    page.page.wait_for("document.querySelector('.has-controls') !== null", REACTION)?;
    let shown = page.page.evaluate("document.documentElement.lang")?;
    ensure!(shown.as_str().is_some_and(|shown| shown.starts_with(language)), "{shown} instead of {language}");
    let panels = page.page.evaluate("document.querySelectorAll('.panel').length")?.as_u64().unwrap_or_default();
    ensure!(panels >= 11, "{panels} panels");
    page.page.evaluate(LEGEND)?;
    for panel in 0..=panels {
        // After the last one, none is open but the menu, where there is one.
        page.page.evaluate(&format!(
            "(id => id === undefined ? document.querySelector('.more').click()
                : document.querySelector(`[aria-controls=\"${{id}}\"]`).click())
                (document.querySelectorAll('.panel')[{panel}]?.id)"
        ))?;
        let covered = covered(page)?;
        if covered.as_array().is_none_or(|list| !list.is_empty()) {
            keep(page, &format!("covered-{language}-{width}x{height}-{panel}"))?;
        }
        ensure!(covered == json!([]), "{language}, {width} x {height}, panel {panel}: {covered}");
    }
    keep(page, &format!("controls-{language}-{width}x{height}"))?;
    ensure_no_problems(page)
}

pub(super) fn panels_cover_nothing_on_a_phone() -> Result<()> {
    ensure_nothing_is_covered(PHONE, true)
}

pub(super) fn panels_cover_nothing_on_smaller_screens() -> Result<()> {
    SMALLER.into_iter().try_for_each(|options| ensure_nothing_is_covered(options, false))
}

pub(super) fn panels_cover_nothing_on_larger_screens() -> Result<()> {
    LARGER.into_iter().try_for_each(|options| ensure_nothing_is_covered(options, false))
}

/// Texts come from the file of the browser's language, with the numbers of that language, and results of the engine with them.
pub(super) fn the_page_speaks_german() -> Result<()> {
    let (server, browser) = (serve()?, browser(false)?);
    let page = open_in(&browser, PHONE, &url(&server), "de-CH,de;q=0.9,en;q=0.5")?;
    page.page.wait_for("document.documentElement.lang === 'de'", REACTION)?;
    page.page.wait_for("document.querySelector('.toolbar')?.textContent.includes('Suche')", REACTION)?;
    let role = page.page.evaluate(&format!("{}.getAttribute('aria-roledescription')", CityPage::element(0)))?;
    ensure!(role == "3D-Ansicht", "{role}");
    // What is measured, too, which the engine only counts. The middle of the view lies in the middle above the panel.
    page.page.evaluate("document.querySelector('.tool:has(.icon-measure)').click()")?;
    let result = "document.querySelector('.panel:not([hidden]) .result').textContent";
    page.page.wait_for(&format!("{result} === 'Noch keine Punkte'"), REACTION)?;
    page.page.wait_for(IS_LAID_OUT, REACTION)?;
    for at in [[150.0, 165.0], [210.0, 165.0]] {
        page.page.click(at, 1)?;
    }
    page.page.wait_for(
        &format!("/^\\d+,\\d+ k?m lang, waagerecht \\d+,\\d+ k?m, -?\\d+,\\d+ m Anstieg$/.test({result})"),
        REACTION,
    )?;
    keep(&page, "german")?;
    // All objects have a kind and a height, whatever their source calls the rest.
    page.page.evaluate(LEGEND)?;
    page.page.wait_for("document.querySelector('.legend-title').textContent === 'Höhe'", REACTION)?;
    // What the engine says of filters and colours is English: the panel tells it by its code.
    page.page.press("g")?;
    let input = "document.querySelector('.panel:not([hidden]) input[placeholder]')";
    page.page.wait_for(&format!("{input} !== null"), REACTION)?;
    page.page.evaluate(&format!("{input}.value = 'zzz > 1'; {input}.dispatchEvent(new Event('change')); 0"))?;
    let told =
        "document.querySelector('.panel:not([hidden]) .error').textContent.includes('ab Zeichen 1 gibt es nicht')";
    page.page.wait_for(told, REACTION)?;
    let list = "document.querySelector('.panel:not([hidden]) select')";
    page.page.evaluate(&format!(
        "{input}.value = ''; {input}.dispatchEvent(new Event('change'));
            {list}.append(new Option('zzz', 'zzz')); {list}.value = 'zzz'; {list}.dispatchEvent(new Event('change')); 0"
    ))?;
    let told = "document.querySelector('.panel:not([hidden]) .error').textContent === 'Keine Farben: die Objekte haben kein Attribut zzz'";
    page.page.wait_for(told, REACTION)?;
    ensure_no_problems(&page)
}

/// A day that is chosen by its name is that day in the year of the view, which may be a leap year.
pub(super) fn chosen_days_are_those_they_name() -> Result<()> {
    let (server, browser) = (serve()?, browser(false)?);
    let page = CityPage::open(&browser, PageOptions::default(), &format!("{}#time=2024-01-01T12:00", url(&server)))?;
    page.page.wait_for("document.querySelectorAll('.chip').length === 3", REACTION)?;
    page.page.evaluate("document.querySelector('[aria-keyshortcuts=O]').click()")?;
    for (number, day) in ["03-21", "06-21", "12-21"].into_iter().enumerate() {
        page.page.wait_for("document.querySelectorAll('.chip').length === 3", REACTION)?;
        page.page.evaluate(&format!("document.querySelectorAll('.chip')[{number}].click()"))?;
        page.page.wait_for(&format!("{}.view.time === '2024-{day}T12:00'", CityPage::element(0)), REACTION)?;
    }
    ensure_no_problems(&page)
}
