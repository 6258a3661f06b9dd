//! A proposal in the page: a link shows it, a key shows the city before, and a border goes between both.

use super::browser;
use super::viewer::{REACTION, ensure_no_problems, keep};
use anyhow::{Result, ensure};
use insula_bake::{BakeOptions, GroundOption};
use insula_tests::browser::PageOptions;
use insula_tests::browser::city_page::CityPage;
use insula_tests::fixtures;
use insula_tests::programs::{ServerProcess, program};
use serde_json::json;
use std::fs;
use std::process::Command;

const OPTIONS: PageOptions = PageOptions { size: [1024, 600], dark: false, touch: false };
const SIZE: [u32; 2] = [240, 160];
const NAME: &str = "proposed-town";

/// A place of the page that shows what the proposal adds; `null` if there is none.
const FIND_ADDED: &str = "(async () => {
    const city = document.querySelector('insula-city');
    for (let y = 0.2; y < 0.8; y += 0.02) for (let x = 0.2; x < 0.7; x += 0.02) {
        const object = await city.ask('objectAt', { x, y });
        if (object >= 0xffff0000) return [x * innerWidth, y * innerHeight];
    }
    return null;
})()";

/// Whether the panel's line says this.
fn says(text: &str) -> String {
    format!("[...document.querySelectorAll('.hint')].some(line => line.textContent === '{text}')")
}

pub(super) fn a_proposal_is_shown_before_and_after() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let input = fixtures::write_city_json(folder.path(), 4)?;
    let city = fixtures::baked(
        NAME,
        &BakeOptions { inputs: vec![input], ground: GroundOption::Auto, ..BakeOptions::default() },
    )?;
    // Between the houses.
    let ring = [[84_068, 447_028], [84_078, 447_028], [84_078, 447_038], [84_068, 447_038], [84_068, 447_028]];
    let proposals = folder.path().join("proposals");
    fs::create_dir_all(proposals.join(NAME))?;
    let polygon = json!({ "type": "Polygon", "coordinates": [ring] });
    fs::write(proposals.join(NAME).join("tower.geojson"), polygon.to_string())?;
    let plan =
        "title = \"Tower\"\n[[add]]\noutline = \"tower.geojson\"\nheight_m = 90\n[[remove]]\nids = [\"house-5\"]\n";
    fs::write(proposals.join(NAME).join("tower.toml"), plan)?;

    let mut command = Command::new(program("insula-server")?);
    let setting = format!("site.proposals={}", proposals.display());
    let server = ServerProcess::start(&mut command, &city, "127.0.0.1:0", &[&setting])?;
    let address = format!("http://{}/?proposal=tower", server.address);
    let page = CityPage::open(browser(false)?.as_ref(), OPTIONS, &address)?;
    page.wait_until_ready(0)?;
    page.page.wait_for(&says("Tower: after"), REACTION)?;
    let after = page.picture(0, SIZE)?;
    keep(&page, "proposal-after")?;
    page.page.press("y")?;
    page.page.wait_for(&says("Tower: before"), REACTION)?;
    let before = page.picture(0, SIZE)?;
    ensure!(before != after, "the city before is that after");
    page.page.press("y")?;
    page.page.wait_for(&says("Tower: after"), REACTION)?;
    ensure!(page.picture(0, SIZE)? == after, "the city after is another one the second time");

    // A click shows the name of an added model, as in the window. A hidden model is not selected, and links omit its number.
    let place = page.page.evaluate(FIND_ADDED)?;
    ensure!(place.is_array(), "nothing that is added is seen");
    page.page.click([0, 1].map(|k| place[k].as_f64().unwrap_or_default()), 1)?;
    let panel = "document.querySelector('.panel:not([hidden]) .objects')";
    page.page.wait_for(&format!("{panel}?.querySelector('h3').textContent === 'tower.geojson'"), REACTION)?;
    let kind = page.page.evaluate(&format!("{panel}.querySelector('.hint').textContent"))?;
    ensure!(kind == "Part of the proposal", "{kind}");
    keep(&page, "proposal-object")?;
    page.page.press("y")?;
    page.page.wait_for(&says("Tower: before"), REACTION)?;
    page.page.wait_for("document.querySelector('insula-city').selection.length === 0", REACTION)?;
    ensure!(page.page.evaluate("location.hash.includes('object=')")? == false, "the link has a number of the proposal");
    page.page.press("y")?;
    page.page.wait_for(&says("Tower: after"), REACTION)?;

    page.page.evaluate("document.querySelector('.tool:has(.icon-proposals)').click()")?;
    page.page.wait_for("document.querySelector('.panel:not([hidden]) input[type=checkbox]') !== null", REACTION)?;
    page.page.evaluate("document.querySelector('.panel:not([hidden]) input[type=checkbox]').click()")?;
    let border = "document.querySelector('insula-city input[type=range]')";
    page.page.wait_for(&format!("{border}?.checkVisibility() === true"), REACTION)?;
    keep(&page, "proposal-swipe")?;
    page.page.evaluate(&format!(
        "{border}.value = 250; {border}.dispatchEvent(new Event('input')); {border}.previousSibling.style.left"
    ))?;
    let left = page.page.evaluate(&format!("{border}.previousSibling.style.left"))?;
    ensure!(left == "25%", "the line is at {left}");
    ensure_no_problems(&page)
}
