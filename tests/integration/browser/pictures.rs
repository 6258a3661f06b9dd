//! Pictures of the browser beside those of the native client.

use super::viewer::{ensure_city_is_visible, serve};
use anyhow::{Result, ensure};
use insula_tests::{
    browser::{
        Browser, BrowserOptions,
        city_page::{CityPage, colours},
        same_picture::{SharedView, cameras, in_browser, native, share_of_same},
    },
    fixtures,
    programs::ServerProcess,
};
use std::path::Path;

/// Smallest share of pixels that are the same.
const SAME: f64 = 0.998;
/// Of the page and the picture: so small that a software driver draws it in seconds, and without a caption.
const SIZE_PX: [u32; 2] = [240, 160];

fn views(server: &ServerProcess) -> Result<Vec<SharedView>> {
    let manifest = serde_json::from_slice(&std::fs::read(fixtures::baked_chiba()?.join("city.json"))?)?;
    let view = |camera| SharedView { server: server.address, city: "chiba".into(), camera, size_px: SIZE_PX };
    Ok(cameras(&manifest)?.into_iter().map(view).collect())
}

/// Draws the first `count` views. All must be the native client's.
fn compare(adapter: &str, count: usize) -> Result<()> {
    let (server, folder) = (serve()?, tempfile::tempdir()?);
    let browser =
        Browser::launch(BrowserOptions { gpu: adapter == "gpu", size: SIZE_PX, ..BrowserOptions::default() })?;
    let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("browser");
    std::fs::create_dir_all(&kept)?;
    for (number, view) in views(&server)?.iter().take(count).enumerate() {
        let (expected, drawn) = (native(view, folder.path())?, in_browser(&browser, view, adapter)?);
        expected.save(kept.join(format!("same-{number}-native.png")))?;
        drawn.save(kept.join(format!("same-{number}-{adapter}.png")))?;
        ensure!(colours(&expected) > 40, "camera {number} sees nothing");
        let same = share_of_same(&expected, &drawn)?;
        println!("{adapter}, camera {number}: {:.3}% of the pixels are the same", same * 100.0);
        ensure!(same >= SAME, "{adapter}, camera {number}: only {:.3}% of the pixels are the same", same * 100.0);
    }
    Ok(())
}

pub(super) fn the_cpu_draws_the_native_picture() -> Result<()> {
    compare("cpu", 4)
}

pub(super) fn webgpu_draws_the_native_picture() -> Result<()> {
    compare("gpu", 2)
}

/// After the graphics device is lost, the CPU draws, and the page says so.
pub(super) fn a_lost_device_falls_back() -> Result<()> {
    let server = serve()?;
    let browser = Browser::launch(BrowserOptions { gpu: true, size: SIZE_PX, ..BrowserOptions::default() })?;
    let page = CityPage::open(&browser, &super::viewer::url(&server))?;
    page.restart_with(0, &[("adapter", "gpu")])?;
    page.wait_for_adapter(0, "gpu")?;
    page.wait_until_final(0)?;
    ensure_city_is_visible(&page)?;
    let element = CityPage::element(0);
    page.page.evaluate(&format!("{element}.steer('loseDevice')"))?;
    page.wait_for_adapter(0, "cpu")?;
    let why = page.last_event(0, "adapter")?["detail"]["why"].clone();
    ensure!(why.as_str().is_some_and(|why| why.contains("lost")), "{why}");
    page.wait_until_final(0)?;
    ensure_city_is_visible(&page)?;
    // A new device is opened after some seconds. It has to get all tiles.
    page.wait_for_adapter(0, "gpu")?;
    page.wait_until_final(0)?;
    ensure_city_is_visible(&page)
}

/// Pictures of several sizes are made one after another, and the page keeps its own.
pub(super) fn pictures_have_their_own_sizes() -> Result<()> {
    let server = serve()?;
    let browser = Browser::launch(BrowserOptions { size: SIZE_PX, ..BrowserOptions::default() })?;
    let page = CityPage::open(&browser, &super::viewer::url(&server))?;
    let sizes = page.page.evaluate(&format!(
        "Promise.all([[64, 48], [96, 40]].map(async ([width, height]) => {{
            const picture = await createImageBitmap(await {}.screenshot({{ width, height }}));
            return [picture.width, picture.height];
        }}))",
        CityPage::element(0)
    ))?;
    ensure!(sizes == serde_json::json!([[64, 48], [96, 40]]), "{sizes}");
    page.wait_until_final(0)?;
    ensure_city_is_visible(&page)
}
