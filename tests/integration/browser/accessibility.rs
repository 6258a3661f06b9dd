//! axe-core on the page: `INSULA_AXE` names the file `axe.min.js`.

use super::browser;
use super::viewer::{DESKTOP, PHONE, serve, url};
use anyhow::{Context, Result, ensure};
use insula_tests::browser::PageOptions;
use insula_tests::browser::city_page::CityPage;

/// In both appearances, and on a phone.
pub(super) fn axe_finds_nothing_serious() -> Result<()> {
    let path = std::env::var_os("INSULA_AXE").context("INSULA_AXE names no file")?;
    let axe = std::fs::read_to_string(path)?;
    let (server, browser) = (serve()?, browser(false)?);
    for (size, dark, touch) in [(DESKTOP, false, false), (DESKTOP, true, false), (PHONE, false, true)] {
        let page = CityPage::open(&browser, PageOptions { size, dark, touch }, &url(&server))?;
        page.page.evaluate(&format!("{axe}; 0"))?;
        let found = page.page.evaluate(
            "axe.run().then(({ violations }) => violations.filter(v => ['serious', 'critical'].includes(v.impact))
                .map(v => `${v.id}: ${v.nodes.map(n => n.html).join(' ')}`))",
        )?;
        ensure!(found.as_array().is_some_and(Vec::is_empty), "dark {dark}, touch {touch}: {found}");
    }
    Ok(())
}
