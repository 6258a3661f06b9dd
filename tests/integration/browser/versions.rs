//! The slider of a city's versions: it opens the page of another day at the same view, where it is at hand again.

use super::browser;
use super::viewer::{REACTION, ensure_no_problems, keep};
use anyhow::{Context, Result, ensure};
use image::RgbImage;
use insula_tests::browser::PageOptions;
use insula_tests::browser::city_page::CityPage;
use insula_tests::fixtures;
use insula_tests::programs::{ServerProcess, program};
use std::process::Command;

const OPTIONS: PageOptions = PageOptions { size: [1024, 600], dark: false, touch: false };
const SIZE: [u32; 2] = [240, 160];
/// The house that is higher in the later version stands before it.
const CAMERA: &str = "84010,446920,40,0,-10,60";
const SLIDER: &str = "[...document.querySelectorAll('.panel:not([hidden]) .slider')]\
    .find(slider => slider.querySelector('label').textContent === 'City as of')";

/// Moves the slider, and waits for the page of the version at the same view, with the slider at hand.
fn switch_to(page: &CityPage, index: usize, name: &str, day: &str) -> Result<RgbImage> {
    page.page.evaluate(&format!(
        "(range => {{ range.value = {index}; range.dispatchEvent(new Event('input')); }})({SLIDER}.querySelector('input'))"
    ))?;
    page.page.wait_for(&format!("location.pathname === '/cities/{name}'"), REACTION)?;
    page.wait_until_ready(0)?;
    page.wait_for_view(0, CAMERA)?;
    page.page.wait_for(&format!("{SLIDER}?.querySelector('output').textContent === '{day}'"), REACTION)?;
    page.page.wait_for(&format!("document.activeElement === {SLIDER}.querySelector('input')"), REACTION)?;
    page.wait_until_final(0)?;
    keep(page, &format!("version-{name}"))?;
    page.picture(0, SIZE)
}

pub(super) fn a_slider_switches_between_versions() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let cities = fixtures::bake_versions(folder.path())?;
    let mut command = Command::new(program("insula-server")?);
    let server = ServerProcess::start_with(&mut command, &cities, "127.0.0.1:0", &[])?;
    let address = format!("http://{}/cities/later#camera={CAMERA}", server.address);
    let page = CityPage::open(browser(false)?.as_ref(), OPTIONS, &address)?;
    page.page.wait_for("document.querySelector('.has-controls') !== null", REACTION)?;
    page.page.evaluate("document.querySelector('[aria-keyshortcuts=O]').click()")?;
    page.page.wait_for(&format!("{SLIDER}?.querySelector('output').textContent === '31 January 2024'"), REACTION)?;
    page.wait_until_final(0)?;
    let later = page.picture(0, SIZE)?;
    let first = switch_to(&page, 0, "first", "1 January 2020")?;
    ensure!(first != later, "both versions have the same picture");
    let back = switch_to(&page, 1, "later", "31 January 2024")?;
    let shown = page.page.evaluate("document.querySelector('insula-city').last.ready.manifest.release.date")?;
    ensure!(shown == "2024-01-31" && back != first, "{shown}");
    let hash = page.page.evaluate("location.hash")?;
    ensure!(hash.as_str().context("no hash")?.contains("camera="), "{hash}");
    ensure_no_problems(&page)
}
