//! `insula snapshot`: a view, as good as the city has it, as a picture.
//!
//! In: a server, a camera file. Out: PNG, PFM, report. Next: people and scripts.

use super::connect::connect;
use crate::{
    args::{Global, Snapshot},
    camera_files::read_camera,
    error::Result,
    picture::{write_pfm, write_png},
    render::Adapter,
    session::Session,
    stream::{BackgroundFetcher, fetch::Http},
};
use insula_shaders::layout::Shading;
use insula_viewer::{
    cache::pages_for,
    frame::{RenderSettings, STILL_SAMPLES},
    scene::SceneTree,
    streamer::{FEEDBACK_DOWNSCALE, FrameRequest},
    sun::Daylight,
};
use std::{
    path::Path,
    sync::Arc,
    time::{Duration, Instant},
};

/// Requests in flight.
pub(crate) const IN_FLIGHT: usize = 12;
/// Longest time between two looks at what has arrived, and at what has to be asked for again.
pub(crate) const PAUSE: Duration = Duration::from_millis(10);

/// Runs the command.
pub fn run(args: &Snapshot, global: &Global) -> Result<()> {
    let camera = read_camera(&args.camera)?;
    let shot = FrameRequest { camera, heading: None, size_px: args.size, tau_px: global.tau };
    let mut session = start(&args.server, global, None, Some(&shot))?;
    let daylight = Daylight::new(&args.sun.into(), session.tree().manifest());
    take(&mut session, &shot, global, args.shading, &daylight, &args.out)?;
    if let Some(path) = &args.distance {
        // One ray a pixel: a distance is that of the pixel's centre.
        write_pfm(path, &session.draw(&shot, &daylight.render_settings(args.shading, 1))?)?;
    }
    match &args.report {
        Some(path) => session.report(global.tau).write(path),
        None => Ok(()),
    }
}

/// Connects and sets up a session without a window, which begins with `first`.
pub fn start(url: &str, global: &Global, http: Option<Http>, first: Option<&FrameRequest>) -> Result<Session> {
    let started = Instant::now();
    let (choice, cache_bytes) = (global.adapter, u64::from(global.cache_mib) << 20);
    // Drivers take their time, and so do networks.
    let opening = std::thread::spawn(move || Adapter::headless(choice, cache_bytes));
    let http = Arc::new(match http {
        Some(http) => http,
        None => Http::new(None)?,
    });
    let city = connect(&http, url, global)?;
    let stream = BackgroundFetcher::downloads(http, city.source, IN_FLIGHT, None);
    let tree = SceneTree::new(city.manifest).with_meshes(!global.no_meshes);
    Session::open((tree, stream), opening, pages_for(cache_bytes), first, started)
}

/// Waits until the picture cannot get better, draws it with [`STILL_SAMPLES`] x [`STILL_SAMPLES`] rays a pixel and writes it.
pub(crate) fn take(
    session: &mut Session,
    shot: &FrameRequest,
    global: &Global,
    shading: Shading,
    daylight: &Daylight,
    out: &Path,
) -> Result<()> {
    let look = daylight.render_settings(shading, STILL_SAMPLES);
    session.set_sun(look.shadow_casting_sun());
    settle(session, shot, Duration::from_secs(u64::from(global.timeout)))?;
    let before = Instant::now();
    let pixels = session.draw(shot, &look)?;
    session.record_frame_time(before.elapsed());
    write_png(out, &pixels)
}

/// Streams until nothing better can be fetched, and no pixel shows what is not as good as it should be.
pub fn settle(session: &mut Session, shot: &FrameRequest, timeout: Duration) -> Result<()> {
    let coarse = shot.size_px.map(|side| (side / FEEDBACK_DOWNSCALE).max(1));
    loop {
        session.update(shot);
        session.check(timeout)?;
        let size_px = if !session.is_fetched() {
            // What hides what is seen well enough in few pixels, as long as not all is here.
            if !session.has_frame() || session.has_feedback(coarse) {
                session.wait(PAUSE);
                continue;
            }
            coarse
        } else if !session.has_feedback(shot.size_px) {
            shot.size_px
        } else {
            return Ok(());
        };
        session.draw(&FrameRequest { size_px, ..*shot }, &RenderSettings::default())?;
    }
}

/// For commands that have a whole city in view.
#[cfg(feature = "embedded")]
pub(crate) fn overlook(session: &Session, size_px: [u32; 2]) -> insula_viewer::camera::Camera {
    let aspect = f64::from(size_px[0]) / f64::from(size_px[1].max(1));
    insula_viewer::camera::Camera::overview(session.tree().manifest().focus_bounds(), aspect)
}
