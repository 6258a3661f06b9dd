//! Pictures of the browser beside those of the native client.

use super::browser;
use super::site::{self, publish};
use super::viewer::{REACTION, cameras, ensure_city_is_visible, serve, url};
use anyhow::{Context, Result, ensure};
use insula_test_support::faulty_host::FaultyHost;
use insula_tests::browser::PageOptions;
use insula_tests::browser::city_page::{CityPage, colours};
use insula_tests::browser::same_picture::{SharedView, in_browser, native, share_of_same};
use std::fs;
use std::path::Path;

/// Smallest share of pixels that are the same.
const SAME: f64 = 0.998;
/// Of the page and the picture: so small that a software driver draws it in seconds, and without a caption.
const SMALL: PageOptions = PageOptions { size: [240, 160], dark: false, touch: false };

/// Draws some of the views of the city. All must be the native client's.
fn compare(adapter: &str, numbers: &[usize]) -> Result<()> {
    let (server, folder, cameras) = (serve()?, tempfile::tempdir()?, cameras()?);
    let browser = browser(adapter == "gpu")?;
    let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("browser");
    fs::create_dir_all(&kept)?;
    for &number in numbers {
        let camera = cameras[number].clone();
        let view = SharedView { server: server.address, city: "chiba".into(), camera, size_px: SMALL.size };
        let (expected, drawn) = (native(&view, folder.path())?, in_browser(&browser, &view, adapter)?);
        expected.save(kept.join(format!("same-{number}-native.png")))?;
        drawn.save(kept.join(format!("same-{number}-{adapter}.png")))?;
        ensure!(colours(&expected) > 40, "camera {number} sees nothing");
        let same = share_of_same(&expected, &drawn)?;
        println!("{adapter}, camera {number}: {:.3}% of the pixels are the same", same * 100.0);
        ensure!(same >= SAME, "{adapter}, camera {number}: only {:.3}% of the pixels are the same", same * 100.0);
    }
    Ok(())
}

/// From far and from near.
pub(super) fn the_cpu_draws_the_native_picture() -> Result<()> {
    compare("cpu", &[0, 3])
}

pub(super) fn the_cpu_draws_other_native_pictures() -> Result<()> {
    compare("cpu", &[1, 2])
}

pub(super) fn webgpu_draws_the_native_picture() -> Result<()> {
    compare("gpu", &[0])
}

pub(super) fn webgpu_draws_another_native_picture() -> Result<()> {
    compare("gpu", &[1])
}

/// After the graphics device is lost, the CPU draws, and the page says so.
pub(super) fn a_lost_device_falls_back() -> Result<()> {
    let (server, browser) = (serve()?, browser(true)?);
    let page = CityPage::open_with(&browser, SMALL, &url(&server), &[("adapter", "gpu")])?;
    page.wait_for_adapter(0, "gpu")?;
    page.wait_until_final(0)?;
    ensure_city_is_visible(&page)?;
    let element = CityPage::element(0);
    page.page.evaluate(&format!("{element}.steer('loseDevice')"))?;
    let says_so = "({ kind, why }) => kind === 'cpu' && why.includes('lost')";
    page.page.wait_for(&format!("{element}.insulaSeen.adapters.some({says_so})"), REACTION)?;
    page.wait_until_final(0)?;
    ensure_city_is_visible(&page)?;
    // A new device is opened after some seconds. It has to get all tiles.
    page.wait_for_adapter(0, "gpu")?;
    page.wait_until_final(0)?;
    ensure_city_is_visible(&page)
}

/// A host that lost the file of the shaders: the CPU goes on, and the page says why.
pub(super) fn a_page_without_shaders_stays_on_the_cpu() -> Result<()> {
    let folder = publish()?;
    let assets = fs::read_dir(folder.path().join("site/assets"))?.next().context("no assets")??.path();
    for suffix in ["", ".br", ".gz"] {
        fs::remove_file(assets.join(format!("shaders.txt{suffix}")))?;
    }
    let (host, browser) = (FaultyHost::start(folder.path()), browser(true)?);
    let page = CityPage::open_with(&browser, SMALL, &site::url(&host), &[("adapter", "gpu")])?;
    let says_so = "({ kind, why }) => kind === 'cpu' && why.includes('shaders.txt: status 404')";
    page.page.wait_for(&format!("{}.insulaSeen.adapters.some({says_so})", CityPage::element(0)), REACTION)?;
    page.wait_until_final(0)?;
    ensure_city_is_visible(&page)
}

/// Pictures of several sizes are made one after another, and the page keeps its own.
pub(super) fn pictures_have_their_own_sizes() -> Result<()> {
    let (server, browser) = (serve()?, browser(false)?);
    let page = CityPage::open(&browser, SMALL, &url(&server))?;
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
