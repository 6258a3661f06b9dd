//! The package's example pages on a plain host, with a city of a server on another origin.
//!
//! React and MapLibre are not part of the package: `INSULA_VENDOR` names a folder with the files that the package's README
//! names. Without it, their examples are reported as ignored.

use super::browser;
use super::site::publish;
use super::viewer::{CITY_COLOURS, PICTURE, REACTION, ensure_no_problems, ensure_same_view, keep, serve};
use anyhow::{Context, Result, ensure};
use insula_test_support::faulty_host::FaultyHost;
use insula_tests::browser::city_page::{CityPage, colours};
use insula_tests::browser::same_picture::share_of_same;
use insula_tests::browser::{Button, PageOptions};
use insula_tests::fixtures;
use insula_tests::programs::ServerProcess;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// A script's expression of a glTF file in one piece: a large triangle that faces south and up.
const MODEL: &str = r"(() => {
    const positions = new Uint8Array(new Float32Array([-150, 5, 150, 150, 5, 150, 0, 120, -150]).buffer);
    const json = JSON.stringify({
        asset: { version: '2.0' }, nodes: [{ mesh: 0 }], meshes: [{ primitives: [{ attributes: { POSITION: 0 } }] }],
        accessors: [{ bufferView: 0, componentType: 5126, count: 3, type: 'VEC3' }],
        bufferViews: [{ buffer: 0, byteLength: 36 }], buffers: [{ byteLength: 36 }],
    });
    const words = (...numbers) => new Uint32Array(numbers);
    const parts = [words(json.length, 0x4e4f534a), json, words(36, 0x004e4942), positions];
    return new Blob([words(0x46546c67, 2, 12 + 8 + json.length + 8 + 36), ...parts]).arrayBuffer();
})()";
/// Of a page with one city, and of one with two or a map.
const SMALL: [u32; 2] = [480, 640];
const LARGE: [u32; 2] = [1000, 800];

/// What a page says that demands Trusted Types, and allows those of the element.
const TRUSTED_TYPES: &str = "<meta http-equiv=\"Content-Security-Policy\" \
    content=\"require-trusted-types-for 'script'; trusted-types insula\">";

/// A page of the examples; ended in the reverse order.
struct Example {
    page: CityPage,
    _site: ExampleSite,
}

/// The package as npm lays it out, on a plain host, and a server of the bundled city.
pub(super) struct ExampleSite {
    host: FaultyHost,
    pub(super) server: ServerProcess,
    _folder: TempDir,
}

/// Copies the files of a folder.
fn copy(from: &Path, to: &Path) -> Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from).with_context(|| from.display().to_string())? {
        let entry = entry?;
        if entry.file_type()?.is_file() {
            fs::copy(entry.path(), to.join(entry.file_name()))?;
        }
    }
    Ok(())
}

/// Serves the bundled city as if it were known where it lies: its sources do not say it.
fn serve_located(folder: &Path) -> Result<ServerProcess> {
    copy(&fixtures::baked_chiba()?, folder)?;
    let path = folder.join("city.json");
    let mut manifest: Value = serde_json::from_slice(&fs::read(&path)?)?;
    manifest["location"] = json!({ "latitude_deg": 35.6, "longitude_deg": 140.1, "north_deg": 0.2 });
    fs::write(&path, serde_json::to_vec(&manifest)?)?;
    ServerProcess::serve(folder, "127.0.0.1:0")
}

impl ExampleSite {
    /// The published assets, beside the examples.
    pub(super) fn start() -> Result<Self> {
        let (site, folder) = (publish()?, tempfile::tempdir()?);
        let assets = fs::read_dir(site.path().join("site/assets"))?.next().context("no assets")??.path();
        copy(&assets, folder.path())?;
        let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../client/web/package/examples");
        copy(&examples, &folder.path().join("examples"))?;
        let plain = fs::read_to_string(examples.join("plain.html"))?;
        fs::write(
            folder.path().join("examples/trusted.html"),
            plain.replacen("<title>", &format!("{TRUSTED_TYPES}<title>"), 1),
        )?;
        // Browsers ask every host for it.
        fs::write(folder.path().join("favicon.ico"), "icon")?;
        if let Some(vendor) = std::env::var_os("INSULA_VENDOR") {
            copy(Path::new(&vendor), &folder.path().join("examples/vendor"))?;
        }
        let server = serve_located(&folder.path().join("cities/chiba"))?;
        Ok(Self { host: FaultyHost::start(folder.path()), server, _folder: folder })
    }

    /// The address of an example that shows the city.
    pub(super) fn url(&self, name: &str) -> String {
        format!("{}/examples/{name}.html?src=http://{}/v1/cities/chiba", self.host.url(), self.server.address)
    }
}

impl Example {
    fn open(name: &str, size: [u32; 2]) -> Result<Self> {
        let site = ExampleSite::start()?;
        let options = PageOptions { size, ..PageOptions::default() };
        let page = CityPage::open(browser(false)?.as_ref(), options, &site.url(name))?;
        page.wait_until_final(0)?;
        Ok(Self { page, _site: site })
    }

    /// The middle of an element in CSS pixels.
    fn middle_of(&self, selector: &str) -> Result<[f64; 2]> {
        let script = format!(
            "(box => [box.x + box.width / 2, box.y + box.height / 2])(document.querySelector('{selector}').getBoundingClientRect())"
        );
        let at = self.page.page.evaluate(&script)?;
        Ok([at[0].as_f64().context("no place")?, at[1].as_f64().context("no place")?])
    }

    /// A click into a city shows coordinates in an element.
    fn pick(&self, shown_in: &str) -> Result<()> {
        let [x, y] = self.middle_of("insula-city")?;
        self.page.page.click([x, y + 20.0], 1)?;
        let shown =
            format!(r"/^-?\d+\.\d, -?\d+\.\d, -?\d+\.\d/.test(document.querySelector('{shown_in}').textContent)");
        self.page.page.wait_for(&shown, REACTION)
    }

    fn ensure_cities(&self, count: usize) -> Result<()> {
        for number in 0..count {
            let found = colours(&self.page.picture(number, PICTURE)?);
            ensure!(found >= CITY_COLOURS, "viewer {number}: {found} colours");
        }
        ensure_no_problems(&self.page)
    }
}

pub(super) fn the_plain_example_runs() -> Result<()> {
    let example = Example::open("plain", SMALL)?;
    let page = &example.page;
    example.pick("#picked")?;
    example.ensure_cities(1)?;
    keep(page, "example-plain")?;
    page.moves_by("the button", 0, |page| page.evaluate("document.getElementById('down').click()").map(drop))?;
    page.page.wait_for(&format!("{}.view.pitch < -80", CityPage::element(0)), REACTION)?;
    page.wait_until_final(0)?;
    // Below the first view is nothing of the city.
    keep(page, "example-plain-down")?;
    ensure_no_problems(page)
}

/// Scripts of the element's own origin need an address of its policy, too.
pub(super) fn a_page_with_trusted_types_shows_the_city() -> Result<()> {
    let example = Example::open("trusted", SMALL)?;
    example.ensure_cities(1)?;
    let is_refused = "(() => { try { new Worker('../engine.js'); return false } catch { return true } })()";
    ensure!(example.page.page.evaluate(is_refused)? == true, "the page demands nothing");
    Ok(())
}

pub(super) fn the_react_example_runs() -> Result<()> {
    let example = Example::open("react", LARGE)?;
    let page = &example.page;
    page.wait_until_ready(1)?;
    page.wait_until_final(1)?;
    example.pick("#state")?;
    keep(page, "example-react")?;
    example.ensure_cities(2)?;
    page.page.evaluate("document.querySelector('button').click()")?;
    page.page.wait_for("document.querySelectorAll('insula-city').length === 1", REACTION)?;
    example.ensure_cities(1)
}

/// Of two markers on one ray, the one before the surface is shown, and the one behind it is not. Their text is text.
pub(super) fn markers_are_occluded() -> Result<()> {
    let example = Example::open("plain", SMALL)?;
    let page = &example.page.page;
    page.evaluate(&format!(
        "(async () => {{ const city = {};
            const {{ position: at }} = await city.pick(city.clientWidth / 2, city.clientHeight * 0.6);
            const eye = city.view.position;
            const between = share => at.map((v, k) => v + (eye[k] - v) * share);
            city.addMarker({{ position: between(0.05), text: '<b>before</b>' }});
            city.addMarker({{ position: between(-0.05), text: 'behind' }});
            globalThis.shown = () => [...city.shadowRoot.querySelectorAll('.marker:not([hidden])')].map(m => m.textContent);
        }})()",
        CityPage::element(0)
    ))?;
    page.wait_for("shown().includes('<b>before</b>')", REACTION)?;
    ensure!(page.evaluate("shown().includes('behind')")? == false, "{}", page.evaluate("shown()")?);
    ensure_no_problems(&example.page)
}

/// With `gestures="cooperative"`, the wheel scrolls the page until the city has the focus. The hint has the language of the article.
pub(super) fn an_article_keeps_its_wheel() -> Result<()> {
    let example = Example::open("plain", SMALL)?;
    let page = &example.page;
    let (at, element) = (example.middle_of("insula-city")?, CityPage::element(0));
    page.page.evaluate(&format!(
        "{element}.setAttribute('gestures', 'cooperative'); {element}.blur(); document.body.style.minBlockSize = '3000px'"
    ))?;
    let camera = page.camera(0)?;
    page.page.wheel(at, 120.0)?;
    page.page.wait_for("scrollY > 0", REACTION)?;
    ensure!(page.camera(0)? == camera, "the city took the wheel, too");
    let hint = page.page.evaluate(&format!("{element}.shadowRoot.querySelector('.gesture').textContent"))?;
    ensure!(hint.as_str().is_some_and(|hint| hint.contains("wheel")), "{hint}");
    page.page.evaluate(
        "scrollTo(0, 0); import(new URL('../insula-city.js', location)).then(async ({ setTexts }) => {
            setTexts(await (await fetch('../language-de.json')).json());
            window.isGerman = true;
        }); 0",
    )?;
    page.page.wait_for("window.isGerman === true", REACTION)?;
    page.page.wheel(at, 120.0)?;
    page.page.wait_for("scrollY > 0", REACTION)?;
    page.page.wait_for(
        &format!("{element}.shadowRoot.querySelector('.gesture').textContent.includes('Mausrad')"),
        REACTION,
    )?;
    page.page.evaluate(&format!("scrollTo(0, 0); {element}.focus({{ preventScroll: true }})"))?;
    page.moves_by("the wheel", 0, |page| page.wheel(at, -240.0))?;
    ensure!(page.page.evaluate("scrollY")? == 0, "the page took the wheel, too");
    ensure_no_problems(page)
}

/// A city whose server does not answer yet is shown as soon as it does.
pub(super) fn a_server_that_starts_late_is_found() -> Result<()> {
    let example = Example::open("plain", SMALL)?;
    let page = &example.page;
    let late = serve()?;
    let address = late.address.to_string();
    drop(late);
    page.page.evaluate(&format!(
        "(() => {{ const late = document.createElement('insula-city');
            late.setAttribute('src', 'http://{address}/v1/cities/chiba');
            // Elements out of sight wait.
            document.body.append(late);
            late.scrollIntoView(); }})()"
    ))?;
    let waits = format!("{}.insulaSeen?.status?.detail.kind === 'waiting'", CityPage::element(1));
    page.page.wait_for(&waits, REACTION)?;
    let _server = ServerProcess::serve(&fixtures::baked_chiba()?, &address)?;
    page.wait_until_ready(1)
}

/// Features lie on the city, and a view fits bounds in degrees.
pub(super) fn the_geojson_example_runs() -> Result<()> {
    let example = Example::open("geojson", SMALL)?;
    let page = &example.page;
    page.page.wait_for("document.querySelector('#state').textContent.startsWith('district, way, stop')", REACTION)?;
    page.moves_by("the button", 0, |page| page.evaluate("document.getElementById('fit').click()").map(drop))?;
    page.page.wait_for(&format!("Math.abs({}.place.pitch + 50) < 0.01", CityPage::element(0)), REACTION)?;
    page.wait_until_final(0)?;
    page.page.wait_for(
        "(canvas => canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.some(value => value > 0))\
         (document.querySelector('insula-city').shadowRoot.querySelector('canvas.draped'))",
        REACTION,
    )?;
    keep(page, "example-geojson")?;
    example.ensure_cities(1)?;
    adding_a_model_changes_the_picture(page)?;
    ensure_no_problems(page)
}

/// The model stands in the middle of the view until it is removed.
fn adding_a_model_changes_the_picture(page: &CityPage) -> Result<()> {
    let (city, without) = (CityPage::element(0), page.picture(0, PICTURE)?);
    let middle = format!("{city}.pick({city}.clientWidth / 2, {city}.clientHeight / 2)");
    let add = format!("([bytes, {{ lon, lat }}]) => {city}.addModel({{ bytes, lon, lat, heading: 20 }})");
    page.page.evaluate(&format!(
        "Promise.all([{MODEL}, {middle}]).then({add}).then(number => {{ globalThis.model = number }})"
    ))?;
    let same = share_of_same(&without, &page.picture(0, PICTURE)?)?;
    page.wait_until_final(0)?;
    keep(page, "example-geojson-model")?;
    ensure!(same < 0.95, "{same} of the pixels are the same with a model");
    let removed = page.page.evaluate(&format!("[{city}.removeModel(model), {city}.removeModel(model)]"))?;
    ensure!(removed == json!([true, false]), "{removed}");
    ensure_same_view(&without, &page.picture(0, PICTURE)?)
}

/// The map and the city follow each other.
pub(super) fn the_maplibre_example_runs() -> Result<()> {
    let example = Example::open("maplibre", LARGE)?;
    let page = &example.page;
    page.page.wait_for("document.querySelector('#map canvas')", REACTION)?;
    let [x, y] = example.middle_of("#map")?;
    page.moves_by("the map", 0, |page| page.drag(Button::Left, [x, y], [x + 60.0, y + 20.0]))?;
    page.wait_until_final(0)?;
    keep(page, "example-maplibre")?;
    example.ensure_cities(1)
}
