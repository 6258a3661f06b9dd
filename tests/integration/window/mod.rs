//! The window, controlled as by a user: keyboard, mouse, a server that starts late or stops.
//!
//! Runs on a virtual screen (Xvfb) with xdotool. Each step waits for what the program reports in its log. Screenshots stay in
//! `target/window`. Without these programs or a graphics driver, the tests are reported as ignored.

mod client;
mod controls;
mod screen;
mod session;
mod steps;

use client::Display;
use image::imageops::crop_imm;
use image::{Rgb, RgbImage};
use insula_tests::programs::find_installed;
use insula_tests::trials::{Test, Trials, Turn};
use std::collections::HashSet;

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
            let session = move || session::a_session_with_a_chosen_city(Display { adapter, scale });
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
