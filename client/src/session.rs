//! The frame loop that the window, `snapshot` and `fly` share: stream, draw, report what the rays hit.
//!
//! Adds to the pure [`Streamer`] the clock, the ray-caster, and a thread that keeps the network busy while a frame is drawn.

use crate::error::{ClientError, Result};
use crate::objects::ObjectLookup;
use crate::proposal::ShownProposal;
use crate::render::{Adapter, AdapterInfo, OpenedAdapter};
use crate::report::{FlightSample, FrameTimes, RunReport};
use crate::stream::BackgroundFetcher;
use crate::stream::fetch::Http;
use crate::stream::notifier::Notifier;
use insula_protocol::blockmap::NO_OBJECT;
use insula_shaders::cpu::hit_counts::hit_counts;
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::cpu::stepped::{FrameProgress, SteppedFrame};
use insula_viewer::cache::PAGE_BYTES;
use insula_viewer::collision::CitySolids;
use insula_viewer::frame::{FrameData, RenderSettings};
use insula_viewer::objects::ObjectStyles;
use insula_viewer::scene::{SceneTree, TreeNode};
use insula_viewer::source::ObjectSource;
use insula_viewer::streamer::{Downloads, FrameRequest, LookaheadState, StreamStatus, Streamer, TileCounts};
use std::ops::{Deref, DerefMut};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Number of frame times that are recorded. Later ones are ignored.
const MAX_FRAME_TIMES: usize = 100_000;
/// A frame whose errors are at most this multiple of tau counts as nearly converged.
const NEAR_TIMES_TAU: f64 = 4.0;
/// Requests that are answered, but so slowly that nothing is complete, fail after this multiple of the timeout.
const SLOW_TIMES_TIMEOUT: u32 = 10;
/// Interval of checks for due retries while nothing arrives.
const POLL_INTERVAL: Duration = Duration::from_millis(10);

/// Result of one step of the idle prefetch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PrefetchStep {
    /// A small frame was drawn; the next step may follow at once.
    Drawn,
    /// Tiles are in flight.
    Waiting,
    /// Nothing is left to fetch, or the cache is full.
    Done,
}

/// A city that is being viewed: its [`Streamer`], with a clock and a ray-caster.
pub struct Session {
    streamer: Streamer<BackgroundFetcher>,
    adapter: Adapter,
    info: AdapterInfo,
    frame_times: Vec<Duration>,
    /// When the command began.
    started: Instant,
    first_frame_at: Option<Duration>,
    nearly_converged_at: Option<Duration>,
    converged_at: Option<Duration>,
    requested_tau_px: f64,
    /// URL for view links; empty if the city has none.
    address: String,
    /// Where attributes come from.
    object_source: Option<(Arc<Http>, Arc<dyn ObjectSource>)>,
    proposal: Option<ShownProposal>,
}

impl Deref for Session {
    type Target = Streamer<BackgroundFetcher>;

    fn deref(&self) -> &Self::Target {
        &self.streamer
    }
}

impl DerefMut for Session {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut self.streamer
    }
}

impl Session {
    /// A session without any tiles. `started` is when the command began.
    pub fn new(
        tree: SceneTree,
        downloads: Downloads<BackgroundFetcher>,
        opened: OpenedAdapter,
        started: Instant,
    ) -> Self {
        Self::from_parts(Streamer::new(tree, downloads, opened.pages), opened.adapter, opened.info, started)
    }

    /// Like [`Session::new`] with an adapter that is still being opened. The tiles that `first` needs are fetched meanwhile.
    /// `pages` is the number of cache pages that the adapter is expected to hold. Fails if the adapter cannot be opened.
    pub fn open(
        tree: SceneTree,
        downloads: Downloads<BackgroundFetcher>,
        opening: JoinHandle<Result<OpenedAdapter>>,
        pages: u32,
        first: Option<&FrameRequest>,
        started: Instant,
    ) -> Result<Self> {
        let mut streamer = Streamer::new(tree, downloads, pages);
        if let Some(request) = first {
            streamer.select_and_request(request, started.elapsed());
            keep_fetching(&mut streamer, started, || opening.is_finished());
        }
        let failed = |_| ClientError::Graphics("opening the adapter panicked: try --adapter cpu".into());
        let OpenedAdapter { adapter, info, pages } = opening.join().map_err(failed)??;
        streamer.resize_cache(pages);
        Ok(Self::from_parts(streamer, adapter, info, started))
    }

    fn from_parts(
        streamer: Streamer<BackgroundFetcher>,
        adapter: Adapter,
        info: AdapterInfo,
        started: Instant,
    ) -> Self {
        Self {
            streamer,
            adapter,
            info,
            frame_times: Vec::new(),
            started,
            first_frame_at: None,
            nearly_converged_at: None,
            converged_at: None,
            requested_tau_px: 1.0,
            address: String::new(),
            object_source: None,
            proposal: None,
        }
    }

    /// The same session of the city at `address`, a URL for view links.
    pub fn with_address(self, address: String) -> Self {
        Self { address, ..self }
    }

    /// The same session, whose objects' attributes come from `source`.
    pub fn with_objects(self, http: Arc<Http>, source: Arc<dyn ObjectSource>) -> Self {
        Self { object_source: Some((http, source)), ..self }
    }

    /// The same session of a city with a proposal. To be called before the first frame. Fails if the cache has no room for what it adds.
    pub fn with_proposal(mut self, proposal: Option<ShownProposal>) -> Result<Self> {
        let Some(mut proposal) = proposal else { return Ok(self) };
        let added = self.streamer.set_additions(proposal.take_meshes(), &mut self.adapter);
        added.map_err(|error| ClientError::Usage(format!("--proposal: {error}")))?;
        self.proposal = Some(proposal);
        self.set_styles(ObjectStyles::default());
        Ok(self)
    }

    /// The proposal, if there is one.
    pub fn proposal(&self) -> Option<&ShownProposal> {
        self.proposal.as_ref()
    }

    /// Shows the city with or without the proposal from the next frame on.
    pub fn show_proposal(&mut self, is_shown: bool) {
        self.proposal.iter_mut().for_each(|proposal| proposal.set_shown(is_shown));
        self.streamer.show_additions(is_shown);
        self.set_styles(self.cache().styles().clone());
    }

    /// Opens the objects of the city. Fails if it has none, or if they cannot be fetched.
    pub fn open_objects(&self) -> Result<ObjectLookup> {
        self.object_opener()()
    }

    /// What opens the objects of the city, on any thread. Fails as [`Self::open_objects`] does.
    pub fn object_opener(&self) -> impl Fn() -> Result<ObjectLookup> + Send + use<> {
        let (source, origin) = (self.object_source.clone(), self.tree().manifest().origin);
        let added = self.proposal.as_ref().map(ShownProposal::objects).unwrap_or_default();
        move || {
            let (http, source) =
                source.clone().ok_or_else(|| ClientError::Failed("this city has no objects".into()))?;
            Ok(ObjectLookup::open(&http, source, origin)?.with_added(added.clone()))
        }
    }

    /// The object whose palette word has this address.
    pub fn object_at(&self, address: u32) -> Option<u32> {
        self.cache().object_at(address)
    }

    /// Draws objects in another way from the next frame on.
    pub fn set_styles(&mut self, mut styles: ObjectStyles) {
        self.proposal.iter().for_each(|proposal| proposal.hide_removed(&mut styles));
        self.streamer.set_styles(styles, &mut self.adapter);
    }

    /// The objects of the last frame's pixels, which showed [`Shading::Objects`](insula_shaders::layout::Shading::Objects).
    pub fn objects_of(&self, pixels: &Pixels) -> Vec<u32> {
        pixels.colour.iter().map(|address| self.cache().object_at(*address).unwrap_or(NO_OBJECT)).collect()
    }

    /// Prepares the next frame: takes in arrivals, selects, requests, and uploads.
    pub fn update(&mut self, request: &FrameRequest) {
        self.requested_tau_px = request.tau_px;
        self.streamer.update(request, &mut self.adapter, self.started.elapsed());
        if self.is_settled() {
            self.converged_at.get_or_insert(self.started.elapsed());
        }
    }

    /// Runs `draw` while another thread keeps fetching. The atlas does not change meanwhile.
    pub fn while_fetching<T>(&mut self, draw: impl FnOnce(&mut Adapter) -> T) -> T {
        let Self { streamer, adapter, started, .. } = self;
        if let Adapter::Cpu(cpu) = adapter {
            cpu.set_spares_core(!streamer.is_idle());
        }
        if streamer.is_idle() {
            return draw(adapter);
        }
        let is_drawn = AtomicBool::new(false);
        let notifier = streamer.downloads().fetcher().notifier();
        std::thread::scope(|scope| {
            let fetch = || keep_fetching(streamer, *started, || is_drawn.load(Ordering::Acquire));
            // If no thread can be spawned, fetching waits for the frame.
            let _thread = std::thread::Builder::new().name("insula-streaming".into()).spawn_scoped(scope, fetch);
            // The scope waits for the thread, so a panic in `draw` must end it too.
            let _end = EndFetching { is_drawn: &is_drawn, notifier: &notifier };
            draw(adapter)
        })
    }

    /// Draws `data`, waits for the pixels, and reports their hits. Fails if the adapter fails.
    pub fn render(&mut self, data: &FrameData) -> Result<Pixels> {
        let pixels = self.while_fetching(|adapter| adapter.draw(data))?;
        self.frame_drawn(data);
        self.report_hits(&data.query, &hit_counts(&pixels.hit, data.nodes.len()));
        Ok(pixels)
    }

    /// Draws more of a frame that is drawn in steps, for about `duration`. Returns how far it is, and the pixels of its sketch or of
    /// the whole frame, whose hits it reports. Does nothing on a GPU, which draws whole frames only.
    pub fn render_step(
        &mut self,
        data: &FrameData,
        frame: &mut SteppedFrame,
        duration: Duration,
    ) -> (FrameProgress, Option<Pixels>) {
        let Adapter::Cpu(cpu) = &mut self.adapter else { return (FrameProgress::Drawn, None) };
        let begin = Instant::now();
        let progress = cpu.draw_step(data, frame, || begin.elapsed() >= duration);
        let scene = cpu.scene_of(data);
        match progress {
            FrameProgress::Drawing => (progress, None),
            FrameProgress::Sketched => (progress, frame.sketch(&scene)),
            FrameProgress::Drawn => {
                let pixels = frame.develop(&scene);
                self.frame_drawn(data);
                self.report_hits(&data.query, &hit_counts(&pixels.hit, data.nodes.len()));
                (progress, Some(pixels))
            }
        }
    }

    /// Draws the last selection, waits for the pixels, and reports their hits. Fails if the adapter fails.
    pub fn draw(&mut self, request: &FrameRequest, settings: &RenderSettings) -> Result<Pixels> {
        self.render(&self.frame_data(request, settings))
    }

    /// One step of the idle prefetch for a request whose frame is settled. To be called after [`Session::update`] with the
    /// same request, until it is done. Fails if the adapter fails.
    pub fn prefetch(&mut self, request: &FrameRequest) -> Result<PrefetchStep> {
        match self.streamer.prefetch(request) {
            LookaheadState::Done => Ok(PrefetchStep::Done),
            LookaheadState::Waiting => Ok(PrefetchStep::Waiting),
            LookaheadState::Draw(data) => {
                let pixels = self.while_fetching(|adapter| adapter.draw(&data))?;
                let hits = hit_counts(&pixels.hit, data.nodes.len());
                self.streamer.report_prefetch_hits(request, &data.query, &hits);
                Ok(PrefetchStep::Drawn)
            }
        }
    }

    /// Records that a frame was drawn.
    pub fn frame_drawn(&mut self, data: &FrameData) {
        let elapsed = self.started.elapsed();
        if !data.nodes.is_empty() {
            self.first_frame_at.get_or_insert(elapsed);
            if data.error_px <= NEAR_TIMES_TAU * self.requested_tau_px {
                self.nearly_converged_at.get_or_insert(elapsed);
            }
        }
    }

    /// Records how long a frame took.
    pub fn record_frame_time(&mut self, time: Duration) {
        if self.frame_times.len() < MAX_FRAME_TIMES {
            self.frame_times.push(time);
        }
    }

    /// Waits until something has arrived, for at most `timeout`.
    pub fn wait(&self, timeout: Duration) {
        self.downloads().fetcher().notifier().wait(timeout);
    }

    /// The ray-caster.
    pub fn adapter_mut(&mut self) -> &mut Adapter {
        &mut self.adapter
    }
}

/// State of the session.
impl Session {
    /// Fails if the city has no usable root, if the server has not responded for `timeout`, or if no response has been complete
    /// for ten times as long.
    pub fn check(&self, timeout: Duration) -> Result<()> {
        self.streamer.check().map_err(|e| ClientError::Server(e.to_string()))?;
        let downloads = self.downloads();
        let has_lasted = |since: Option<Duration>, limit: Duration| {
            since.is_some_and(|since| self.started.elapsed().saturating_sub(since) >= limit)
        };
        let slow_limit = timeout.saturating_mul(SLOW_TIMES_TIMEOUT);
        if has_lasted(downloads.waiting_since(), slow_limit) {
            let (location, secs) = (downloads.fetcher().location(), slow_limit.as_secs());
            return Err(ClientError::NoResponse(format!(
                "{location} has sent no complete tile for {secs} s: check the network, or raise --timeout"
            )));
        }
        match downloads.failing_since() {
            since if has_lasted(since, timeout) => Err(ClientError::NoResponse(format!(
                "no response from {} for {} s ({}): check that the server runs, or raise --timeout",
                downloads.fetcher().location(),
                timeout.as_secs(),
                downloads.last_error()
            ))),
            _ => Ok(()),
        }
    }

    /// See [`Streamer::stream_status`].
    pub fn stream_status(&self) -> StreamStatus {
        self.streamer.stream_status(self.started.elapsed())
    }

    /// Tau of the last request.
    pub fn requested_tau_px(&self) -> f64 {
        self.requested_tau_px
    }

    /// For how long no request has succeeded; `None` while the server responds.
    pub fn failing_for(&self) -> Option<Duration> {
        Some(self.started.elapsed().saturating_sub(self.downloads().failing_since()?))
    }

    /// When the next retry may start although nothing arrives.
    pub fn retry_at(&self) -> Option<Instant> {
        self.downloads().retry_at().map(|at| self.started + at)
    }

    /// When a tile that was damaged repeatedly may be requested once more.
    pub fn recheck_at(&self) -> Option<Instant> {
        self.downloads().recheck_at().map(|at| self.started + at)
    }

    /// URL for view links; empty if the city has none.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Where the city is solid, as far as its resident tiles say.
    pub fn solids(&self) -> CitySolids<'_> {
        CitySolids::new(self.tree().manifest(), self.cache())
    }

    /// The ray-caster.
    pub fn adapter(&self) -> &Adapter {
        &self.adapter
    }

    /// Description of the ray-caster.
    pub fn adapter_info(&self) -> &AdapterInfo {
        &self.info
    }

    /// Number of frames that took at least `multiple` times the median.
    pub fn stalls(&self, multiple: f64) -> usize {
        let limit_ms = FrameTimes::new(&self.frame_times).median_ms * multiple;
        self.frame_times.iter().filter(|time| time.as_secs_f64() * 1e3 >= limit_ms).count()
    }

    /// The session's state at `t` seconds of a flight.
    pub fn flight_sample(&self, t: f64) -> FlightSample {
        let (stats, downloads) = (self.selection().stats, self.downloads());
        let http = downloads.fetcher().http();
        FlightSample {
            t,
            bytes: http.bytes(),
            requests: http.requests(),
            in_flight: downloads.in_flight(),
            cache_bytes: self.cache().used_bytes(),
            drawn: stats.drawn,
            fading: self.transitions().fading_count(),
            tau_px: stats.tau_px,
            worst_error_px: stats.worst_error_px,
            seen_error_px: stats.visible_error_px,
        }
    }

    /// What the session has cost so far.
    pub fn report(&self, tau_px: f64) -> RunReport {
        let (tree, cache, http) = (self.tree(), self.cache(), self.downloads().fetcher().http());
        let manifest = tree.manifest();
        let bad_meshes = |node: &TreeNode| node.lods.iter().filter(|lod| lod.tile.is_bad()).count();
        let bad_tiles = |node: &TreeNode| usize::from(node.tile.is_bad()) + bad_meshes(node);
        let bad = tree.nodes().map(bad_tiles).sum::<usize>() as u64;
        let stats = self.selection().stats;
        let secs = |time: Option<Duration>| time.map(|t| t.as_secs_f64());
        RunReport {
            city: manifest.name.clone(),
            version: manifest.version.clone(),
            bytes_fetched: http.bytes(),
            requests: http.requests(),
            tiles: TileCounts { bad, ..self.streamer.tile_counts() },
            frame_times: FrameTimes::new(&self.frame_times),
            time_to_first_picture_secs: secs(self.first_frame_at),
            time_to_near_picture_secs: secs(self.nearly_converged_at),
            time_to_converged_picture_secs: secs(self.converged_at),
            peak_cache_bytes: cache.peak_bytes(),
            cache_bytes: u64::from(cache.capacity_pages()) * PAGE_BYTES,
            adapter: self.info.clone(),
            tau_px,
            tau_reached_px: stats.tau_px,
            worst_error_px: stats.worst_error_px,
            nodes_drawn: stats.drawn,
            meshes_drawn: stats.meshes,
            triangles_drawn: stats.triangles,
            unconverged_share: None,
            camera_inside_solid: None,
        }
    }
}

/// Takes in arrivals and starts requests until `is_done`, which is checked at each notification and every
/// [`POLL_INTERVAL`].
fn keep_fetching(streamer: &mut Streamer<BackgroundFetcher>, started: Instant, is_done: impl Fn() -> bool) {
    let notifier = streamer.downloads().fetcher().notifier();
    let mut fine = streamer.fine_requests_per_frame();
    while !is_done() {
        notifier.wait(POLL_INTERVAL);
        streamer.update_while_drawing(&mut fine, started.elapsed());
    }
}

/// Ends [`keep_fetching`] when dropped.
struct EndFetching<'a> {
    is_drawn: &'a AtomicBool,
    notifier: &'a Arc<Notifier>,
}

impl Drop for EndFetching<'_> {
    fn drop(&mut self) {
        self.is_drawn.store(true, Ordering::Release);
        self.notifier.notify();
    }
}
