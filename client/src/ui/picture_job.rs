//! Draws a picture on a thread of its own, with a session of its own: the window goes on meanwhile.

use crate::error::{ClientError, Result};
use crate::image_files::{PictureNotes, write_picture};
use crate::picture::{Settling, draw_in_strips, settle};
use crate::render::{Adapter, AdapterChoice, OpenedAdapter};
use crate::session::Session;
use insula_command_line::output::unused_file;
use insula_shaders::cpu::raycast::Pixels;
use insula_viewer::cache::pages_for;
use insula_viewer::frame::RenderSettings;
use insula_viewer::objects::ObjectStyles;
use insula_viewer::streamer::FrameRequest;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Largest cache of a picture's session.
const MAX_CACHE_BYTES: u64 = 512 << 20;
/// The server may be silent for this time.
const TIMEOUT: Duration = Duration::from_secs(15);
/// Largest side of the frames that find out what is occluded.
const MAX_FEEDBACK_PX: u32 = 2048;
/// Shortest interval between two reports of progress.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(500);
/// Value of the progress before the first strip.
const LOADING: u32 = u32::MAX;

/// Opens another session of the viewed city with an adapter.
pub type OpenAgainFn = Arc<dyn Fn(OpenedAdapter) -> Result<Session> + Send + Sync>;

/// What is drawn.
#[derive(Debug, Clone)]
pub struct PictureOrder {
    pub request: FrameRequest,
    /// What the file says about the picture.
    pub notes: PictureNotes,
    pub settings: RenderSettings,
    /// How objects are drawn.
    pub styles: ObjectStyles,
    pub shows_proposal: bool,
    /// Whether the window uses the CPU ray-caster.
    pub on_cpu: bool,
    /// Size of the window's cache.
    pub cache_bytes: u64,
}

/// A picture that is being drawn. It is cancelled when dropped.
#[derive(Debug)]
pub struct PictureJob {
    pub order: PictureOrder,
    shared: Arc<JobState>,
}

#[derive(Debug)]
struct JobState {
    is_cancelled: AtomicBool,
    /// Percent of the strips, or [`LOADING`].
    percent: AtomicU32,
    outcome: Mutex<Option<Result<PathBuf>>>,
}

impl PictureJob {
    /// Starts to draw. `wake` is called when there is progress, and at the end. Fails if there is no thread for it.
    pub fn start(order: PictureOrder, open: OpenAgainFn, wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let shared = Arc::new(JobState {
            is_cancelled: AtomicBool::new(false),
            percent: AtomicU32::new(LOADING),
            outcome: Mutex::new(None),
        });
        let (state, ordered) = (shared.clone(), order.clone());
        std::thread::Builder::new().name("insula-picture".into()).spawn(move || {
            let outcome = draw(&ordered, &open, &state, &wake).transpose();
            *state.outcome.lock().unwrap_or_else(PoisonError::into_inner) = outcome;
            wake();
        })?;
        Ok(Self { order, shared })
    }

    /// The file, once it is written, or why it is not. To be called until there is an outcome.
    pub fn take_outcome(&self) -> Option<Result<PathBuf>> {
        self.shared.outcome.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// State of the work, for the user.
    pub fn text(&self) -> String {
        let [width, height] = self.order.request.size_px;
        match self.shared.percent.load(Ordering::Relaxed) {
            LOADING => format!("picture of {width} x {height}: loading"),
            percent => format!("picture of {width} x {height}: {percent}% drawn"),
        }
    }
}

impl Drop for PictureJob {
    fn drop(&mut self) {
        self.shared.is_cancelled.store(true, Ordering::Relaxed);
    }
}

/// Draws and writes the picture. Returns its file, or `None` if it was cancelled.
fn draw(order: &PictureOrder, open: &OpenAgainFn, state: &JobState, wake: &dyn Fn()) -> Result<Option<PathBuf>> {
    let is_cancelled = || state.is_cancelled.load(Ordering::Relaxed);
    let mut session = open(open_adapter(order)?)?;
    session.set_transitions(false);
    session.show_proposal(order.shows_proposal);
    session.set_styles(order.styles.clone());
    session.set_sun(order.settings.shadow_casting_sun());
    let feedback_px = order.request.size_px.map(|side| side.min(MAX_FEEDBACK_PX));
    settle(&mut session, &order.request, Settling { feedback_px, timeout: TIMEOUT }, |_| !is_cancelled())?;
    let mut reported = Instant::now();
    let pixels = draw_in_strips(&mut session, &order.request, &order.settings, |share| {
        state.percent.store((share * 100.0) as u32, Ordering::Relaxed);
        if reported.elapsed() >= PROGRESS_INTERVAL {
            reported = Instant::now();
            wake();
        }
        !is_cancelled()
    })?;
    pixels.map(|pixels| save(&pixels, &order.notes)).transpose()
}

fn open_adapter(order: &PictureOrder) -> Result<OpenedAdapter> {
    let cache_bytes = order.cache_bytes.min(MAX_CACHE_BYTES);
    match order.on_cpu {
        true => Ok(OpenedAdapter::cpu(pages_for(cache_bytes))),
        false => Adapter::headless(AdapterChoice::Gpu, cache_bytes),
    }
}

/// Writes a picture into the current folder under the first unused number, and returns its file. Fails if it cannot be written.
pub fn save(pixels: &Pixels, notes: &PictureNotes) -> Result<PathBuf> {
    let folder = std::env::current_dir().unwrap_or_default();
    let path = unused_file(&folder, "insula", "png").map_err(ClientError::Failed)?;
    write_picture(&path, pixels, notes)?;
    Ok(path)
}
