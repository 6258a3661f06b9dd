//! The viewer in a browser: a real server, headless Chromium, and pictures of what a user sees.
//!
//! Screenshots stay in `target/browser`. Without Chromium (`INSULA_CHROMIUM`, or on the path), all tests are reported as
//! ignored; without the viewer's files in the server, those of the viewer; unless `INSULA_REQUIRE_BROWSER=1`. All share one
//! browser, and those of WebGPU another: each page is apart from the others. They run one after another, because a page beside
//! others is slow.

mod analysis;
mod component;
mod controls;
mod driver;
mod map_layer;
mod objects;
mod pictures;
mod site;
mod versions;
mod viewer;

use anyhow::{Context, Result, ensure};
use insula_bake::{BakeOptions, GroundOption};
use insula_tests::browser::city_page::CityPage;
use insula_tests::browser::{Browser, Button, PageOptions};
use insula_tests::fixtures;
use insula_tests::programs::{ServerProcess, program, run};
use insula_tests::trials::{Test, Trials, Turn};
use serde_json::json;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::{Arc, Mutex, PoisonError};
use viewer::{
    DESKTOP, FREE, PHONE, PICTURE, REACTION, ensure_city_is_visible, ensure_no_problems, ensure_same_view, keep,
    near_camera, open, open_url, serve, url,
};

static BROWSER: Turn = Turn::new();
/// Without and with a GPU.
static SHARED: Mutex<[Option<Arc<Browser>>; 2]> = Mutex::new([None, None]);

type Run = fn() -> Result<()>;

const VENDOR: &str = "INSULA_VENDOR";
const MAPLIBRE: &str = "maplibre-gl.mjs";

const QUICK_DRIVER: [(&str, Run); 1] = [("driver_collects_errors", driver::errors_are_collected)];

const DRIVER: [(&str, Run); 3] = [
    ("driver_runs_scripts_and_takes_pictures", driver::scripts_and_pictures),
    ("driver_gives_input", driver::input_arrives),
    ("driver_emulates_networks", driver::networks_are_emulated),
];

/// A test of each part of the page.
const QUICK: [(&str, Run); 17] = [
    ("the_page_shows_the_city_on_a_phone", viewer::phones_show_the_city),
    ("a_page_without_scripts_lists_the_city", viewer::a_page_without_scripts_lists_the_city),
    ("keys_and_mouse_move_the_camera", viewer::keys_and_mouse_move_the_camera),
    ("a_link_opens_its_view", viewer::a_link_opens_its_view),
    ("hostile_names_are_text", viewer::hostile_names_are_text),
    ("the_cpu_draws_the_native_picture", pictures::the_cpu_draws_the_native_picture),
    ("webgpu_draws_the_native_picture", pictures::webgpu_draws_the_native_picture),
    ("clicks_show_attributes", objects::clicks_show_attributes),
    ("the_search_finds_objects", objects::the_search_finds_objects),
    ("the_server_analyses_what_is_in_view", analysis::the_server_analyses_what_is_in_view),
    ("a_proposal_is_shown_before_and_after", a_proposal_is_shown_before_and_after),
    ("a_restarted_server_is_found_again", a_restarted_server_is_found_again),
    ("an_offline_page_keeps_its_picture", an_offline_page_keeps_its_picture),
    ("panels_cover_nothing_on_a_phone", controls::panels_cover_nothing_on_a_phone),
    ("the_page_speaks_german", controls::the_page_speaks_german),
    ("an_article_keeps_its_wheel", component::an_article_keeps_its_wheel),
    ("a_published_site_needs_no_server_of_ours", site::a_published_site_works),
];

const FULL: [(&str, Run); 30] = [
    ("the_page_shows_the_city_on_a_dark_phone", viewer::dark_phones_show_the_city),
    ("the_page_shows_the_city_on_a_desktop", viewer::desktops_show_the_city),
    ("the_page_shows_the_city_on_a_dark_desktop", viewer::dark_desktops_show_the_city),
    ("the_page_of_a_single_city_is_the_root", viewer::a_single_city_is_the_root),
    ("panels_cover_nothing_on_smaller_screens", controls::panels_cover_nothing_on_smaller_screens),
    ("panels_cover_nothing_on_larger_screens", controls::panels_cover_nothing_on_larger_screens),
    ("chosen_days_are_those_they_name", controls::chosen_days_are_those_they_name),
    ("a_server_without_analyses_offers_none", analysis::a_server_without_analyses_offers_none),
    ("a_result_leaves_a_phone_free", analysis::a_result_leaves_a_phone_free),
    ("a_slider_switches_between_versions", versions::a_slider_switches_between_versions),
    ("a_server_that_starts_late_is_found", component::a_server_that_starts_late_is_found),
    ("touch_moves_the_camera", viewer::touch_moves_the_camera),
    ("a_click_picks_a_point_of_the_city", viewer::a_click_picks_a_point),
    ("two_viewers_share_a_page", viewer::two_viewers_share_a_page),
    ("the_cpu_draws_other_native_pictures", pictures::the_cpu_draws_other_native_pictures),
    ("webgpu_draws_another_native_picture", pictures::webgpu_draws_another_native_picture),
    ("pictures_have_their_own_sizes", pictures::pictures_have_their_own_sizes),
    ("a_lost_device_falls_back_to_the_cpu", pictures::a_lost_device_falls_back),
    ("a_page_without_shaders_stays_on_the_cpu", pictures::a_page_without_shaders_stays_on_the_cpu),
    ("a_visited_city_works_offline", site::a_visited_city_works_offline),
    ("a_bad_host_is_survived", site::a_bad_host_is_survived),
    ("damaged_bytes_are_fetched_again", site::damaged_bytes_are_fetched_again),
    ("the_plain_example_runs", component::the_plain_example_runs),
    ("a_page_with_trusted_types_shows_the_city", component::a_page_with_trusted_types_shows_the_city),
    ("the_geojson_example_runs", component::the_geojson_example_runs),
    ("a_stranger_walks_through_the_page", objects::a_stranger_walks_through_the_page),
    ("markers_are_occluded", component::markers_are_occluded),
    ("clicks_meet_the_same_objects_on_a_gpu", objects::clicks_meet_the_same_objects_on_a_gpu),
    ("colours_have_a_legend", objects::colours_have_a_legend),
    ("a_plain_host_is_searched_in_the_page", objects::a_plain_host_is_searched_in_the_page),
];

/// Tests that need files of others, the variable that names their folder or file, and one of those in the folder.
const WITH_FILES: [(&str, Run, &str, &str); 9] = [
    ("the_react_example_runs", component::the_react_example_runs, VENDOR, "react.production.min.js"),
    ("the_maplibre_example_runs", component::the_maplibre_example_runs, VENDOR, MAPLIBRE),
    ("a_map_has_the_native_picture", map_layer::a_map_has_the_native_picture, VENDOR, MAPLIBRE),
    ("houses_hide_boxes_and_labels_of_a_map", map_layer::houses_hide_boxes_and_labels_of_a_map, VENDOR, MAPLIBRE),
    ("a_moving_map_takes_its_last_cast_along", map_layer::a_moving_map_takes_its_last_cast_along, VENDOR, MAPLIBRE),
    ("a_map_survives_a_lost_context", map_layer::a_map_survives_a_lost_context, VENDOR, MAPLIBRE),
    ("a_scene_has_the_city_in_it", map_layer::a_scene_has_the_city_in_it, VENDOR, "three.module.js"),
    ("axe_finds_nothing_serious", axe_finds_nothing_serious, "INSULA_AXE", ""),
    ("cesium_draws_the_tileset", objects::cesium_draws_the_tileset, "INSULA_CESIUM", ""),
];

pub(crate) fn add(trials: &mut Trials) {
    let has_browser = Browser::find().is_some();
    let has_viewer = has_browser && is_viewer_built();
    if !has_browser {
        eprintln!("no test of the browser can run: no Chromium");
    } else if !has_viewer {
        eprintln!("no test of the viewer can run: client/web/build comes before the server's build");
    }
    let is_required = std::env::var("INSULA_REQUIRE_BROWSER").is_ok_and(|value| value == "1");
    let test = |(name, run): (&str, Run), can_run: bool| {
        // A browser in which a test failed may be broken.
        let run = move || run().inspect_err(|_| close());
        Test::new(name, run).ignored_if(!can_run && !is_required).in_turn(&BROWSER)
    };
    trials.add(QUICK_DRIVER.map(|run| test(run, has_browser)));
    trials.add(DRIVER.map(|run| test(run, has_browser).full_tier()));
    trials.add(QUICK.map(|run| test(run, has_viewer)));
    trials.add(FULL.map(|run| test(run, has_viewer).full_tier()));
    trials.add(WITH_FILES.map(|(name, run, variable, file)| {
        let has_files =
            std::env::var_os(variable).is_some_and(|at| file.is_empty() || Path::new(&at).join(file).exists());
        test((name, run), has_viewer).ignored_if(!has_files).full_tier()
    }));
}

/// Ends the browsers.
pub(crate) fn close() {
    *SHARED.lock().unwrap_or_else(PoisonError::into_inner) = [None, None];
}

/// The browser of all tests, without or with a GPU. Starts it at its first use, and again if it does not answer.
fn browser(gpu: bool) -> Result<Arc<Browser>> {
    let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
    let slot = &mut shared[usize::from(gpu)];
    if let Some(browser) = slot.as_ref().filter(|browser| browser.answers()) {
        return Ok(browser.clone());
    }
    // The old one ends first.
    *slot = None;
    Ok(slot.insert(Arc::new(Browser::launch(gpu)?)).clone())
}

/// Whether the built server has a viewer. One without it says so before it looks for the city.
fn is_viewer_built() -> bool {
    let publish = || -> Result<_> {
        run(Command::new(program("insula-server")?).args(["publish", "no-such-city", "--out", "no-such-site"]))
    };
    publish().is_ok_and(|output| !String::from_utf8_lossy(&output.stderr).contains("has no viewer"))
}

/// In both appearances, and on a phone.
fn axe_finds_nothing_serious() -> Result<()> {
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

fn a_restarted_server_is_found_again() -> Result<()> {
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

fn an_offline_page_keeps_its_picture() -> Result<()> {
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

const OPTIONS: PageOptions = PageOptions { size: [1024, 600], dark: false, touch: false };
const SIZE: [u32; 2] = [240, 160];
const NAME: &str = "proposed-town";

/// A place of the page that shows what the proposal adds; `null` if there is none.
const FIND_ADDED: &str = "(async () => {
    const city = document.querySelector('insula-city');
    for (let y = 0.2; y < 0.8; y += 0.02) for (let x = 0.2; x < 0.7; x += 0.02) {
        const object = await city.ask('objectAt', { x, y });
        if (object >= 0xffff0000) return [x * innerWidth, y * innerHeight];
    }
    return null;
})()";

/// Whether the panel's line says this.
fn says(text: &str) -> String {
    format!("[...document.querySelectorAll('.hint')].some(line => line.textContent === '{text}')")
}

fn a_proposal_is_shown_before_and_after() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let input = fixtures::write_city_json(folder.path(), 4)?;
    let city = fixtures::baked(
        NAME,
        &BakeOptions { inputs: vec![input], ground: GroundOption::Auto, ..BakeOptions::default() },
    )?;
    // Between the houses.
    let ring = [[84_068, 447_028], [84_078, 447_028], [84_078, 447_038], [84_068, 447_038], [84_068, 447_028]];
    let proposals = folder.path().join("proposals");
    fs::create_dir_all(proposals.join(NAME))?;
    let polygon = json!({ "type": "Polygon", "coordinates": [ring] });
    fs::write(proposals.join(NAME).join("tower.geojson"), polygon.to_string())?;
    let plan =
        "title = \"Tower\"\n[[add]]\noutline = \"tower.geojson\"\nheight_m = 90\n[[remove]]\nids = [\"house-5\"]\n";
    fs::write(proposals.join(NAME).join("tower.toml"), plan)?;

    let mut command = Command::new(program("insula-server")?);
    let setting = format!("site.proposals={}", proposals.display());
    let server = ServerProcess::start(&mut command, &city, "127.0.0.1:0", &[&setting])?;
    let address = format!("http://{}/?proposal=tower", server.address);
    let page = CityPage::open(browser(false)?.as_ref(), OPTIONS, &address)?;
    page.wait_until_ready(0)?;
    page.page.wait_for(&says("Tower: after"), REACTION)?;
    let after = page.picture(0, SIZE)?;
    keep(&page, "proposal-after")?;
    page.page.press("y")?;
    page.page.wait_for(&says("Tower: before"), REACTION)?;
    let before = page.picture(0, SIZE)?;
    ensure!(before != after, "the city before is that after");
    page.page.press("y")?;
    page.page.wait_for(&says("Tower: after"), REACTION)?;
    ensure!(page.picture(0, SIZE)? == after, "the city after is another one the second time");

    // A click shows the name of an added model, as in the window. A hidden model is not selected, and links omit its number.
    let place = page.page.evaluate(FIND_ADDED)?;
    ensure!(place.is_array(), "nothing that is added is seen");
    page.page.click([0, 1].map(|k| place[k].as_f64().unwrap_or_default()), 1)?;
    let panel = "document.querySelector('.panel:not([hidden]) .objects')";
    page.page.wait_for(&format!("{panel}?.querySelector('h3').textContent === 'tower.geojson'"), REACTION)?;
    let kind = page.page.evaluate(&format!("{panel}.querySelector('.hint').textContent"))?;
    ensure!(kind == "Part of the proposal", "{kind}");
    keep(&page, "proposal-object")?;
    page.page.press("y")?;
    page.page.wait_for(&says("Tower: before"), REACTION)?;
    page.page.wait_for("document.querySelector('insula-city').selection.length === 0", REACTION)?;
    ensure!(page.page.evaluate("location.hash.includes('object=')")? == false, "the link has a number of the proposal");
    page.page.press("y")?;
    page.page.wait_for(&says("Tower: after"), REACTION)?;

    page.page.evaluate("document.querySelector('.tool:has(.icon-proposals)').click()")?;
    page.page.wait_for("document.querySelector('.panel:not([hidden]) input[type=checkbox]') !== null", REACTION)?;
    page.page.evaluate("document.querySelector('.panel:not([hidden]) input[type=checkbox]').click()")?;
    let border = "document.querySelector('insula-city input[type=range]')";
    page.page.wait_for(&format!("{border}?.checkVisibility() === true"), REACTION)?;
    keep(&page, "proposal-swipe")?;
    page.page.evaluate(&format!(
        "{border}.value = 250; {border}.dispatchEvent(new Event('input')); {border}.previousSibling.style.left"
    ))?;
    let left = page.page.evaluate(&format!("{border}.previousSibling.style.left"))?;
    ensure!(left == "25%", "the line is at {left}");
    ensure_no_problems(&page)
}
