//! A server that stops, and a network that is away: the page keeps its picture, says so, and recovers.

use super::viewer::{REACTION, ensure_city_is_visible, ensure_same_view, keep, serve, url};
use anyhow::{Result, ensure};
use insula_tests::{
    browser::{Browser, BrowserOptions, Button, city_page::CityPage},
    fixtures,
    programs::ServerProcess,
};
use std::time::Duration;

const MIDDLE: [f64; 2] = [480.0, 300.0];

fn wait_for_status(page: &CityPage, condition: &str) -> Result<()> {
    page.page
        .wait_for(&format!("(status => {condition})({}.insulaSeen.status.detail)", CityPage::element(0)), REACTION * 2)
}

/// Moves so far that other tiles are needed.
fn approach(page: &CityPage) -> Result<()> {
    for _ in 0..6 {
        page.page.wheel(MIDDLE, -240.0)?;
        std::thread::sleep(Duration::from_millis(100));
    }
    page.page.drag(Button::Left, MIDDLE, [700.0, 300.0])
}

fn ensure_it_says_so(page: &CityPage, name: &str) -> Result<()> {
    wait_for_status(page, "status.kind === 'offline'")?;
    ensure_city_is_visible(page)?;
    keep(page, name)?;
    // The message is text on the page, for eyes and for screen readers.
    let shown = "(() => { const roots = [document, ...[...document.querySelectorAll('*')].map(e => e.shadowRoot).filter(Boolean)];
        return roots.flatMap(root => [...root.querySelectorAll('[role=status], [role=alert], [aria-live]')])
            .some(e => e.textContent.trim() !== '' && e.getClientRects().length > 0); })()";
    page.page.wait_for(shown, REACTION)
}

pub(super) fn a_restarted_server_is_found_again() -> Result<()> {
    let (server, browser) = (serve()?, Browser::launch(BrowserOptions::default())?);
    let (address, page) = (server.address.to_string(), CityPage::open(&browser, &url(&server))?);
    page.wait_until_final(0)?;
    drop(server);
    approach(&page)?;
    ensure_it_says_so(&page, "server-away")?;
    page.moves_by("dragging", 0, |page| page.drag(Button::Left, MIDDLE, [520.0, 310.0]))?;
    let _server = ServerProcess::serve(&fixtures::baked_chiba()?, &address)?;
    wait_for_status(&page, "status.kind === null")?;
    page.wait_until_final(0)?;
    // As without the fault.
    let camera = page.camera(0)?;
    let fresh = CityPage::open(&browser, &format!("http://{address}/cities/chiba#camera={camera}"))?;
    fresh.wait_until_final(0)?;
    ensure_same_view(&fresh.picture(0, [320, 200])?, &page.picture(0, [320, 200])?)
}

pub(super) fn an_offline_page_keeps_its_picture() -> Result<()> {
    let (server, browser) = (serve()?, Browser::launch(BrowserOptions::default())?);
    let page = CityPage::open(&browser, &url(&server))?;
    page.wait_until_final(0)?;
    page.page.set_offline(true)?;
    approach(&page)?;
    ensure_it_says_so(&page, "offline")?;
    page.page.set_offline(false)?;
    wait_for_status(&page, "status.kind === null")?;
    page.wait_until_final(0)?;
    let statuses = page.statuses(0)?;
    ensure!(statuses.iter().all(|status| status["kind"] != "error"), "{statuses:?}");
    ensure_city_is_visible(&page)
}
