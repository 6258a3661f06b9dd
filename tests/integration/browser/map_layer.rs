//! The city as a layer of a MapLibre map: the same picture and distances as the native client's, houses that hide what stands behind
//! them, and a lost context; and the same in a scene of three.js. `INSULA_VENDOR` names the folder with both, as for the examples.

use super::browser;
use super::component::ExampleSite;
use super::viewer::{CITY_COLOURS, REACTION};
use anyhow::{Context, Result, ensure};
use image::{Rgb, RgbImage};
use insula_tests::browser::city_page::{FINAL, colours};
use insula_tests::browser::same_picture::{SharedView, TIME, native_with, share_of_same};
use insula_tests::browser::{Page, PageOptions};
use insula_tests::fixtures;
use insula_tests::pfm::Pfm;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// The map is as wide as the page, without its margins.
const PAGE: PageOptions = PageOptions { size: [640, 640], dark: false, touch: false };
/// The background of the map. No house has it.
const NOTHING: Rgb<u8> = Rgb([255, 0, 255]);
/// Smallest share of the covered pixels that are the native client's: the rest are edges.
const SAME: f64 = 0.99;

/// What the tests do in the page.
const TOOLS: &str = r"(() => {
const idle = async () => {
    await new Promise(done => { map.once('idle', done); map.triggerRepaint(); });
    return layer.isFinal;
};
const show = (id, features) => { map.getSource(id).setData({ type: 'FeatureCollection', features }); };
const { grid, manifest } = layer.caster;
const ground = manifest.ground_z_m;
const degrees = ([x, y]) => grid.toLonLat([x, y]);
const eye = () => layer.caster.frame.camera.split(',').slice(0, 3).map(Number);
// On the ray to a hit, so many metres beyond it along the ground.
const beyond = ({ position }, metres) => {
    const from = eye(), flat = Math.hypot(position[0] - from[0], position[1] - from[1]);
    return from.map((value, i) => value + (position[i] - value) * (1 + metres / flat));
};
const box = ([x, y, z], size, height = z - ground) => {
    const ring = [[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]].map(([u, v]) => degrees([x + u * size, y + v * size]));
    return { type: 'Feature', properties: { height }, geometry: { type: 'Polygon', coordinates: [ring] } };
};
const place = (position, id) => ({ type: 'Feature', id, properties: {}, geometry: { type: 'Point', coordinates: degrees(position) } });
// The first pixel of a grid whose hit is one of those that are looked for.
const find = async isIt => {
    const { clientWidth: w, clientHeight: h } = map.getCanvas();
    for (let y = 0.3; y < 0.9; y += 0.04) for (let x = 0.2; x < 0.8; x += 0.04) {
        const [column, row] = [Math.round(x * w), Math.round(y * h)];
        const hit = await layer.pick({ x: column + 0.5, y: row + 0.5 });
        if (hit && isIt(hit.height - ground)) return { ...hit, column, row };
    }
    throw new Error('no such place');
};
globalThis.tools = { idle, show, ground, beyond, box, place, find };
})()";

struct MapPage {
    page: Page,
    site: ExampleSite,
}

impl MapPage {
    fn open() -> Result<Self> {
        let (site, browser) = (ExampleSite::start()?, browser(false)?);
        let page = browser.open_page(PAGE)?;
        page.navigate(&format!("{}&time={TIME}", site.url("maplibre-layer")))?;
        let map = Self { page, site };
        map.wait_until_final()?;
        map.page.evaluate(TOOLS)?;
        map.page.evaluate("void map.setPaintProperty('background', 'background-color', '#ff00ff')")?;
        for source in ["boxes", "lines", "places"] {
            map.show(source, "[]")?;
        }
        Ok(map)
    }

    fn wait_until_final(&self) -> Result<()> {
        self.page.wait_for("layer.isFinal && map.loaded()", FINAL)
    }

    fn show(&self, source: &str, features: &str) -> Result<()> {
        self.page.evaluate(&format!("(async () => tools.show('{source}', {features}))()"))?;
        self.page.wait_for("tools.idle()", REACTION)
    }

    /// What the map has drawn.
    fn picture(&self) -> Result<RgbImage> {
        let take =
            "new Promise(done => { map.once('render', () => map.getCanvas().toBlob(done)); map.triggerRepaint(); })";
        Ok(image::load_from_memory(&self.page.blob(take)?)?.to_rgb8())
    }

    fn keep(&self, name: &str) -> Result<RgbImage> {
        let picture = self.picture()?;
        picture.save(kept(name)?)?;
        Ok(picture)
    }

    /// A place of the map whose surface is at a height above the ground, and keeps it for scripts under a name.
    fn find(&self, name: &str, condition: &str) -> Result<[u32; 2]> {
        let at = self.page.evaluate(&format!(
            "tools.find(height => {condition}).then(hit => (globalThis.{name} = hit, [hit.column, hit.row]))"
        ))?;
        pixel(&at)
    }
}

fn is_covered(pixel: &Rgb<u8>) -> bool {
    *pixel != NOTHING
}

/// Of boxes and pins: houses are never so colourful.
fn is_red(&Rgb([r, g, b]): &Rgb<u8>) -> bool {
    r > 100 && g < r / 2 && b < r / 2
}

fn is_violet(&Rgb([r, g, b]): &Rgb<u8>) -> bool {
    b > 150 && g < b / 2 && r > g
}

/// Picture and distances are those of `insula snapshot` with the same camera.
pub(super) fn a_map_has_the_native_picture() -> Result<()> {
    let (map, folder) = (MapPage::open()?, tempfile::tempdir()?);
    let drawn = map.keep("map-layer")?;
    let frame = map.page.evaluate("(({ camera, width, height, distances }) => ({ camera, width, height, distances: [...distances].map(d => isFinite(d) ? d : -1) }))(layer.caster.frame)")?;
    let size_px = [&frame["width"], &frame["height"]].map(|side| side.as_u64().unwrap_or_default() as u32);
    ensure!(size_px == [drawn.width(), drawn.height()], "a cast of {size_px:?} pixels");
    let camera = frame["camera"].as_str().context("no camera")?.to_owned();
    let view = SharedView { server: map.site.server.address, city: "chiba".into(), camera, size_px };
    let distances = folder.path().join("native.pfm");
    let expected = native_with(&view, folder.path(), &["--distance", distances.to_str().context("no path")?])?;
    let covered = drawn.pixels().filter(|pixel| is_covered(pixel)).count();
    ensure!(covered * 4 > drawn.pixels().len(), "{covered} pixels of the city");
    let beside =
        |(x, y): (u32, u32)| if is_covered(drawn.get_pixel(x, y)) { *expected.get_pixel(x, y) } else { NOTHING };
    let expected = RgbImage::from_fn(size_px[0], size_px[1], |x, y| beside((x, y)));
    let other = (1.0 - share_of_same(&expected, &drawn)?) * f64::from(size_px[0] * size_px[1]) / covered as f64;
    // A cell is what a distance may differ by.
    let cell_m = manifest_cell_m()?;
    let native = Pfm::read(&distances)?.values;
    let found: Vec<f32> = serde_json::from_value(frame["distances"].clone())?;
    let is_near = |(a, b): &(&f32, &f32)| if **b < 0.0 { a.is_infinite() } else { (**a - **b).abs() <= cell_m };
    let near = native.iter().zip(&found).filter(is_near).count() as f64 / native.len() as f64;
    println!("{covered} pixels, {:.3}% other colours, {:.3}% the same distances", other * 100.0, near * 100.0);
    ensure!(other <= 1.0 - SAME && near >= SAME, "{other} of the colours differ, {near} of the distances are the same");
    ensure!(map.page.problems()?.is_empty(), "{:?}", map.page.problems()?);
    Ok(())
}

fn manifest_cell_m() -> Result<f32> {
    let manifest: Value = serde_json::from_slice(&std::fs::read(fixtures::baked_chiba()?.join("city.json"))?)?;
    Ok(manifest["cell_m"].as_f64().context("no cell")? as f32)
}

/// A box before a house hides it, and one behind it is hidden; so are labels.
pub(super) fn houses_hide_boxes_and_labels_of_a_map() -> Result<()> {
    let map = MapPage::open()?;
    let [x, y] = map.find("house", "height > 12")?;
    map.show("boxes", "[tools.box(tools.beyond(house, -30), 5, tools.beyond(house, -30)[2] - tools.ground + 5)]")?;
    let before = map.keep("map-layer-box-before")?;
    ensure!(is_red(before.get_pixel(x, y)), "{:?}: the box is not before the house", before.get_pixel(x, y));
    map.show("boxes", "[tools.box(tools.beyond(house, 10), 5, house.height - tools.ground - 1)]")?;
    let behind = map.keep("map-layer-box-behind")?;
    ensure!(!is_red(behind.get_pixel(x, y)), "the box is before the house");
    let visibility =
        |value: &str| map.page.evaluate(&format!("void map.setLayoutProperty('insula', 'visibility', '{value}')"));
    visibility("none")?;
    let alone = map.picture()?;
    ensure!(is_red(alone.get_pixel(x, y)), "without the city, the box is not there");
    visibility("visible")?;
    map.show("boxes", "[]")?;
    // Where the ray through the house meets the ground, and where nothing is on the way.
    let [free_x, free_y] = map.find("street", "Math.abs(height) < 0.5")?;
    map.show(
        "places",
        "[tools.place(tools.beyond(house, (house.height - tools.ground) / (layer.caster.frame.camera.split(',')[2] - house.height)
            * Math.hypot(...[0, 1].map(i => house.position[i] - layer.caster.frame.camera.split(',')[i]))), 1), tools.place(street.position, 2)]",
    )?;
    let is_hidden = |id: u32| format!("map.getFeatureState({{ source: 'places', id: {id} }}).insulaHidden === true");
    map.page.wait_for(&is_hidden(1), REACTION)?;
    map.page.wait_for("tools.idle()", REACTION)?;
    let labels = map.keep("map-layer-labels")?;
    ensure!(is_violet(labels.get_pixel(free_x, free_y)), "{:?}: no label", labels.get_pixel(free_x, free_y));
    ensure!(!is_violet(labels.get_pixel(x, y)), "the label is before the house");
    ensure!(map.page.evaluate(&is_hidden(2))? == false);
    ensure!(map.page.problems()?.is_empty(), "{:?}", map.page.problems()?);
    Ok(())
}

/// While a map moves, its last cast moves along: the picture is like that of a new cast.
pub(super) fn a_moving_map_takes_its_last_cast_along() -> Result<()> {
    let map = MapPage::open()?;
    let before = map.picture()?;
    map.page.evaluate(
        "layer.caster.cast = () => {}; void map.jumpTo({ bearing: map.getBearing() + 6, zoom: map.getZoom() + 0.1 })",
    )?;
    let moved = map.keep("map-layer-moved")?;
    map.page.evaluate("delete layer.caster.cast; map.triggerRepaint()")?;
    map.page.wait_for("tools.idle()", FINAL)?;
    let expected = map.keep("map-layer-moved-to")?;
    let [moved, before] = [like(&expected, &moved), like(&expected, &before)];
    println!("{moved:.3} of the picture is there at once, {before:.3} of it was before");
    ensure!(
        moved > 0.75 && moved > before + 0.15,
        "{moved} of the picture is there at once, {before} of it was before"
    );
    Ok(())
}

/// Share of pixels of about the same colours.
fn like(a: &RgbImage, b: &RgbImage) -> f64 {
    let is_like = |(a, b): &(&Rgb<u8>, &Rgb<u8>)| a.0.iter().zip(b.0).all(|(a, b)| a.abs_diff(b) < 24);
    a.pixels().zip(b.pixels()).filter(is_like).count() as f64 / a.pixels().len() as f64
}

/// A lost context comes back with the layer, and a globe is told to have none.
pub(super) fn a_map_survives_a_lost_context() -> Result<()> {
    let map = MapPage::open()?;
    let covered = |picture: &RgbImage| picture.pixels().filter(|pixel| is_covered(pixel)).count();
    let before = covered(&map.picture()?);
    map.page.evaluate(
        "(lost => { lost.loseContext(); setTimeout(() => lost.restoreContext(), 100); })
            (map.getCanvas().getContext('webgl2').getExtension('WEBGL_lose_context'))",
    )?;
    map.page.wait_for_message("console", "context")?;
    map.page.wait_for("map.getLayer('insula') && layer.isFinal && map.loaded()", FINAL)?;
    let after = covered(&map.keep("map-layer-restored")?);
    ensure!(before.abs_diff(after) * 100 < before, "{before} pixels of the city, {after} after the loss");
    map.page.evaluate("map.setProjection({ type: 'globe' }); void map.jumpTo({ zoom: 4 })")?;
    map.page.wait_for_message("console", "globe")
}

/// A house of the scene: where its pixel is, and places before and behind its surface there.
const FIND_HOUSE: &str = r"(async () => {
    const { manifest } = city.caster, [low, high] = manifest.focus, { width, height } = renderer.domElement;
    const origin = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, manifest.ground_z_m];
    for (let y = 0.4; y > -0.8; y -= 0.07) for (let x = -0.6; x < 0.6; x += 0.07) {
        const hit = await city.pick({ x, y });
        if (!hit || hit.height - manifest.ground_z_m < 15) continue;
        const at = city.localToWorld(new city.position.constructor(...hit.position.map((value, i) => value - origin[i])));
        const away = at.clone().sub(camera.position).normalize();
        globalThis.house = { before: at.clone().addScaledVector(away, -10), behind: at.clone().addScaledVector(away, 10) };
        return [Math.floor((1 + x) / 2 * width), Math.floor((1 - y) / 2 * height)];
    }
    throw new Error('no house');
})()";

/// In a scene, too: a ball before a house is seen, and one behind its surface is not.
pub(super) fn a_scene_has_the_city_in_it() -> Result<()> {
    let (site, browser) = (ExampleSite::start()?, browser(false)?);
    let page = browser.open_page(PAGE)?;
    page.navigate(&site.url("three"))?;
    page.wait_for("city.caster.frame?.isFinal", FINAL)?;
    let [x, y] = pixel(&page.evaluate(FIND_HOUSE)?)?;
    let picture = |place: &str| -> Result<RgbImage> {
        // Of three metres. The picture is taken in the task that draws it.
        let script = format!("ball.scale.setScalar(0.1), ball.position.copy(house.{place}), draw()");
        let take = format!("new Promise(done => {{ {script}; renderer.domElement.toBlob(done); }})");
        let picture = image::load_from_memory(&page.blob(&take)?)?.to_rgb8();
        picture.save(kept(&format!("scene-{place}"))?)?;
        Ok(picture)
    };
    let before = picture("before")?;
    ensure!(is_red(before.get_pixel(x, y)), "{:?}: the ball is not before the house", before.get_pixel(x, y));
    ensure!(colours(&before) >= CITY_COLOURS, "{} colours", colours(&before));
    let behind = picture("behind")?;
    ensure!(!is_red(behind.get_pixel(x, y)), "the ball is before the house");
    ensure!(page.problems()?.is_empty(), "{:?}", page.problems()?);
    Ok(())
}

/// Where a picture is kept for people.
fn kept(name: &str) -> Result<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("browser");
    std::fs::create_dir_all(&folder)?;
    Ok(folder.join(format!("{name}.png")))
}

/// A pixel that a script has found.
fn pixel(at: &Value) -> Result<[u32; 2]> {
    let number = |value: &Value| value.as_u64().map(|number| number as u32).context("no place");
    Ok([number(&at[0])?, number(&at[1])?])
}
