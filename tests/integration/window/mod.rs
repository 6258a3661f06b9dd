//! The window, controlled as by a user: keyboard, mouse, a server that starts late or stops.
//!
//! Runs on a virtual screen (Xvfb) with xdotool. Each step waits for what the program reports in its log. Screenshots stay in
//! `target/window`. Without these programs or a graphics driver, the tests are reported as ignored.

mod client;
mod controls;
mod screen;
mod steps;

use anyhow::{Result, ensure};
use client::{Client, Display};
use image::imageops::crop_imm;
use image::{Rgb, RgbImage};
use insula_bake::BakeOptions;
use insula_client::ui::settings::UserSettings;
use insula_tests::fixtures;
use insula_tests::programs::{ServerProcess, find_installed, program};
use insula_tests::trials::{Test, Trials, Turn};
use std::collections::HashSet;
use std::process::Command;
use steps::{copy_a_link, fly, is_same_camera, measure_key, measure_point, save_a_picture};

/// Largest share of differing pixels of two pictures of a view: edges, where other tiles were resident.
const SAME_VIEW: f64 = 0.03;
/// An address that no other test listens on. There, the port of a server stays free until it is started.
const LISTEN: &str = "127.0.0.77:0";
const TOOLS: [&str; 3] = ["Xvfb", "xdotool", "import"];

/// The screen has one keyboard and one pointer.
static WINDOW: Turn = Turn::new();

pub(crate) fn add(trials: &mut Trials) {
    let missing: Vec<&str> = TOOLS.into_iter().filter(|tool| find_installed(tool).is_none()).collect();
    if !missing.is_empty() {
        eprintln!("no test of the window can run: missing {missing:?}");
    }
    let is_ignored = !missing.is_empty() || !trials.has_gpu();
    let mut tests = vec![
        Test::new("a_user_controls_the_window", controls::a_user_controls_the_window),
        Test::new(
            "a_key_shows_a_city_before_and_after_a_proposal",
            controls::a_key_shows_a_city_before_and_after_a_proposal,
        ),
    ];
    for adapter in ["cpu", "gpu"] {
        for scale in [1, 2] {
            let session = move || a_session_with_a_chosen_city(Display { adapter, scale });
            let test = Test::new(format!("a_session_with_a_chosen_city_{adapter}_{scale}x"), session);
            tests.push(if (adapter, scale) == ("cpu", 1) { test } else { test.full_tier() });
        }
    }
    trials.add(tests.into_iter().map(|test| test.ignored_if(is_ignored).in_turn(&WINDOW)));
}

/// Ends the screen, if a test has started it.
pub(crate) fn close() {
    screen::close();
}

/// Share of pixels that differ visibly.
fn difference(a: &RgbImage, b: &RgbImage) -> f64 {
    if a.dimensions() != b.dimensions() {
        return 1.0;
    }
    let differs = |(a, b): (&Rgb<u8>, &Rgb<u8>)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 12);
    a.pixels().zip(b.pixels()).filter(|pair| differs(*pair)).count() as f64 / f64::from(a.width() * a.height())
}

/// The part of a view that no overlay covers: messages appear above, the compass and the status on the left.
fn scene(view: &RgbImage) -> RgbImage {
    let (left, top) = (view.width() * 6 / 10, view.height() / 2);
    crop_imm(view, left, top, view.width() - left, view.height() - top).to_image()
}

/// The lower half of the scene, which neither the map nor the counters reach.
fn lowest(view: &RgbImage) -> RgbImage {
    let view = scene(view);
    crop_imm(&view, 0, view.height() / 2, view.width(), view.height() / 2).to_image()
}

/// Whether two pictures show the same view.
fn is_same_view(a: &RgbImage, b: &RgbImage) -> bool {
    difference(&scene(a), &scene(b)) < SAME_VIEW
}

/// Number of colours in steps of 16; an empty window has one.
fn colours(screenshot: &RgbImage) -> usize {
    screenshot.pixels().map(|p| p.0.map(|c| c / 16)).collect::<HashSet<_>>().len()
}

/// Size of the window in points.
const SIZE: [u32; 2] = [400, 300];
/// Beside the text of the first city. Labels take clicks themselves.
const FIRST_CITY: [u32; 2] = [330, 118];
/// Corners of a triangle on the ground, between the panels.
const TRIANGLE: [[u32; 2]; 3] = [[120, 165], [200, 205], [290, 175]];

/// A server with two cities: one is chosen, viewed, left, found again and measured.
/// In the end, the window system destroys the window.
fn a_session_with_a_chosen_city(display: Display) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let houses = vec![fixtures::write_city_json(folder.path(), 3)?];
    let village = fixtures::baked("village", &BakeOptions { inputs: houses, ..BakeOptions::default() })?;
    let cities = [fixtures::baked_chiba()?, village];
    let server = ServerProcess::start_with(&mut Command::new(program("insula-server")?), &cities, LISTEN, &[])?;
    let address = server.address.to_string();
    std::fs::create_dir_all(folder.path().join("insula"))?;
    let settings = UserSettings { window: SIZE, ..UserSettings::default() };
    std::fs::write(folder.path().join("insula").join("settings.json"), serde_json::to_string(&settings)?)?;
    let test = format!("session-{}-{}x", display.adapter, display.scale);
    let mut client = Client::start(display, &test, folder.path(), &format!("http://{address}"))?;

    choose_the_first_city(&mut client)?;
    fly_away_and_home(&mut client)?;
    measure_line_area_and_height(&mut client)?;
    client.key("b")?;
    client.wait_for_line("saved as View 1", 0)?;
    save_a_picture(&mut client, SIZE.map(|side| side * display.scale))?;
    let view = client.wait_for_rest()?;
    copy_a_link(&mut client, &view)?;
    client.destroy_window()?;
    ensure!(client.wait_for_end()? == 0, "after the window was destroyed, the exit code is not 0");
    Ok(())
}

fn choose_the_first_city(client: &mut Client) -> Result<()> {
    client.wait_for_line("has several cities: choose one with --city: chiba, village", 0)?;
    for city in ["chiba", "village"] {
        let drawn = client.wait_for_line(&format!("picture of {city}"), 0)?;
        ensure!(drawn.contains("is_drawn=true"), "{drawn}");
    }
    client.picture("1-chooser", |picture| colours(picture) > 60)?;
    client.click(FIRST_CITY)?;
    client.wait_for_line("opened chiba", 0)?;
    client.move_pointer_away()?;
    client.wait_for_settled(0, |_| true)?;
    Ok(())
}

fn fly_away_and_home(client: &mut Client) -> Result<()> {
    let home = client.wait_for_rest()?;
    let first = client.picture("2-home", |picture| colours(picture) > 30)?;
    // Orbiting, the pivot stays at its height.
    fly(client, "w", &home, home.camera.forward.with_z(0.0))?;
    client.picture("3-away", |picture| difference(&first, picture) > 0.05)?;
    let before = client.line_count();
    client.key("h")?;
    client.wait_for_settled(before, |frame| is_same_camera(&frame.camera, &home.camera))?;
    client.screenshot("4-home")?;
    Ok(())
}

/// M changes from one to the next. An area has the points of the line before it.
fn measure_line_area_and_height(client: &mut Client) -> Result<()> {
    let expect = |text: String, words: &str| -> Result<()> {
        ensure!(text.contains(words), "{words:?} is expected: {text}");
        Ok(())
    };
    let [a, b, c] = TRIANGLE;
    expect(measure_key(client, "m")?, "line: click a first point")?;
    expect(measure_point(client, a)?, "click the next point")?;
    expect(measure_point(client, b)?, "m long")?;
    expect(measure_point(client, c)?, "last part")?;
    client.screenshot("5-line")?;
    expect(measure_key(client, "m")?, "in plan")?;
    expect(measure_key(client, "BackSpace")?, "click the third point of the area")?;
    expect(measure_point(client, c)?, "in plan")?;
    client.screenshot("6-area")?;
    expect(measure_key(client, "m")?, "height: click a first point")?;
    expect(measure_point(client, a)?, "click the next point")?;
    expect(measure_point(client, b)?, "m high")?;
    client.screenshot("7-height")?;
    expect(measure_key(client, "Escape")?, "ended")?;
    client.move_pointer_away()
}
