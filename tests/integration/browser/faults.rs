//! A server that stops, and a network that is away: the page keeps its picture, says so, and recovers.

use super::viewer::{
    FREE, PICTURE, REACTION, ensure_city_is_visible, ensure_same_view, keep, near_camera, open, open_url, serve,
};
use anyhow::{Result, ensure};
use insula_tests::browser::Button;
use insula_tests::browser::city_page::CityPage;
use insula_tests::fixtures;
use insula_tests::programs::ServerProcess;

fn wait_for_status(page: &CityPage, condition: &str) -> Result<()> {
    page.page
        .wait_for(&format!("(status => {condition})({}.insulaSeen.status.detail)", CityPage::element(0)), REACTION * 2)
}

/// Shows a view that needs other tiles, which cannot be fetched.
fn ensure_it_says_so(page: &CityPage, name: &str) -> Result<()> {
    page.look(0, &near_camera()?)?;
    wait_for_status(page, "status.kind === 'offline'")?;
    ensure_city_is_visible(page)?;
    keep(page, name)?;
    // The message is text on the page, for eyes and for screen readers, in words of the page.
    let shown = "(() => { const roots = [document, ...[...document.querySelectorAll('*')].map(e => e.shadowRoot).filter(Boolean)];
        return roots.flatMap(root => [...root.querySelectorAll('[role=status], [role=alert], [aria-live]')])
            .some(e => e.textContent.trim() !== '' && e.getClientRects().length > 0)
            && document.querySelector('.notice.status').textContent.startsWith('Offline: the city is shown'); })()";
    page.page.wait_for(shown, REACTION)
}

pub(super) fn a_restarted_server_is_found_again() -> Result<()> {
    let server = serve()?;
    let (address, page) = (server.address.to_string(), open(&server)?);
    drop(server);
    ensure_it_says_so(&page, "server-away")?;
    page.moves_by("dragging", 0, |page| page.drag(Button::Left, FREE, [FREE[0] + 20.0, FREE[1] + 10.0]))?;
    let _server = ServerProcess::serve(&fixtures::baked_chiba()?, &address)?;
    wait_for_status(&page, "status.kind === null")?;
    page.wait_until_final(0)?;
    // As without the fault.
    let fresh = open_url(&format!("http://{address}/cities/chiba#camera={}", page.camera(0)?))?;
    ensure_same_view(&fresh.picture(0, PICTURE)?, &page.picture(0, PICTURE)?)
}

pub(super) fn an_offline_page_keeps_its_picture() -> Result<()> {
    let server = serve()?;
    let page = open(&server)?;
    page.page.set_offline(true)?;
    ensure_it_says_so(&page, "offline")?;
    page.page.set_offline(false)?;
    wait_for_status(&page, "status.kind === null")?;
    page.wait_until_final(0)?;
    let statuses = page.statuses(0)?;
    ensure!(statuses.iter().all(|status| status["kind"] != "error"), "{statuses:?}");
    ensure_city_is_visible(&page)
}
