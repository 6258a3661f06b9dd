//! A published site on a plain host that serves files and ranges.

use super::viewer::{REACTION, ensure_city_is_visible, ensure_no_problems, ensure_same_view, hosts, keep};
use anyhow::{Result, ensure};
use image::RgbImage;
use insula_test_support::faulty_host::FaultyHost;
use insula_tests::{
    browser::{Browser, BrowserOptions, Button, city_page::CityPage},
    fixtures,
    programs::{program, run},
};
use std::{
    process::Command,
    sync::atomic::Ordering::Relaxed,
    time::{Duration, Instant},
};
use tempfile::TempDir;

/// Time after which a page has fetched everything again that failed.
const RECOVERY: Duration = Duration::from_secs(60);

/// The bundled city, published into `site` of a folder.
pub(super) fn publish() -> Result<TempDir> {
    let folder = tempfile::tempdir()?;
    let mut command = Command::new(program("insula-server")?);
    let output =
        run(command.arg("publish").arg(fixtures::baked_chiba()?).arg("--out").arg(folder.path().join("site")))?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Ok(folder)
}

/// The host serves the parent folder, so that the site is not at the root.
fn open(browser: &Browser, host: &FaultyHost) -> Result<CityPage> {
    let page = CityPage::open(browser, &format!("{}/site/cities/chiba/", host.url()))?;
    page.wait_until_final(0)?;
    Ok(page)
}

pub(super) fn a_published_site_works() -> Result<()> {
    let folder = publish()?;
    let (host, browser) = (FaultyHost::start(folder.path()), Browser::launch(BrowserOptions::default())?);
    let page = open(&browser, &host)?;
    ensure_city_is_visible(&page)?;
    ensure!(host.range_requests() > 3, "{} requests of ranges", host.range_requests());
    ensure!(hosts(&page)?.len() == 1, "{:?}", hosts(&page)?);
    page.moves_by("dragging", 0, |page| page.drag(Button::Left, [480.0, 300.0], [600.0, 300.0]))?;
    page.wait_until_final(0)?;
    keep(&page, "published")?;
    ensure_no_problems(&page)?;
    page.page.navigate(&format!("{}/site/", host.url()))?;
    page.page.wait_for("document.body.innerText.toLowerCase().includes('chiba')", REACTION)?;
    ensure_no_problems(&page)
}

/// What was visited can be visited again without a network.
pub(super) fn a_visited_city_works_offline() -> Result<()> {
    let folder = publish()?;
    let (host, browser) = (FaultyHost::start(folder.path()), Browser::launch(BrowserOptions::default())?);
    let url = format!("{}/site/cities/chiba/", host.url());
    let page = open(&browser, &host)?;
    page.page.evaluate("navigator.serviceWorker.ready.then(() => true)")?;
    // Now the worker sees all requests.
    page.page.navigate(&url)?;
    page.wait_until_ready(0)?;
    page.wait_until_final(0)?;
    host.faults.is_gone.store(true, Relaxed);
    page.page.navigate(&url)?;
    page.wait_until_ready(0)?;
    page.wait_until_final(0)?;
    ensure_city_is_visible(&page)
}

/// A tenth of the responses fail or are cut, and some are wrong: the picture becomes the same as without faults.
pub(super) fn a_bad_host_is_survived() -> Result<()> {
    let folder = publish()?;
    let (host, browser) = (FaultyHost::start(folder.path()), Browser::launch(BrowserOptions::default())?);
    let page = open(&browser, &host)?;
    host.faults.failing_percent.store(10, Relaxed);
    host.faults.lying_percent.store(5, Relaxed);
    let before = host.requests();
    for i in 0..8 {
        // Nearer twice, then farther and nearer in turn: a view of a single roof has few colours.
        let wheel = if i < 2 || i % 2 == 1 { -240.0 } else { 240.0 };
        page.page.wheel([480.0, 300.0], wheel)?;
        page.page.drag(Button::Left, [480.0, 300.0], [560.0, 310.0])?;
        std::thread::sleep(Duration::from_millis(300));
        ensure_city_is_visible(&page)?;
    }
    page.wait_until_final(0)?;
    ensure!(host.requests() > before + 40, "only {} requests with faults", host.requests() - before);
    let status = format!("{}.insulaSeen.status?.detail.kind !== 'offline'", CityPage::element(0));
    page.page.wait_for(&status, REACTION * 2)?;
    host.faults.failing_percent.store(0, Relaxed);
    host.faults.lying_percent.store(0, Relaxed);
    let camera = page.camera(0)?;
    let fresh = CityPage::open(&browser, &format!("{}/site/cities/chiba/#camera={camera}", host.url()))?;
    fresh.wait_until_final(0)?;
    let expected = fresh.picture(0, [320, 200])?;
    ensure_becomes(&page, &expected)
}

/// The worker that keeps responses must not answer with damaged ones for ever.
pub(super) fn damaged_bytes_are_fetched_again() -> Result<()> {
    let folder = publish()?;
    let (host, browser) = (FaultyHost::start(folder.path()), Browser::launch(BrowserOptions::default())?);
    let page = open(&browser, &host)?;
    page.page.evaluate("navigator.serviceWorker.ready.then(() => true)")?;
    // From here on the worker sees all requests.
    page.page.navigate(&format!("{}/site/cities/chiba/", host.url()))?;
    page.wait_until_ready(0)?;
    page.wait_until_final(0)?;
    host.faults.lying_percent.store(60, Relaxed);
    for _ in 0..8 {
        page.page.wheel([480.0, 300.0], -240.0)?;
        std::thread::sleep(Duration::from_millis(300));
    }
    host.faults.lying_percent.store(0, Relaxed);
    page.wait_until_still(0)?;
    let clean = Browser::launch(BrowserOptions::default())?;
    let url = format!("{}/site/cities/chiba/#camera={}", host.url(), page.camera(0)?);
    let fresh = CityPage::open(&clean, &url)?;
    fresh.wait_until_final(0)?;
    let expected = fresh.picture(0, [320, 200])?;
    ensure_becomes(&page, &expected)
}

/// A tile that failed several times is fetched again only after a pause.
fn ensure_becomes(page: &CityPage, expected: &RgbImage) -> Result<()> {
    let begin = Instant::now();
    while begin.elapsed() < RECOVERY {
        if ensure_same_view(expected, &page.picture(0, [320, 200])?).is_ok() {
            return Ok(());
        }
        std::thread::sleep(Duration::from_millis(500));
    }
    ensure_same_view(expected, &page.picture(0, [320, 200])?)
}
