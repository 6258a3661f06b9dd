//! The server is killed and restarted while the client streams: the client keeps drawing and converges by itself.

use anyhow::{Result, ensure};
use insula_tests::programs::ServerProcess;
use insula_tests::proxy::Proxy;
use insula_tests::trials::Trials;
use insula_tests::viewer::{Viewer, overlook};
use insula_tests::{fixtures, ports, tests, twin};

/// Bytes of responses that suffice to connect.
const CONNECT_BYTES: usize = 1 << 20;
/// Bytes of responses that may arrive before each frame, so few that the kill comes first.
const FRAME_BYTES: usize = 4 << 10;
/// Connections that the client tries while the server is away.
const ATTEMPTS: u64 = 2;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![the_client_keeps_drawing_and_converges_by_itself]);
}

fn the_client_keeps_drawing_and_converges_by_itself() -> Result<()> {
    let city = fixtures::baked_chiba()?;
    let address = ports::restartable()?;
    let server = ServerProcess::serve(&city, &address.to_string())?;
    let proxy = Proxy::start(address, CONNECT_BYTES)?;
    let url = format!("http://{}", proxy.address);
    let mut viewer = Viewer::connect(&url, |manifest| overlook(manifest, false))?;
    viewer.step_until("some tiles are drawn, and others in flight", |viewer| {
        proxy.allow(FRAME_BYTES);
        Ok(viewer.session.selection().stats.drawn >= 4 && viewer.loading().len() >= 4)
    })?;
    drop(server);
    let (before, connections) = (viewer.session.selection().stats, proxy.connections());
    viewer.step_until("the client asks in vain", |viewer| {
        // Responses that were sent before the server stopped still arrive.
        proxy.allow(FRAME_BYTES);
        let now = viewer.session.selection().stats;
        ensure!(now.worst_error_px <= before.worst_error_px, "the frame got worse: {now:?} after {before:?}");
        ensure!(!viewer.session.is_settled(), "nothing was in flight when the server was killed");
        Ok(viewer.session.failing_for().is_some() && proxy.connections() >= connections + ATTEMPTS)
    })?;
    let frame = viewer.draw()?;
    ensure!(frame.distance.iter().any(|d| d.is_finite()), "nothing is drawn while the server is away");
    proxy.open();
    let _server = ServerProcess::serve(&city, &address.to_string())?;
    viewer.step_until("everything is there", |viewer| Ok(viewer.session.is_settled()))?;
    ensure!(viewer.session.report(1.0).tiles.bad == 0, "tiles were given up");
    // The frame is the same as without a restart.
    let undisturbed = ServerProcess::serve(&city, "127.0.0.1:0")?;
    let mut other = Viewer::connect(&format!("http://{}", undisturbed.address), |manifest| overlook(manifest, false))?;
    other.step_until("everything is there", |viewer| Ok(viewer.session.is_settled()))?;
    let difference = twin::compare(&other.draw()?, &viewer.draw()?);
    ensure!(difference.differing == 0, "{} pixels differ", difference.differing);
    Ok(())
}
