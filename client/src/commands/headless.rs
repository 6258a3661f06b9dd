//! Sessions without a window, for `snapshot`, `fly` and `demo`.

use super::connect::connect;
use crate::{
    args::GlobalArgs,
    error::Result,
    image_files::write_png,
    render::Adapter,
    session::Session,
    stream::{BackgroundFetcher, fetch::Http},
};
use insula_shaders::{cpu::raycast::Pixels, layout::Shading};
use insula_viewer::{
    cache::pages_for,
    frame::{RenderSettings, STILL_SAMPLES},
    scene::SceneTree,
    streamer::{FEEDBACK_DOWNSCALE, FrameRequest},
    sun::Daylight,
};
use std::{
    ffi::OsStr,
    path::Path,
    sync::Arc,
    time::{Duration, Instant},
};

/// Requests in flight at the start of a session.
pub(super) const INITIAL_REQUESTS: usize = 12;
/// Longest wait for an arrival before retries are checked.
pub(super) const POLL_INTERVAL: Duration = Duration::from_millis(10);

/// Connects to the city at `place` and opens a session. The tiles of `first` are fetched while the adapter is being opened.
/// Fails if the city or the adapter cannot be opened.
pub fn open_session(
    place: impl AsRef<OsStr>,
    global: &GlobalArgs,
    http: Option<Http>,
    first: Option<&FrameRequest>,
) -> Result<Session> {
    let started = Instant::now();
    let (choice, cache_bytes) = (global.adapter, u64::from(global.cache_mib) << 20);
    // Drivers and networks are both slow, so they are opened at the same time.
    let opening = std::thread::spawn(move || Adapter::headless(choice, cache_bytes));
    let http = Arc::new(match http {
        Some(http) => http,
        None => Http::with_options(None, global.http_options())?,
    });
    let city = connect(&http, place, global)?;
    let downloads = BackgroundFetcher::downloads(http, city.source, INITIAL_REQUESTS, None);
    let tree = SceneTree::new(city.manifest).with_meshes(!global.no_meshes);
    Session::open(tree, downloads, opening, pages_for(cache_bytes), first, started)
}

/// Frames with all their tiles that are drawn until feedback changes nothing. Usually one or two are enough. Nodes at the limit of
/// visibility can alternate for ever; all of them are resident then.
const MAX_FULL_FRAMES: u32 = 24;

/// Waits until the frame is settled, draws it with [`STILL_SAMPLES`] x [`STILL_SAMPLES`] rays per pixel, and writes it as PNG.
/// Fails if the server does not respond or the file cannot be written.
pub(super) fn render_to_file(
    session: &mut Session,
    request: &FrameRequest,
    global: &GlobalArgs,
    shading: Shading,
    daylight: &Daylight,
    out: &Path,
) -> Result<Pixels> {
    let settings = daylight.render_settings(shading, STILL_SAMPLES);
    session.set_sun(settings.shadow_casting_sun());
    settle(session, request, Duration::from_secs(u64::from(global.timeout)))?;
    let begin = Instant::now();
    let pixels = session.draw(request, &settings)?;
    session.record_frame_time(begin.elapsed());
    write_png(out, &pixels)?;
    Ok(pixels)
}

/// Streams until nothing can improve the frame. Draws frames meanwhile, because their hits decide which tiles are occluded.
/// Fails if the server does not respond for `timeout`, or if the adapter fails.
pub fn settle(session: &mut Session, request: &FrameRequest, timeout: Duration) -> Result<()> {
    let small_px = request.size_px.map(|side| (side / FEEDBACK_DOWNSCALE).max(1));
    let mut full_frames = 0;
    loop {
        session.update(request);
        session.check(timeout)?;
        let size_px = if !session.is_fetched() {
            // A small frame shows well enough what is occluded while tiles are missing.
            if !session.has_frame() || session.has_feedback(small_px) {
                session.wait(POLL_INTERVAL);
                continue;
            }
            small_px
        } else if !session.has_feedback(request.size_px) && full_frames < MAX_FULL_FRAMES {
            full_frames += 1;
            request.size_px
        } else {
            return Ok(());
        };
        session.draw(&FrameRequest { size_px, ..*request }, &RenderSettings::default())?;
    }
}
