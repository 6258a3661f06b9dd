//! Objects in a page: clicks and the panel of attributes, the search, colours with their legend. Objects of 3D Tiles in CesiumJS.

use super::browser;
use super::controls::IS_LAID_OUT;
use super::viewer::{PICTURE, REACTION, ensure_no_problems, keep, open_url};
use anyhow::{Context, Result, ensure};
use insula_bake::BakeOptions;
use insula_test_support::faulty_host::FaultyHost;
use insula_tests::browser::city_page::{CityPage, FINAL, colours};
use insula_tests::browser::same_picture::{SharedView, native_with, share_of_same};
use insula_tests::browser::{Button, PageOptions};
use insula_tests::fixtures;
use insula_tests::programs::{ServerProcess, program, run};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;
use tempfile::TempDir;

const SIZE_PX: [u32; 2] = [480, 320];
/// With room for panels beside the middle.
const WALK_PX: [u32; 2] = [1024, 640];
const WALK_MIDDLE: [f64; 2] = [512.0, 320.0];
/// So small that a software driver draws it in seconds.
const GPU_SIZE_PX: [u32; 2] = [400, 320];
const HOUSES_PER_SIDE: usize = 4;
/// Distance of the houses, and where the first one stands.
const STEP_M: f64 = 40.0;
const CORNER: [f64; 2] = [84_000.0, 447_000.0];
/// Smallest share of pixels that are those of the native client.
const SAME: f64 = 0.998;
/// Surfaces of columns are up to half a cell from the walls.
const EDGE_M: f64 = 0.6;
/// Fewest colours of a picture of the town, whose houses have one colour, in the light of CesiumJS.
const FEWEST_COLOURS: usize = 5;
/// The same as a share of the distance of the houses.
const CELL_MARGIN: f64 = EDGE_M / STEP_M;

/// A town of cuboids, each with the year in which it was built.
struct Town {
    server: ServerProcess,
    houses: Value,
    _folder: TempDir,
}

impl Town {
    fn open(gpu: bool) -> Result<(Self, CityPage)> {
        Self::open_at(gpu, if gpu { GPU_SIZE_PX } else { SIZE_PX })
    }

    fn open_at(gpu: bool, size: [u32; 2]) -> Result<(Self, CityPage)> {
        let folder = tempfile::tempdir()?;
        let mut houses = fixtures::city_json(HOUSES_PER_SIDE);
        for i in 0..HOUSES_PER_SIDE * HOUSES_PER_SIDE {
            houses["CityObjects"][format!("house-{i}")]["attributes"] =
                json!({ "yearOfConstruction": 1600 + 20 * i, "link": "https://example.org/a" });
        }
        let input: PathBuf = folder.path().join("town.city.json");
        std::fs::write(&input, houses.to_string())?;
        let city = fixtures::baked("object-town", &BakeOptions { inputs: vec![input], ..BakeOptions::default() })?;
        let server = ServerProcess::serve(&city, "127.0.0.1:0")?;
        let options = PageOptions { size, ..PageOptions::default() };
        let attributes: &[(&str, &str)] = if gpu { &[("adapter", "gpu")] } else { &[] };
        let url = format!("http://{}/", server.address);
        let page = CityPage::open_with(browser(gpu)?.as_ref(), options, &url, attributes)?;
        if gpu {
            page.wait_for_adapter(0, "gpu")?;
        }
        page.wait_until_final(0)?;
        Ok((Self { server, houses, _folder: folder }, page))
    }

    /// The house below a position, and whether the position is at its edge.
    fn house_at(&self, x: f64, y: f64) -> Option<(String, bool)> {
        let [column, row] = [(x - CORNER[0]) / STEP_M, (y - CORNER[1]) / STEP_M];
        let [column, row] = [column, row].map(|at| (at + CELL_MARGIN).floor().max(0.0) as usize);
        let number = row * HOUSES_PER_SIDE + column;
        let name = format!("house-{number}");
        let ring = &self.houses["CityObjects"][&name]["geometry"][0]["boundaries"][0][0][0];
        let corner = |at: usize| {
            let vertex = &self.houses["vertices"][ring[at].as_u64()? as usize];
            Some([vertex[0].as_f64()? * 0.001 + CORNER[0], vertex[1].as_f64()? * 0.001 + CORNER[1]])
        };
        let corners: Option<Vec<[f64; 2]>> = (0..4).map(corner).collect();
        let corners = corners?;
        let inside = |margin: f64| {
            (0..2).all(|axis| {
                let [low, high] = corners
                    .iter()
                    .fold([f64::MAX, f64::MIN], |[low, high], corner| [low.min(corner[axis]), high.max(corner[axis])]);
                let at = [x, y][axis];
                at > low - margin && at < high + margin
            })
        };
        inside(EDGE_M).then(|| (name, !inside(-EDGE_M)))
    }
}

fn element() -> String {
    CityPage::element(0)
}

/// Clicks a place, and returns the details of the `pick` event.
fn pick(page: &CityPage, at: [f64; 2]) -> Result<Value> {
    page.page.evaluate(&format!("delete {}.insulaSeen.pick", element()))?;
    page.page.click(at, 1)?;
    page.page.wait_for(&format!("{}.insulaSeen.pick", element()), REACTION)?;
    Ok(page.last_event(0, "pick")?["detail"].clone())
}

/// Whether clicks select nothing, so that no panel covers most of so small a page.
fn prevent_selection(page: &CityPage, is_prevented: bool) -> Result<()> {
    let change = if is_prevented { "addEventListener" } else { "removeEventListener" };
    let prevent = "globalThis.prevent ??= event => event.preventDefault()";
    page.page.evaluate(&format!("{}.{change}('pick', {prevent})", element())).map(drop)
}

/// Every click gives the house that stands at its position. Returns one that was met, and where it was clicked.
fn ensure_right_objects(town: &Town, page: &CityPage, size_px: [u32; 2]) -> Result<(Value, [f64; 2])> {
    let mut met = None;
    for share in [[0.5, 0.52], [0.44, 0.47], [0.56, 0.53], [0.47, 0.59], [0.53, 0.44], [0.4, 0.55]] {
        let at = [share[0] * f64::from(size_px[0]), share[1] * f64::from(size_px[1])];
        let picked = pick(page, at)?;
        let [x, y] = [0, 1].map(|k| picked["position"][k].as_f64().unwrap_or(f64::NAN));
        let found = picked["object"]["identifier"].as_str();
        match town.house_at(x, y) {
            Some((_, true)) => {}
            house => ensure!(house.map(|(name, _)| name).as_deref() == found, "{picked}"),
        }
        if found.is_some() {
            met = Some((picked["object"].clone(), at));
        }
    }
    let selected = page.page.evaluate(&format!("{}.selection.length", element()))?;
    ensure!(selected == 0, "a prevented click selects {selected} objects");
    met.filter(|(object, _)| object["id"].is_u64()).context("no click met a house")
}

/// Addresses of the objects that the page has fetched.
fn object_requests(page: &CityPage) -> Result<BTreeSet<String>> {
    let urls = page.page.requests()?.into_iter().map(|request| request.url);
    Ok(urls.filter(|url| url.contains("/objects/")).collect())
}

/// Clicks select objects, outline them, and open the panel with their attributes.
pub(super) fn clicks_show_attributes() -> Result<()> {
    let (town, page) = Town::open(false)?;
    let before = page.picture(0, PICTURE)?;
    ensure!(object_requests(&page)?.is_empty(), "objects are fetched before they are needed");
    prevent_selection(&page, true)?;
    let (object, house) = ensure_right_objects(&town, &page, SIZE_PX)?;
    // The schema when the pointer came, and one block.
    let requests = object_requests(&page)?;
    ensure!(requests.len() == 2, "{requests:?}");
    for url in &requests {
        // One that a service worker passes on is seen twice.
        let request = page.page.ended_request(|request| request.url == *url && request.bytes > 0)?;
        ensure!(request.bytes < 50_000, "{request:?}");
    }
    let (id, name) = (object["id"].as_u64().context("no number")?, object["identifier"].as_str().context("no name")?);
    prevent_selection(&page, false)?;
    pick(&page, house)?;
    let panel = "document.querySelector('.panel:not([hidden]) .objects')";
    page.page.wait_for(&format!("{panel}?.querySelector('h3').textContent === '{name}'"), REACTION)?;
    let number: usize = name.trim_start_matches("house-").parse()?;
    let text = page.page.evaluate(&format!("{panel}.innerText"))?;
    let year = (1600 + 20 * number).to_string();
    ensure!(text.as_str().is_some_and(|text| text.contains("yearOfConstruction") && text.contains(&year)), "{text}");
    let link = page.page.evaluate(&format!("{panel}.querySelector('a').href"))?;
    ensure!(link == "https://example.org/a", "{link}");
    let outlined = page.picture(0, PICTURE)?;
    ensure!(share_of_same(&before, &outlined)? < 1.0, "no outline is drawn");
    keep(&page, "object-panel")?;
    page.page.wait_for(&format!("location.hash.includes('object={id}')"), REACTION)?;
    // The link selects it again.
    let link = page.page.evaluate("location.href")?;
    let other = open_url(link.as_str().context("no link")?)?;
    other.page.wait_for(&format!("{}.selection[0]?.id === {id}", element()), REACTION)?;
    ensure_no_problems(&page)
}

pub(super) fn clicks_meet_the_same_objects_on_a_gpu() -> Result<()> {
    let (town, page) = Town::open(true)?;
    // No mouse has been over it.
    let plain = page.picture(0, GPU_SIZE_PX)?;
    prevent_selection(&page, true)?;
    let (_, house) = ensure_right_objects(&town, &page, GPU_SIZE_PX)?;
    // The object under a resting mouse has an outline until the mouse goes to the sky.
    for (at, is_outlined) in [(house, true), ([house[0], 3.0], false)] {
        page.page.point_at(at)?;
        let begin = Instant::now();
        while (share_of_same(&plain, &page.picture(0, GPU_SIZE_PX)?)? < 1.0) != is_outlined {
            ensure!(begin.elapsed() < FINAL, "outline of the object under the mouse: expected {is_outlined}");
        }
    }
    // The next frame has its own size again.
    page.wait_until_final(0)?;
    ensure_no_problems(&page)
}

/// What is typed is found, selected and approached.
pub(super) fn the_search_finds_objects() -> Result<()> {
    let (_town, page) = Town::open(false)?;
    let first = page.camera(0)?;
    page.page.press("/")?;
    let panel = "document.querySelector('.panel:not([hidden])')";
    page.page.wait_for(&format!("{panel} !== null"), REACTION)?;
    page.page.evaluate(&format!(
        "(input => {{ input.value = 'house-13'; input.dispatchEvent(new Event('input')); }})({panel}.querySelector('input'))"
    ))?;
    let row = format!("[...{panel}.querySelectorAll('.results .row')].find(row => row.textContent === 'house-13')");
    page.page.wait_for(&format!("{row} !== undefined"), REACTION)?;
    page.moves_by("a hit", 0, |page| page.evaluate(&format!("{row}.click()")).map(drop))?;
    page.page.wait_for(&format!("{}.selection[0]?.identifier === 'house-13'", element()), REACTION)?;
    page.wait_until_final(0)?;
    let centre = page.page.evaluate(&format!("{}.selection[0].centre", element()))?;
    let middle = page.page.evaluate(&format!("{e}.pick({e}.clientWidth / 2, {e}.clientHeight / 2)", e = element()))?;
    for k in 0..2 {
        let (a, b) = (centre[k].as_f64().context("no centre")?, middle["position"][k].as_f64().context("no surface")?);
        ensure!((a - b).abs() < STEP_M, "the view's middle {middle} is not at {centre}");
    }
    keep(&page, "object-search")?;
    // The six numbers of a camera lead there, as in the window.
    page.page.evaluate(&format!(
        "(form => {{ form.querySelector('input').value = '{first}'; form.requestSubmit(); }})(document.querySelector('.search-form'))"
    ))?;
    page.wait_for_view(0, &first)?;
    ensure_no_problems(&page)
}

/// Who has never seen the page searches, measures, filters, takes a link and saves a picture, by keys and mouse alone.
pub(super) fn a_stranger_walks_through_the_page() -> Result<()> {
    let (_town, page) = Town::open_at(false, WALK_PX)?;
    let panel = "document.querySelector('.panel:not([hidden])')";
    let shows = |expression: &str| page.page.wait_for(expression, REACTION);
    let write = |text: &str| text.chars().try_for_each(|letter| page.page.press(&letter.to_string()));
    let click_on = |selector: &str| -> Result<()> {
        shows(IS_LAID_OUT)?;
        let middle = page.page.evaluate(&format!(
            "(box => [box.x + box.width / 2, box.y + box.height / 2])({panel}.querySelector('{selector}').getBoundingClientRect())"
        ))?;
        page.page.click([0, 1].map(|k| middle[k].as_f64().unwrap_or_default()), 1)
    };
    page.page.press("/")?;
    shows(&format!("{panel}?.querySelector('input') === document.activeElement"))?;
    write("house-13")?;
    shows(&format!("{panel}.querySelector('.results .row') !== null"))?;
    page.moves_by("the best hit", 0, |page| page.press("Enter"))?;
    shows(&format!("{}.selection[0]?.identifier === 'house-13'", element()))?;
    page.wait_until_final(0)?;
    page.page.press("Escape")?;
    shows(&format!("{panel} === null"))?;
    // The house is in the middle, and stays there while the view turns.
    page.page.press("m")?;
    shows(&format!("{panel}?.querySelector('.result') !== null"))?;
    page.page.click(WALK_MIDDLE, 1)?;
    page.moves_by("a drag", 0, |page| page.drag(Button::Left, [300.0, 400.0], [360.0, 400.0]))?;
    page.page.click(WALK_MIDDLE, 1)?;
    shows(&format!("/m long, .* horizontally, .* up$/.test({panel}.querySelector('.result').textContent)"))?;
    keep(&page, "walk-measure")?;
    page.page.press("g")?;
    shows(&format!("{panel}?.querySelector('select option:nth-child(2)') !== null"))?;
    click_on("input[placeholder]")?;
    write("height > 1")?;
    page.page.press("Enter")?;
    shows(&format!("{panel}.textContent.includes('16 objects pass')"))?;
    page.page.press("Escape")?;
    page.page.press("c")?;
    shows(&format!("{panel}?.querySelector('input').value.includes('camera=')"))?;
    page.page.press("Escape")?;
    page.page.press("p")?;
    shows(&format!("{panel}?.querySelector('button.primary .icon-picture') !== null"))?;
    click_on("button.primary")?;
    page.page.wait_for(&format!("{panel}.textContent.includes('Picture saved')"), FINAL)?;
    keep(&page, "walk-picture")?;
    ensure_no_problems(&page)
}

/// Colours and filters are those of the native client, have a legend, and fetch no tile.
pub(super) fn colours_have_a_legend() -> Result<()> {
    let (town, page) = Town::open(false)?;
    let tiles = |page: &CityPage| -> Result<usize> {
        let is_tile = |url: &str| url.contains("/blockmaps/") || url.contains("/meshes/") || url.contains("/subtrees/");
        Ok(page.page.requests()?.iter().filter(|request| is_tile(&request.url)).count())
    };
    page.restart_with(0, &[("time", "2024-06-21T14:00")])?;
    page.wait_until_final(0)?;
    let before = tiles(&page)?;
    ensure!(before > 0, "no request of a tile was seen");
    let rules = json!({ "attribute": "yearOfConstruction", "filter": "yearOfConstruction < 1800", "others": "hide" });
    let made = page.page.evaluate(&format!("{}.setColors({rules})", element()))?;
    ensure!(made["passing"] == 10 && made["legend"]["title"] == "yearOfConstruction", "{made}");
    let drawn = page.picture(0, SIZE_PX)?;
    ensure!(tiles(&page)? == before, "a change of colours fetched tiles");
    let camera = page.camera(0)?;
    let city = page.page.evaluate(&format!("{}.manifest.name", element()))?;
    let city = city.as_str().context("no name")?.to_owned();
    let view = SharedView { server: town.server.address, city, camera, size_px: SIZE_PX };
    let options = ["--color-by", "yearOfConstruction", "--filter", "yearOfConstruction < 1800", "--others", "hide"];
    let folder = tempfile::tempdir()?;
    let expected = native_with(&view, folder.path(), &options)?;
    let same = share_of_same(&expected, &drawn)?;
    println!("{:.3}% of the pixels are the native client's", same * 100.0);
    ensure!(same >= SAME, "only {:.3}% of the pixels are the native client's", same * 100.0);
    let legend = page.page.evaluate("document.querySelector('.legend:not([hidden])')?.innerText ?? ''")?;
    ensure!(
        legend.as_str().is_some_and(|text| text.contains("yearOfConstruction") && text.contains("1600")),
        "{legend}"
    );
    page.page.press("g")?;
    page.page
        .wait_for("document.querySelector('.panel:not([hidden]) select option:nth-child(3)') !== null", REACTION)?;
    keep(&page, "object-colours")?;
    let refused = page.page.evaluate(&format!(
        "{}.setColors({{ attribute: 'yearOfConstructio' }}).then(() => '', error => error.message)",
        element()
    ))?;
    ensure!(refused.as_str().is_some_and(|text| text.contains("yearOfConstruction?")), "{refused}");
    let fault = page.page.evaluate(&format!(
        "{}.setColors({{ filter: 'yearOfConstructio > 1' }}).then(() => null, error => error.fault)",
        element()
    ))?;
    ensure!(fault["code"] == "name" && fault["at"] == 1, "{fault}");
    // The server evaluates a filter without colours.
    let before = object_requests(&page)?.len();
    let made = page.page.evaluate(&format!("{}.setColors({{ filter: 'yearOfConstruction >= 1800' }})", element()))?;
    ensure!(made["passing"] == 6 && made["legend"].is_null(), "{made}");
    page.page.ended_request(|request| request.url.contains("/filter?expr=")).context("no filter was requested")?;
    ensure!(object_requests(&page)?.len() == before, "blocks were fetched for a filter");
    page.page.evaluate(&format!("{}.setColors({{ filter: 'yearOfConstruction > 9000' }})", element()))?;
    page.page.wait_for("document.body.textContent.includes('No object passes, so nothing changes')", REACTION)?;
    page.page.evaluate(&format!("{}.setColors(null)", element()))?;
    page.page.wait_for("document.querySelector('.legend').hidden", REACTION)?;
    ensure_no_problems(&page)
}

/// CesiumJS draws the tileset that the server offers, and a click finds a house. `INSULA_CESIUM` names a folder with `Cesium.js`.
pub(super) fn cesium_draws_the_tileset() -> Result<()> {
    let cesium = std::env::var_os("INSULA_CESIUM").context("INSULA_CESIUM is not set")?;
    let (town, page) = Town::open(false)?;
    let city = page.page.evaluate(&format!("{}.manifest.name", element()))?;
    let city = city.as_str().context("no name")?;
    let folder = tempfile::tempdir()?;
    let pictures = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("browser").join("cesium");
    let views = folder.path().join("views.json");
    std::fs::write(&views, json!([["town", [-110, -110, 90], [0, 0, 5]]]).to_string())?;
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/cesium.py");
    let address = format!("http://{}{}", town.server.address, insula_protocol::route::tileset(city));
    let mut command = Command::new("python3");
    command
        .arg(script)
        .arg(&address)
        .arg("--cesium")
        .arg(&cesium)
        .arg("--views")
        .arg(&views)
        .arg("--out")
        .arg(&pictures);
    let output = run(&mut command)?;
    let text = String::from_utf8_lossy(&output.stdout);
    ensure!(output.status.success() && text.contains("'identifier': 'house-"), "{text}");
    let drawn = image::open(pictures.join("town.png"))?.to_rgb8();
    ensure!(colours(&drawn) >= FEWEST_COLOURS, "CesiumJS draws nothing");
    Ok(())
}

/// A plain host has no search: the page reads the index, and takes the normal forms of Unicode from the browser.
pub(super) fn a_plain_host_is_searched_in_the_page() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let mut houses = fixtures::city_json(2);
    let objects = houses["CityObjects"].as_object_mut().context("no objects")?;
    let house = objects.remove("house-3").context("no house")?;
    objects.insert("Élysée ﬁn".into(), house);
    let input = folder.path().join("town.city.json");
    std::fs::write(&input, houses.to_string())?;
    let city = fixtures::baked("plain-town", &BakeOptions { inputs: vec![input], ..BakeOptions::default() })?;
    let mut command = Command::new(program("insula-server")?);
    let output = run(command.arg("publish").arg(&city).arg("--out").arg(folder.path().join("site")))?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let host = FaultyHost::start(folder.path());
    let page = open_url(&format!("{}/site/", host.url()))?;
    for (text, found) in [("elysee fin", 1), ("ÉLYSÉE", 1), ("house", 3), ("rathaus", 0)] {
        let hits = page.page.evaluate(&format!("{}.search('{text}')", element()))?;
        ensure!(hits.as_array().map(Vec::len) == Some(found), "{text}: {hits}");
    }
    let made = page.page.evaluate(&format!("{}.setColors({{ filter: 'height > 0' }})", element()))?;
    ensure!(made["passing"] == 4, "{made}");
    ensure_no_problems(&page)
}
