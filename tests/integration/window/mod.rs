//! The window, controlled as by a user: keyboard, mouse, a server that starts late or stops.
//!
//! Runs on a virtual screen (Xvfb) with xdotool. Each step waits for what the program reports in its log. Screenshots stay in
//! `target/window`. Without these programs or a graphics driver, the tests are reported as ignored.

mod client;
mod controls;
mod pictures;
mod screen;
mod session;
mod steps;

use client::Display;
use insula_tests::programs::find_installed;
use insula_tests::trials::{Test, Trials, Turn};

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
