//! The server is killed and restarted while the client streams: the client keeps drawing and converges by itself.

use anyhow::{Result, ensure};
use insula_tests::{
    fixtures,
    programs::ServerProcess,
    proxy::{Link, Proxy},
    twin,
    viewer::{Viewer, overlook},
};
use std::time::{Duration, Instant};

/// So slow that the kill comes first.
const LINK: Link = Link { bits_per_sec: 1.5e6, round_trip: Duration::from_millis(40) };

#[test]
fn the_client_keeps_drawing_and_converges_by_itself() -> Result<()> {
    let city = fixtures::baked_chiba()?;
    let server = ServerProcess::serve(&city, "127.0.0.1:0")?;
    let address = server.address;
    let proxy = Proxy::start(address, LINK)?;
    let url = format!("http://{}", proxy.address);
    let mut viewer = Viewer::connect(&url, |manifest| overlook(manifest, false))?;
    viewer.step_until(Duration::from_secs(30), |viewer| {
        Ok(viewer.session.selection().stats.drawn >= 4 && viewer.loading().len() >= 4)
    })?;
    drop(server);
    let (before, begin) = (viewer.session.selection().stats, Instant::now());
    while begin.elapsed() < Duration::from_secs(2) {
        viewer.step()?;
        let now = viewer.session.selection().stats;
        ensure!(now.worst_error_px <= before.worst_error_px, "the frame got worse: {now:?} after {before:?}");
    }
    ensure!(!viewer.session.is_settled(), "nothing was in flight when the server was killed");
    let frame = viewer.draw()?;
    ensure!(frame.distance.iter().any(|d| d.is_finite()), "nothing is drawn while the server is away");
    let _server = ServerProcess::serve(&city, &address.to_string())?;
    viewer.step_until(Duration::from_secs(60), |viewer| Ok(viewer.session.is_settled()))?;
    ensure!(viewer.session.report(1.0).tiles.bad == 0, "tiles were given up");
    // The frame is the same as without a restart.
    let undisturbed = ServerProcess::serve(&city, "127.0.0.1:0")?;
    let mut other = Viewer::connect(&format!("http://{}", undisturbed.address), |manifest| overlook(manifest, false))?;
    other.step_until(Duration::from_secs(60), |viewer| Ok(viewer.session.is_settled()))?;
    let difference = twin::compare(&other.draw()?, &viewer.draw()?);
    ensure!(difference.differing == 0, "{} pixels differ", difference.differing);
    Ok(())
}
