//! Steps that several tests of the window take.

use super::client::{Client, Settled};
use super::colours;
use anyhow::{Context, Result, ensure};
use glam::DVec3;
use insula_client::ui::view_link::ViewLink;
use insula_tests::programs::ServerProcess;
use insula_viewer::camera::Camera;

/// How far a held key moves the camera, so that the picture is another one.
const MOVE_M: f64 = 150.0;
/// Differences between a camera and its text.
const TEXT_M: f64 = 0.002;
const TEXT_SHARE: f64 = 1e-4;
/// Turns of the wheel towards what is ahead.
const WHEEL_STEPS: u32 = 20;

/// Whether two cameras are the same as far as their texts tell.
pub(super) fn is_same_camera(a: &Camera, b: &Camera) -> bool {
    a.position.distance(b.position) < TEXT_M && a.forward.distance(b.forward) < TEXT_SHARE
}

/// Holds a key that moves the camera in the direction `towards` from where it rests. Returns the final frame there.
pub(super) fn fly(client: &mut Client, key: &str, from: &Settled, towards: DVec3) -> Result<Settled> {
    let start = from.camera.position;
    let moved = client.hold(key, |camera| camera.position.distance(start) > MOVE_M)?;
    let direction = (moved.camera.position - start).normalize();
    ensure!(direction.dot(towards.normalize()) > 0.999, "{key} moves to {direction}, not {towards}");
    ensure!(moved.camera.forward.distance(from.camera.forward) < TEXT_SHARE, "{key} turns the camera: {moved:?}");
    Ok(moved)
}

/// Clicks at a place. Returns what is measured then.
pub(super) fn measure_point(client: &mut Client, place: [u32; 2]) -> Result<String> {
    let before = client.line_count();
    client.click(place)?;
    client.wait_for_line("measure: ", before)
}

/// Presses a key of the measuring tool. Returns what is measured then.
pub(super) fn measure_key(client: &mut Client, key: &str) -> Result<String> {
    let before = client.line_count();
    client.key(key)?;
    client.wait_for_line("measure: ", before)
}

/// A picture is drawn in the background and written into the current folder.
pub(super) fn save_a_picture(client: &mut Client, size_px: [u32; 2]) -> Result<()> {
    client.key("p")?;
    let wrote = client.wait_for_line("insula-0001.png", 0)?;
    let picture = image::open(wrote.trim_start_matches("wrote "))?.to_rgb8();
    ensure!(picture.dimensions() == size_px.into() && colours(&picture) > 30, "{:?}", picture.dimensions());
    Ok(())
}

/// Copies a link to the view that rests. Returns it.
pub(super) fn copy_a_link(client: &mut Client, view: &Settled) -> Result<String> {
    client.key("c")?;
    let link = client.wait_for_line("copied insula://", 0)?.trim_start_matches("copied ").to_owned();
    let camera = ViewLink::parse(&link)?.camera.context("the link has no camera")?;
    ensure!(is_same_camera(&camera, &view.camera), "{link} is not the view {view:?}");
    Ok(link)
}

/// Without a server, the tiles that the program has are drawn from other places.
pub(super) fn stop_the_server(client: &mut Client, server: ServerProcess, view: &Settled) -> Result<()> {
    drop(server);
    let before = client.line_count();
    client.turn_wheel([200, 200], WHEEL_STEPS)?;
    client.wait_for_frame("nearer view", before, |camera| camera.position.distance(view.camera.position) > MOVE_M)?;
    client.picture("9-without-a-server", |picture| colours(picture) > 30)?;
    Ok(())
}
