//! axe-core on the page: `INSULA_AXE` names the file `axe.min.js`.

use super::viewer::{serve, url};
use anyhow::{Context, Result, ensure};
use insula_tests::browser::{Browser, BrowserOptions, city_page::CityPage};

/// In both appearances, and on a phone.
pub(super) fn axe_finds_nothing_serious() -> Result<()> {
    let path = std::env::var_os("INSULA_AXE").context("INSULA_AXE names no file")?;
    let axe = std::fs::read_to_string(path)?;
    let server = serve()?;
    for (dark, touch, size) in [(false, false, [1440, 900]), (true, false, [1440, 900]), (false, true, [390, 844])] {
        let browser = Browser::launch(BrowserOptions { gpu: false, size, dark, touch })?;
        let page = CityPage::open(&browser, &url(&server))?;
        page.page.evaluate(&format!("{axe}; 0"))?;
        let found = page.page.evaluate(
            "axe.run().then(({ violations }) => violations.filter(v => ['serious', 'critical'].includes(v.impact))
                .map(v => `${v.id}: ${v.nodes.map(n => n.html).join(' ')}`))",
        )?;
        ensure!(found.as_array().is_some_and(Vec::is_empty), "dark {dark}, touch {touch}: {found}");
    }
    Ok(())
}
