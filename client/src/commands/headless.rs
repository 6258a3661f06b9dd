//! Sessions without a window, for `snapshot`, `fly` and `demo`.

use super::{connect, proposal};
use crate::args::GlobalArgs;
use crate::error::Result;
use crate::image_files::{PictureNotes, write_picture};
use crate::picture::{self, Settling};
use crate::render::Adapter;
use crate::session::Session;
use crate::stream::BackgroundFetcher;
use crate::stream::fetch::Http;
use crate::ui::view_link::format_link;
use insula_objects::color::Legend;
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::layout::Shading;
use insula_viewer::cache::pages_for;
use insula_viewer::frame::STILL_SAMPLES;
use insula_viewer::scene::SceneTree;
use insula_viewer::streamer::{FrameRequest, TileCounts};
use insula_viewer::sun::Daylight;
use std::ffi::OsStr;
use std::io::IsTerminal;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Requests in flight at the start of a session.
pub(super) const INITIAL_REQUESTS: usize = 12;
/// Longest wait for an arrival before retries are checked.
pub(super) const POLL_INTERVAL: Duration = Duration::from_millis(10);

/// Connects to the city at `place` and opens a session, with the proposal of a file. The tiles of `first` are fetched while the adapter is
/// being opened. Fails if the city, the proposal or the adapter cannot be opened.
pub fn open_session(
    place: impl AsRef<OsStr>,
    global: &GlobalArgs,
    http: Option<Http>,
    first: Option<&FrameRequest>,
    proposal: Option<&Path>,
) -> Result<Session> {
    let started = Instant::now();
    let (choice, cache_bytes) = (global.adapter, u64::from(global.cache_mib) << 20);
    // Drivers and networks are both slow, so they are opened at the same time.
    let opening = std::thread::spawn(move || Adapter::headless(choice, cache_bytes));
    let http = Arc::new(match http {
        Some(http) => http,
        None => Http::with_options(None, global.http_options())?,
    });
    let mut city = connect(&http, place, global)?;
    let proposal = proposal::open(proposal, &http, &mut city)?;
    let downloads = BackgroundFetcher::downloads(Arc::clone(&http), city.source.clone(), INITIAL_REQUESTS, None);
    let tree = SceneTree::new(city.manifest).with_meshes(!global.no_meshes);
    let session = Session::open(tree, downloads, opening, pages_for(cache_bytes), first, started)?;
    session.with_address(city.address).with_objects(http, city.source).with_proposal(proposal)
}

pub(super) struct PictureFile<'a> {
    pub(super) path: &'a Path,
    /// Whether the city's sources are drawn into a corner.
    pub(super) has_caption: bool,
    /// Colours of objects, drawn into another corner.
    pub(super) legend: Option<Legend>,
}

/// Waits until the frame is settled, draws it with [`STILL_SAMPLES`] x [`STILL_SAMPLES`] rays per pixel, and writes it with
/// its sources. The returned pixels have no caption. Fails if the server does not respond or the file cannot be written.
pub(super) fn render_to_file(
    session: &mut Session,
    request: &FrameRequest,
    global: &GlobalArgs,
    shading: Shading,
    daylight: &Daylight,
    out: &PictureFile<'_>,
) -> Result<Pixels> {
    let settings = daylight.render_settings(shading, STILL_SAMPLES);
    session.set_sun(settings.shadow_casting_sun());
    settle_with_progress(session, request, global)?;
    let begin = Instant::now();
    let pixels = picture::draw_whole(session, request, &settings)?;
    session.record_frame_time(begin.elapsed());
    let link = format_link(session.address(), &request.camera, daylight, None);
    let notes = PictureNotes::new(session.tree().manifest(), link, out.has_caption);
    write_picture(out.path, &pixels, &PictureNotes { legend: out.legend.clone(), ..notes })?;
    Ok(pixels)
}

/// As [`settle`], with the timeout of the command and its progress on a terminal.
pub(super) fn settle_with_progress(session: &mut Session, request: &FrameRequest, global: &GlobalArgs) -> Result<()> {
    let mut progress = TileProgress::new();
    let settled = settle_showing(session, request, Duration::from_secs(u64::from(global.timeout)), |session| {
        progress.show(session);
    });
    progress.clear();
    settled
}

/// Streams until nothing can improve the frame. Draws frames meanwhile, because their hits decide which tiles are occluded.
/// Fails if the server does not respond for `timeout`, or if the adapter fails.
pub fn settle(session: &mut Session, request: &FrameRequest, timeout: Duration) -> Result<()> {
    settle_showing(session, request, timeout, |_| {})
}

/// As [`settle`]; calls `show` after each update.
fn settle_showing(
    session: &mut Session,
    request: &FrameRequest,
    timeout: Duration,
    mut show: impl FnMut(&Session),
) -> Result<()> {
    picture::settle(session, request, Settling { feedback_px: request.size_px, timeout }, |session| {
        show(session);
        true
    })
}

/// The tiles of a frame that are loaded and wanted, on one line of standard error, if that is a terminal.
struct TileProgress {
    is_terminal: bool,
    shown_at: Option<Instant>,
}

impl TileProgress {
    /// Time between two lines.
    const INTERVAL: Duration = Duration::from_millis(100);

    fn new() -> Self {
        Self { is_terminal: std::io::stderr().is_terminal(), shown_at: None }
    }

    fn show(&mut self, session: &Session) {
        if !self.is_terminal || self.shown_at.is_some_and(|shown_at| shown_at.elapsed() < Self::INTERVAL) {
            return;
        }
        self.shown_at = Some(Instant::now());
        let TileCounts { subtrees, blockmaps, meshes, .. } = session.tile_counts();
        let pending = session.selection().requests.len();
        eprint!("\r\x1b[K{} tiles loaded, {pending} pending", subtrees + blockmaps + meshes);
    }

    fn clear(&mut self) {
        if self.shown_at.take().is_some() {
            eprint!("\r\x1b[K");
        }
    }
}
