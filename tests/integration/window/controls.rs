//! Keys, the mouse and the saved state of a window.

use super::client::{Client, Display, Settled};
use super::steps::{copy_a_link, fly, is_same_camera, measure_key, measure_point, save_a_picture, stop_the_server};
use super::{LISTEN, colours, difference, is_same_view, lowest};
use anyhow::{Context, Result, ensure};
use glam::DVec3;
use image::RgbImage;
use insula_client::camera_files::read_path;
use insula_client::ui::settings::UserSettings;
use insula_client::ui::view_link::ViewLink;
use insula_tests::fixtures;
use insula_tests::programs::{ServerProcess, path_text};
use std::path::Path;

const CPU: Display = Display { adapter: "cpu", scale: 1 };
/// Size of the window in points, before and after the user changes it: there is room for all panels.
const FIRST_SIZE: [u32; 2] = [560, 400];
const SIZE: [u32; 2] = [500, 380];

pub(super) fn a_user_controls_the_window() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let city = fixtures::baked_chiba()?;
    let settings_at = folder.path().join("insula").join("settings.json");
    std::fs::create_dir_all(folder.path().join("insula"))?;
    std::fs::write(&settings_at, "{ damaged")?;
    let server = ServerProcess::serve(&city, LISTEN)?;
    let address = server.address.to_string();
    drop(server);

    // The server is down: the window reports it and tries again.
    let place = format!("http://{address}/v1/cities/chiba");
    let mut client = Client::start(CPU, "controls", folder.path(), &place)?;
    client.wait_for_line("settings cannot be used", 0)?;
    client.wait_for_line("not connected: ", 0)?;
    client.resize(FIRST_SIZE)?;
    client.screenshot("1-connecting")?;
    let server = ServerProcess::serve(&city, &address)?;
    client.wait_for_settled(0, |frame| frame.size_px == FIRST_SIZE)?;

    let (view, picture) = resize(&mut client)?;
    let before = hide_the_panels(&mut client, &picture)?;
    let view = move_the_camera(&mut client, &view, &before)?;
    toggle_full_screen_and_bookmark(&mut client)?;
    measure(&mut client)?;
    let view = record(&mut client, &view)?;
    save_a_picture(&mut client, SIZE)?;
    let link = copy_a_link(&mut client, &view)?;
    let picture = client.picture("8-view", |picture| colours(picture) > 30)?;
    stop_the_server(&mut client, server, &view)?;

    // With nothing left to end, Escape does nothing.
    client.key("Escape")?;
    let shown = client.line_count();
    client.key("F1")?;
    client.wait_for_panels("help", shown)?;
    client.key("Escape")?;
    client.wait_for_panels("", shown)?;
    ensure!(client.quit()? == 0, "after Ctrl Q, the exit code is not 0");
    let (settings, note) = UserSettings::load(&settings_at);
    ensure!(note.is_none() && settings.window == SIZE, "the settings are {settings:?} {note:?}");
    ensure!(settings.bookmarks.get("chiba").is_some_and(|b| b.len() == 1), "the settings are {settings:?}");
    ensure!(!settings.overlay && !settings.minimap && !settings.full_screen, "the settings are {settings:?}");
    ensure!(folder.path().join("insula").join("settings.damaged-1.json").is_file(), "the damaged file was not saved");

    let _server = ServerProcess::serve(&city, &address)?;
    open_the_link(folder.path(), &link, &picture)
}

/// After the proposal there are no buildings.
pub(super) fn a_key_shows_a_city_before_and_after_a_proposal() -> Result<()> {
    let folder = tempfile::tempdir()?;
    std::fs::write(folder.path().join("gone.toml"), "[[remove]]\nfilter = \"height > 1\"\n")?;
    let city = fixtures::baked_chiba()?;
    let arguments = [path_text(&city), "--proposal", "gone.toml"];
    let mut client = Client::start_with(CPU, "proposal", folder.path(), &arguments)?;
    client.wait_for_rest()?;
    let after = client.picture("1-after", |picture| colours(picture) > 3)?;
    client.key("y")?;
    client.picture("2-before", |picture| difference(&after, picture) > 0.05)?;
    client.key("y")?;
    client.picture("3-after-again", |picture| is_same_view(&after, picture))?;
    ensure!(client.quit()? == 0, "after Ctrl Q, the exit code is not 0");
    Ok(())
}

/// Changes the size of the window. Returns its view, at rest.
fn resize(client: &mut Client) -> Result<(Settled, RgbImage)> {
    client.wait_for_panels("sliders,map", 0)?;
    let before = client.line_count();
    client.resize(SIZE)?;
    client.wait_for_settled(before, |frame| frame.size_px == SIZE)?;
    let view = client.wait_for_rest()?;
    let is_right = |picture: &RgbImage| picture.dimensions() == SIZE.into() && colours(picture) > 30;
    Ok((view, client.picture("2-resized", is_right)?))
}

/// Hides the sliders and the map. The scene stays as it is.
fn hide_the_panels(client: &mut Client, before: &RgbImage) -> Result<RgbImage> {
    let shown = client.line_count();
    client.key("n")?;
    client.key("o")?;
    client.wait_for_panels("", shown)?;
    let hidden = client.picture("3-open", |picture| difference(before, picture) > 0.1 && colours(picture) > 30)?;
    let change = difference(&lowest(before), &lowest(&hidden));
    ensure!(change < 0.02, "the scene has changed: {change} of its pixels differ");
    ensure!(!client.has_drawn_since(shown), "the scene was drawn again");
    Ok(hidden)
}

/// Moves forward and up. Returns the last view.
fn move_the_camera(client: &mut Client, view: &Settled, before: &RgbImage) -> Result<Settled> {
    let is_other = |before: &RgbImage, picture: &RgbImage| difference(before, picture) > 0.05;
    // Orbiting, the pivot stays at its height.
    let moved = fly(client, "w", view, view.camera.forward.with_z(0.0))?;
    let picture = client.picture("4-moved-by-w", |picture| is_other(before, picture))?;
    let raised = fly(client, "Page_Up", &moved, DVec3::Z)?;
    client.picture("5-higher-by-page-up", |higher| is_other(&picture, higher))?;
    Ok(raised)
}

fn toggle_full_screen_and_bookmark(client: &mut Client) -> Result<()> {
    // Without a window manager, the request has no effect; the client must continue.
    client.key("F11")?;
    client.wait_for_line("full screen on", 0)?;
    client.screenshot("6-full-screen")?;
    client.key("F11")?;
    client.wait_for_line("full screen off", 0)?;
    client.key("b")?;
    client.wait_for_line("saved as View 1", 0)?;
    Ok(())
}

fn measure(client: &mut Client) -> Result<()> {
    measure_key(client, "m")?;
    let first = measure_point(client, [200, 180])?;
    ensure!(first.contains("click the next point"), "{first}");
    let line = measure_point(client, [330, 240])?;
    let long = line.split("measure: ").nth(1).and_then(|text| text.split(" long").next()).context("no length")?;
    let (number, unit) = long.split_once(' ').context("no unit")?;
    let metres = number.parse::<f64>()? * if unit == "km" { 1000.0 } else { 1.0 };
    ensure!((5.0..3000.0).contains(&metres), "{line}");
    client.screenshot("7-measured")?;
    // Escape ends measuring, not the program.
    let ended = measure_key(client, "Escape")?;
    ensure!(ended.contains("ended"), "{ended}");
    client.move_pointer_away()
}

/// Records a flight to the right. Returns its last view, at rest.
fn record(client: &mut Client, view: &Settled) -> Result<Settled> {
    client.key("r")?;
    client.wait_for_line("recording", 0)?;
    let moved = fly(client, "d", view, view.camera.right)?;
    client.key("r")?;
    let wrote = client.wait_for_line("insula-path-0001.json", 0)?;
    let path = read_path(Path::new(wrote.trim_start_matches("wrote ")))?;
    ensure!(path.keys.len() >= 3, "{path:?}");
    let is_at = |key: usize, view: &Settled| {
        path.keys.get(key).is_some_and(|key| DVec3::from(key.position).distance(view.camera.position) < 0.01)
    };
    ensure!(is_at(0, view) && is_at(path.keys.len() - 1, &moved), "not from {view:?} to {moved:?}: {path:?}");
    client.wait_for_rest()
}

/// The link opens the same view in a second window of the saved size.
fn open_the_link(folder: &Path, link: &str, view: &RgbImage) -> Result<()> {
    let camera = ViewLink::parse(link)?.camera.context("the link has no camera")?;
    let mut client = Client::start(CPU, "controls", folder, link)?;
    let first = client.wait_for_settled(0, |_| true)?;
    ensure!(is_same_camera(&first.camera, &camera) && first.size_px == SIZE, "{link} opens {first:?}");
    client.picture("10-link", |picture| is_same_view(view, picture))?;
    // Idle prefetch does not change the frame, which is not drawn again.
    client.wait_for_rest()?;
    let resting = client.line_count();
    client.picture("11-idle-prefetch", |picture| is_same_view(view, picture))?;
    ensure!(client.quit()? == 0, "after Ctrl Q, the exit code is not 0");
    ensure!(!client.has_drawn_since(resting), "the frame was drawn again after idle prefetch");
    Ok(())
}
