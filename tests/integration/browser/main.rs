//! The viewer in a browser: a real server, headless Chromium, and pictures of what a user sees.
//!
//! Screenshots stay in `target/browser`. Without Chromium (`INSULA_CHROMIUM`, or on the path), all tests are reported as
//! ignored; without the viewer's files in the server, those of the viewer; unless `INSULA_REQUIRE_BROWSER=1`. Tests run
//! one after another, because a page beside others is slow.

mod accessibility;
mod component;
mod driver;
mod faults;
mod objects;
mod pictures;
mod site;
mod viewer;

use anyhow::Result;
use insula_tests::browser::Browser;
use libtest_mimic::{Arguments, Failed, Trial};

type Test = fn() -> Result<()>;

const DRIVER: [(&str, Test); 5] = [
    ("driver_runs_scripts_and_takes_pictures", driver::scripts_and_pictures),
    ("driver_gives_input", driver::input_arrives),
    ("driver_emulates_networks", driver::networks_are_emulated),
    ("driver_slows_processors", driver::slow_processors_are_emulated),
    ("driver_collects_errors", driver::errors_are_collected),
];

const VIEWER: [(&str, Test); 26] = [
    ("the_page_shows_the_city", viewer::the_page_shows_the_city),
    ("the_page_of_a_single_city_is_the_root", viewer::a_single_city_is_the_root),
    ("a_page_without_scripts_lists_the_city", viewer::a_page_without_scripts_lists_the_city),
    ("keys_and_mouse_move_the_camera", viewer::keys_and_mouse_move_the_camera),
    ("touch_moves_the_camera", viewer::touch_moves_the_camera),
    ("a_link_opens_its_view", viewer::a_link_opens_its_view),
    ("a_click_picks_a_point_of_the_city", viewer::a_click_picks_a_point),
    ("two_viewers_share_a_page", viewer::two_viewers_share_a_page),
    ("hostile_names_are_text", viewer::hostile_names_are_text),
    ("the_cpu_draws_the_native_picture", pictures::the_cpu_draws_the_native_picture),
    ("webgpu_draws_the_native_picture", pictures::webgpu_draws_the_native_picture),
    ("pictures_have_their_own_sizes", pictures::pictures_have_their_own_sizes),
    ("a_lost_device_falls_back_to_the_cpu", pictures::a_lost_device_falls_back),
    ("a_restarted_server_is_found_again", faults::a_restarted_server_is_found_again),
    ("an_offline_page_keeps_its_picture", faults::an_offline_page_keeps_its_picture),
    ("a_published_site_needs_no_server_of_ours", site::a_published_site_works),
    ("a_visited_city_works_offline", site::a_visited_city_works_offline),
    ("a_bad_host_is_survived", site::a_bad_host_is_survived),
    ("damaged_bytes_are_fetched_again", site::damaged_bytes_are_fetched_again),
    ("the_plain_example_runs", component::the_plain_example_runs),
    ("markers_are_occluded", component::markers_are_occluded),
    ("clicks_show_attributes", objects::clicks_show_attributes),
    ("clicks_meet_the_same_objects_on_a_gpu", objects::clicks_meet_the_same_objects_on_a_gpu),
    ("the_search_finds_objects", objects::the_search_finds_objects),
    ("colours_have_a_legend", objects::colours_have_a_legend),
    ("a_plain_host_is_searched_in_the_page", objects::a_plain_host_is_searched_in_the_page),
];

/// Tests that need files of others, and the variable that names them.
const WITH_FILES: [(&str, Test, &str); 4] = [
    ("the_react_example_runs", component::the_react_example_runs, "INSULA_VENDOR"),
    ("the_maplibre_example_runs", component::the_maplibre_example_runs, "INSULA_VENDOR"),
    ("axe_finds_nothing_serious", accessibility::axe_finds_nothing_serious, "INSULA_AXE"),
    ("cesium_draws_the_tileset", objects::cesium_draws_the_tileset, "INSULA_CESIUM"),
];

fn main() {
    let has_browser = Browser::find().is_some();
    let is_served = viewer::is_served();
    let has_viewer = has_browser && matches!(is_served, Ok(true));
    if !has_browser {
        eprintln!("no test of the browser can run: no Chromium");
    } else if !has_viewer {
        eprintln!("no test of the viewer can run: client/web/build comes before the server's build: {is_served:?}");
    }
    let is_required = std::env::var("INSULA_REQUIRE_BROWSER").is_ok_and(|value| value == "1");
    let trial = |(name, test): (&str, Test), can_run: bool| {
        let run = move || test().map_err(|error| Failed::from(format!("{error:#}")));
        Trial::test(name, run).with_ignored_flag(!can_run && !is_required)
    };
    let mut trials: Vec<Trial> = DRIVER.into_iter().map(|test| trial(test, has_browser)).collect();
    trials.extend(VIEWER.into_iter().map(|test| trial(test, has_viewer)));
    for (name, test, variable) in WITH_FILES {
        let has_files = std::env::var_os(variable).is_some();
        let ignored = !has_files || !has_viewer && !is_required;
        trials.push(trial((name, test), has_viewer).with_ignored_flag(ignored));
    }
    let mut arguments = Arguments::from_args();
    arguments.test_threads.get_or_insert(1);
    libtest_mimic::run(&arguments, trials).exit();
}
