//! The panel of analyses: what the server computes lies on the city, with its legend and numbers, until the panel is closed.

use super::browser;
use super::controls::{PHONE, covered};
use super::viewer::{REACTION, ensure_no_problems, keep};
use anyhow::{Result, ensure};
use insula_bake::{BakeOptions, GroundOption};
use insula_tests::browser::PageOptions;
use insula_tests::browser::city_page::CityPage;
use insula_tests::fixtures;
use insula_tests::programs::{ServerProcess, program};
use serde_json::json;
use std::process::Command;

/// The panel leaves the middle free.
const OPTIONS: PageOptions = PageOptions { size: [1024, 600], dark: false, touch: false };
const MIDDLE: [f64; 2] = [512.0, 300.0];
const HOUSES_PER_SIDE: usize = 4;
const PANEL: &str = "document.querySelector('.panel:not([hidden])')";
/// Whether something lies on the city.
const IS_DRAWN: &str = "(canvas => canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.some(value => value > 0))\
    (document.querySelector('insula-city').shadowRoot.querySelector('canvas.draped'))";

/// A page of a town whose server makes so many analyses at once.
fn open(at_once: &str, options: PageOptions) -> Result<(ServerProcess, CityPage)> {
    let folder = tempfile::tempdir()?;
    let input = fixtures::write_city_json(folder.path(), HOUSES_PER_SIDE)?;
    let city = fixtures::baked(
        "analysed-town",
        &BakeOptions { inputs: vec![input], ground: GroundOption::Auto, ..BakeOptions::default() },
    )?;
    let mut command = Command::new(program("insula-server")?);
    let setting = format!("analyses.at_once={at_once}");
    let server = ServerProcess::start(&mut command, &city, "127.0.0.1:0", &[&setting])?;
    let page = CityPage::open(browser(false)?.as_ref(), options, &format!("http://{}/", server.address))?;
    page.wait_until_final(0)?;
    page.page.wait_for("document.querySelector('.has-controls') !== null", REACTION)?;
    Ok((server, page))
}

/// The click has fetched what the place sees of the sky; a button saves the sheet of paper.
fn ensure_sky_and_sheet(page: &CityPage, state: &str) -> Result<()> {
    page.page.wait_for(&format!("{PANEL}.querySelector('img').naturalWidth >= 900"), REACTION)?;
    keep(page, "analysis-sky")?;
    // Downloads would leave the test.
    page.page.evaluate(
        "(make => {
            URL.createObjectURL = (blob) => {
                globalThis.insulaType = blob.type;
                return make.call(URL, blob);
            };
            HTMLAnchorElement.prototype.click = function () { globalThis.insulaSaved = this.download; };
        })(URL.createObjectURL)",
    )?;
    page.page.evaluate(&format!("{PANEL}.querySelector('.analysis > button').click()"))?;
    page.page.wait_for("insulaSaved === 'sun.pdf' && insulaType === 'application/pdf'", REACTION)?;
    page.page.wait_for(&format!("{state} === 'Sheet saved'"), REACTION)
}

/// The link of a result shows the same result.
fn ensure_link_shows(page: &CityPage, text: &str) -> Result<()> {
    let link = page.page.evaluate(&format!("{PANEL}.querySelector('.analysis input').value"))?;
    let link = link.as_str().unwrap_or_default();
    ensure!(link.contains("camera=") && link.contains("analyse=sun,en-17037,") && link.ends_with(",300"), "{link}");
    let linked = CityPage::open(browser(false)?.as_ref(), OPTIONS, link)?;
    linked.page.wait_for(&format!("{PANEL}.querySelectorAll('.classes li').length >= 3"), REACTION)?;
    let shown = linked.page.evaluate(&format!("{PANEL}.querySelector('.analysis').innerText"))?;
    ensure!(shown == text, "{shown} in place of {text}");
    let rule = linked.page.evaluate(&format!("{PANEL}.querySelector('select').value"))?;
    ensure!(rule == "en-17037", "{rule}");
    // A link that is malformed asks for nothing.
    linked.page.evaluate("location.hash = 'analyse=sun,none,1,2,300'")?;
    ensure!(linked.page.evaluate(&format!("{PANEL}.querySelector('select').value"))? == "en-17037", "{link}");
    ensure_no_problems(&linked)
}

pub(super) fn the_server_analyses_what_is_in_view() -> Result<()> {
    let (_server, page) = open("1", OPTIONS)?;
    let is_drawer = |url: &str| url.ends_with("/draped-figures.js");
    let fetched = page.page.requests()?.iter().any(|request| is_drawer(&request.url));
    ensure!(!fetched, "what draws on the city is fetched before it is needed");
    page.page.evaluate("document.querySelector('.tool:has(.icon-analyse)').click()")?;
    page.page
        .wait_for(&format!("({PANEL}?.querySelector('select option[value=en-17037]') ?? null) !== null"), REACTION)?;
    page.page.evaluate(&format!(
        "(list => {{ list.value = 'en-17037'; list.dispatchEvent(new Event('change')); }})({PANEL}.querySelector('select'))"
    ))?;
    page.page.evaluate(&format!("{PANEL}.querySelector('button.primary').click()"))?;
    page.page.wait_for(&format!("{PANEL}.querySelectorAll('.classes li').length >= 3"), REACTION)?;
    page.page.ended_request(|request| is_drawer(&request.url))?;
    let text = page.page.evaluate(&format!("{PANEL}.querySelector('.analysis').innerText"))?;
    let text = text.as_str().unwrap_or_default();
    // A border of the classes is what the rule asks for.
    for words in ["0 to 1.5", "The rule asks for 1.5", "Ground: ", "Roofs: ", "Walls: ", "% reach it"] {
        ensure!(text.contains(words), "{words:?} is not in {text}");
    }
    page.page.wait_for(IS_DRAWN, REACTION)?;
    keep(&page, "analysis")?;
    page.page.click(MIDDLE, 1)?;
    let state = format!("{PANEL}.querySelector('.panel-body > .hint').textContent");
    page.page.wait_for(&format!("{state}.startsWith('Here: ')"), REACTION)?;
    let selected = page.page.evaluate(&format!("{}.selection.length", CityPage::element(0)))?;
    ensure!(selected == 0, "a click on the colours selects {selected} objects");
    ensure_sky_and_sheet(&page, &state)?;
    ensure_link_shows(&page, text)?;
    // What the server says is English: the panel has the reasons in the language of the page.
    for (response, reason) in [
        ("Promise.resolve(Response.json({ detail: 'no time' }, { status: 503 }))", "the server has too much to do: "),
        ("Promise.resolve(Response.json({ type: '#area-too-large' }, { status: 400 }))", "the square is too large "),
        ("Promise.resolve(Response.json({ type: '#area-outside' }, { status: 400 }))", "no part of the city "),
        ("Promise.resolve(Response.json({ type: 'about:blank' }, { status: 400 }))", "HTTP 400"),
        ("Promise.resolve(new Response('of a proxy', { status: 502 }))", "HTTP 502"),
        ("Promise.reject(new TypeError('Failed to fetch'))", "the server does not answer"),
    ] {
        page.page.evaluate(&format!("globalThis.fetch = () => {response}; 0"))?;
        page.page.evaluate(&format!("{PANEL}.querySelector('button.primary').click()"))?;
        let is_told = format!("{state}.startsWith('The analysis failed: {reason}') && !({IS_DRAWN})");
        page.page.wait_for(&is_told, REACTION)?;
    }
    page.page.press("Escape")?;
    page.page.wait_for(&format!("{PANEL} === null"), REACTION)?;
    ensure_no_problems(&page)
}

/// On a phone, the questions make room for the result, and come back when they are asked for.
pub(super) fn a_result_leaves_a_phone_free() -> Result<()> {
    let (_server, page) = open("1", PHONE)?;
    page.page.evaluate("document.querySelector('.tool:has(.icon-analyse)').click()")?;
    page.page.wait_for(&format!("{PANEL}?.querySelector('.questions').checkVisibility()"), REACTION)?;
    page.page.evaluate(&format!("{PANEL}.querySelector('button.primary').click()"))?;
    page.page.wait_for(&format!("{PANEL}.querySelectorAll('.classes li').length >= 2"), REACTION)?;
    page.page.wait_for(IS_DRAWN, REACTION)?;
    let covered = covered(&page)?;
    keep(&page, "analysis-phone")?;
    ensure!(covered == json!([]), "{covered}");
    // What was asked about is in the middle of the view.
    let in_middle = "(city => document.elementFromPoint(city.x + city.width / 2, city.y + city.height / 2).localName)\
        (document.querySelector('insula-city').getBoundingClientRect())";
    let middle = page.page.evaluate(in_middle)?;
    ensure!(middle == "insula-city", "{middle} lies over the result");
    let is_legend_seen = "(legend => document.elementFromPoint(legend.left + 9, legend.top + 9).closest('.classes') !== null)\
        (document.querySelector('.classes').getBoundingClientRect())";
    ensure!(page.page.evaluate(is_legend_seen)? == true, "the legend is not seen");
    page.page.evaluate(&format!("{PANEL}.querySelector('.chips button').click()"))?;
    page.page.wait_for(&format!("{PANEL}.querySelector('.questions').checkVisibility()"), REACTION)?;
    ensure_no_problems(&page)
}

pub(super) fn a_server_without_analyses_offers_none() -> Result<()> {
    let (_server, page) = open("0", OPTIONS)?;
    let is_offered = page.page.evaluate("document.querySelector('.tool:has(.icon-analyse)').checkVisibility()")?;
    ensure!(is_offered == false, "the page offers what the server does not compute");
    ensure_no_problems(&page)
}
