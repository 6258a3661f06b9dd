//! A published site on a plain host that serves files and ranges.

use super::browser;
use super::viewer::{
    FREE, PICTURE, REACTION, cameras, ensure_city_is_visible, ensure_no_problems, ensure_same_view, hosts, keep,
    open_url,
};
use anyhow::{Result, ensure};
use insula_test_support::faulty_host::FaultyHost;
use insula_tests::browser::city_page::CityPage;
use insula_tests::browser::{Button, PageOptions};
use insula_tests::fixtures;
use insula_tests::programs::{program, run};
use std::process::Command;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Longest time until a page has fetched everything again that failed. What was damaged repeatedly, it requests after 20 s.
const RECOVERY: Duration = Duration::from_secs(180);

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
pub(super) fn url(host: &FaultyHost) -> String {
    format!("{}/site/cities/chiba/", host.url())
}

/// Opens the page again, now with the worker that keeps responses, which sees all requests.
fn visit_again(page: &CityPage, host: &FaultyHost) -> Result<()> {
    page.page.evaluate("navigator.serviceWorker.ready.then(() => true)")?;
    page.page.navigate(&url(host))?;
    page.wait_until_final(0)
}

pub(super) fn a_published_site_works() -> Result<()> {
    let folder = publish()?;
    let host = FaultyHost::start(folder.path());
    let page = open_url(&url(&host))?;
    ensure_city_is_visible(&page)?;
    ensure!(host.range_requests() > 3, "{} requests of ranges", host.range_requests());
    ensure!(hosts(&page)?.len() == 1, "{:?}", hosts(&page)?);
    page.moves_by("dragging", 0, |page| page.drag(Button::Left, FREE, [FREE[0] + 60.0, FREE[1]]))?;
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
    let host = FaultyHost::start(folder.path());
    let page = open_url(&url(&host))?;
    visit_again(&page, &host)?;
    host.faults.is_gone.store(true, Relaxed);
    page.page.navigate(&url(&host))?;
    page.wait_until_final(0)?;
    ensure_city_is_visible(&page)
}

/// A fifth of the responses fail or are cut, and some are wrong: the picture becomes the same as without faults.
pub(super) fn a_bad_host_is_survived() -> Result<()> {
    let folder = publish()?;
    let host = FaultyHost::start(folder.path());
    // So large that it takes many requests.
    let options = PageOptions { size: [960, 600], ..PageOptions::default() };
    let page = CityPage::open(browser(false)?.as_ref(), options, &url(&host))?;
    page.wait_until_final(0)?;
    host.faults.failing_percent.store(20, Relaxed);
    host.faults.lying_percent.store(10, Relaxed);
    for camera in cameras()? {
        page.look(0, &camera)?;
        ensure_city_is_visible(&page)?;
        page.wait_until_final(0)?;
    }
    let requests = page.page.requests()?;
    ensure!(requests.iter().any(|request| request.failure.is_some() || request.status == 500), "no request failed");
    let status = format!("{}.insulaSeen.status?.detail.kind !== 'offline'", CityPage::element(0));
    page.page.wait_for(&status, REACTION)?;
    host.faults.failing_percent.store(0, Relaxed);
    host.faults.lying_percent.store(0, Relaxed);
    ensure_becomes_faultless(&page, &host)
}

/// The worker that keeps responses must not answer with damaged ones for ever.
pub(super) fn damaged_bytes_are_fetched_again() -> Result<()> {
    let folder = publish()?;
    let host = FaultyHost::start(folder.path());
    let page = open_url(&url(&host))?;
    visit_again(&page, &host)?;
    let before = host.range_requests();
    host.faults.lying_percent.store(60, Relaxed);
    for camera in cameras()? {
        page.look(0, &camera)?;
        page.wait_until_final(0)?;
    }
    // Of three in a row, one is wrong.
    ensure!(host.range_requests() >= before + 3, "only {} requests of ranges", host.range_requests() - before);
    host.faults.lying_percent.store(0, Relaxed);
    ensure_becomes_faultless(&page, &host)
}

/// The picture becomes that of a page that has kept nothing, of the same view on a host without faults.
fn ensure_becomes_faultless(page: &CityPage, host: &FaultyHost) -> Result<()> {
    let expected = open_url(&format!("{}#camera={}", url(host), page.camera(0)?))?.picture(0, PICTURE)?;
    let begin = Instant::now();
    loop {
        let is_same = ensure_same_view(&expected, &page.picture(0, PICTURE)?);
        if is_same.is_ok() || begin.elapsed() > RECOVERY {
            return is_same;
        }
        std::thread::sleep(Duration::from_millis(500));
    }
}
