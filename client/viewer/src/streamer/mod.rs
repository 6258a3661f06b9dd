//! The streaming policy: selects what a frame shows, requests what it lacks, and uploads what arrives.
//!
//! A shell calls [`Streamer::update`] before each frame, draws [`Streamer::frame_data`], and reports with
//! [`Streamer::report_hits`] which nodes the frame's rays hit. The network does not wait for frames: while one is drawn, the shell
//! calls [`Streamer::update_while_drawing`] at each arrival. Only uploads wait for the frame's end, because the ray-caster reads the atlas.
//!
//! Times are given as durations since the session's start.

mod adaptive_threshold;
pub mod downloads;
mod idle_prefetch;
mod occlusion_gate;
mod pending_subtrees;
mod request_policy;
pub mod request_queue;
#[cfg(test)]
mod tests;
mod upload_queue;

use crate::{
    cache::{AtlasCache, PackedTile, Upload, slots_for},
    camera::{Camera, View},
    frame::{FrameData, FrameInputs, RenderSettings},
    scene::{SceneTree, TileKey},
    select::{
        Selection, SelectionScratch, SelectionStats,
        occlusion_feedback::{OcclusionFeedback, OcclusionQuery},
        priority::PriorityGroup,
        select,
        shadow_casters::{ShadowCasters, shadow_casters},
        transitions::Transitions,
    },
};
use adaptive_threshold::AdaptiveThreshold;
pub use downloads::{Arrival, Downloads, FetchError, FetchOutcome, TileFetcher};
use glam::DVec3;
use idle_prefetch::Lookahead;
pub use idle_prefetch::{FEEDBACK_DOWNSCALE, LookaheadState};
use insula_protocol::TileId;
use occlusion_gate::OcclusionGate;
use pending_subtrees::PendingSubtrees;
use serde::Serialize;
use std::{collections::HashSet, time::Duration};
use upload_queue::{UploadQueue, UploadTarget};

/// Share of the cache that one view may fill. The rest keeps what was needed recently.
const BUDGET_SHARE: f64 = 0.85;
/// Share of the cache that prefetching leaves free.
const SPARE_SHARE: f64 = 0.1;
/// Requests for fine tiles that may start while one frame is drawn, as a multiple of the requests that may be in flight.
const FINE_TIMES_LIMIT: usize = 2;

/// What a frame is to show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameRequest {
    /// Camera of the frame.
    pub camera: Camera,
    /// Where a moving camera will be in half a second: its tiles are prefetched.
    pub heading: Option<Camera>,
    /// Width and height in pixels.
    pub size_px: [u32; 2],
    /// Tolerated screen-space error in pixels.
    pub tau_px: f64,
}

/// Tiles that became resident, by kind.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct TileCounts {
    /// V-BlockMaps.
    pub blockmaps: u64,
    /// Subtrees.
    pub subtrees: u64,
    /// Meshes of leaves; each level of detail counts.
    pub meshes: u64,
    /// Tiles that were given up: missing on the server, or damaged repeatedly.
    pub bad: u64,
}

/// Why a city cannot be shown.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StreamError {
    /// The root tile or the root subtree is bad.
    #[error("the root tile of city {city} is missing or damaged: run insula-server verify on the city")]
    RootUnusable {
        /// Name of the city.
        city: String,
    },
    /// The source will never serve the city.
    #[error("{0}")]
    Fatal(String),
}

/// Everything of a session except drawing.
pub struct Streamer<F> {
    tree: SceneTree,
    cache: AtlasCache,
    downloads: Downloads<F>,
    selection: Selection,
    feedback: OcclusionFeedback,
    transitions: Transitions,
    lookahead: Lookahead,
    uploads: UploadQueue,
    pending_subtrees: PendingSubtrees,
    occlusion_gate: OcclusionGate,
    adaptive: AdaptiveThreshold,
    scratch: SelectionScratch,
    counts: TileCounts,
    /// Direction to the sun if it casts shadows, and the shadow casters of the last selection.
    sun: Option<DVec3>,
    casters: ShadowCasters,
    /// Counts draw lists that differ from the one before.
    generation: u64,
    last_view: Option<View>,
    last_request: Option<FrameRequest>,
    selected_at: Duration,
    updated_at: Duration,
    /// Something arrived after the last selection.
    has_news: bool,
    /// Frames drawn before the first occlusion feedback.
    blind_frames: u32,
}

impl<F: TileFetcher> Streamer<F> {
    /// Nothing fetched yet. The cache has `pages` pages.
    pub fn new(tree: SceneTree, downloads: Downloads<F>, pages: u32) -> Self {
        Self {
            tree,
            cache: AtlasCache::new(pages),
            downloads,
            selection: Selection::default(),
            feedback: OcclusionFeedback::default(),
            transitions: Transitions::default(),
            lookahead: Lookahead::default(),
            uploads: UploadQueue::default(),
            pending_subtrees: PendingSubtrees::default(),
            occlusion_gate: OcclusionGate::default(),
            adaptive: AdaptiveThreshold::default(),
            scratch: SelectionScratch::default(),
            counts: TileCounts::default(),
            sun: None,
            casters: ShadowCasters::default(),
            generation: 0,
            last_view: None,
            last_request: None,
            selected_at: Duration::ZERO,
            updated_at: Duration::ZERO,
            has_news: false,
            blind_frames: 0,
        }
    }

    /// Replaces the empty cache by one of `pages` pages, once the adapter is open.
    pub fn resize_cache(&mut self, pages: u32) {
        self.cache = AtlasCache::new(pages);
    }

    /// The view of a request seen from `camera`, with this cache's budget.
    pub fn view(&self, request: &FrameRequest, camera: Camera) -> View {
        let pages = f64::from(self.cache.capacity_pages()) * BUDGET_SHARE;
        View {
            camera,
            width_px: request.size_px[0],
            height_px: request.size_px[1],
            tau_px: request.tau_px * self.adaptive.times(),
            budget_pages: pages as u32,
            budget_nodes: slots_for(pages as u32),
        }
    }

    /// Prepares the next frame: takes in arrivals, selects, requests, and uploads.
    pub fn update(&mut self, request: &FrameRequest, upload: &mut impl Upload, now: Duration) {
        self.receive(now);
        self.select_and_request(request, now);
        if self.upload(upload, now) {
            // The uploaded tiles are drawn in this frame.
            self.select_and_request(request, now);
        }
        let secs = now.saturating_sub(self.updated_at).as_secs_f64();
        self.updated_at = now;
        // Another draw list than that of the last frame: what its rays hit is not known yet.
        self.generation += u64::from(self.transitions.step(&self.selection, &self.tree, secs));
    }

    /// Selects for `request` and requests missing tiles, without an adapter: nothing is uploaded.
    pub fn select_and_request(&mut self, request: &FrameRequest, now: Duration) {
        self.select(request, now);
        let requests = if self.lookahead.is_of(request) {
            self.requests_of_prefetch(now)
        } else {
            self.requests_between_frames(request.tau_px, now)
        };
        self.downloads.request(&mut self.tree, &requests, now);
    }

    /// Requests for fine tiles that may start while the next frame is drawn: the initial value of
    /// [`Self::update_while_drawing`]'s `fine`.
    pub fn fine_requests_per_frame(&self) -> usize {
        FINE_TIMES_LIMIT * self.downloads.limit()
    }

    /// Takes in arrivals and starts further requests for the last [`FrameRequest`] while its frame is drawn. The frame will tell which
    /// tiles are visible, so only `fine` of the tiles that are not coarse are requested until then; the number is reduced by those started.
    pub fn update_while_drawing(&mut self, fine: &mut usize, now: Duration) {
        let Some(request) = self.last_request else { return };
        // Nothing is uploaded meanwhile: only new nodes can change what is wanted.
        if self.receive(now) {
            self.select(&request, now);
        }
        let requests = if self.lookahead.is_of(&request) {
            self.requests_of_prefetch(now)
        } else {
            self.requests_while_drawing(request.tau_px, *fine, now)
        };
        *fine = fine.saturating_sub(self.downloads.request(&mut self.tree, &requests, now));
    }

    fn select(&mut self, request: &FrameRequest, now: Duration) {
        self.cache.begin_frame();
        self.has_news = false;
        if self.lookahead.is_of(request) {
            // The frame is complete: tiles that arrive for the prefetch must not change it.
            self.touch_used();
            self.select_prefetch(request);
            return;
        }
        self.lookahead.forget();
        let view = self.view(request, request.camera);
        let has_moved = self.last_request.replace(*request) != Some(*request);
        let selection = select(&view, &self.tree, &self.feedback, &mut self.scratch);
        if selection.draw_tiles != self.selection.draw_tiles || self.last_view != Some(view) {
            self.generation += 1;
        }
        (self.selection, self.last_view) = (selection, Some(view));
        let SelectionStats { tau_px, pages, .. } = self.selection.stats;
        let share = f64::from(pages) / f64::from(view.budget_pages.max(1));
        let secs = now.saturating_sub(self.selected_at).as_secs_f64();
        self.adaptive.learn(tau_px / request.tau_px, share, secs, has_moved);
        self.selected_at = now;
        self.select_shadow_casters(&view);
        self.touch_used();
        if let Some(heading) = request.heading {
            self.preload(request, heading);
        }
    }

    /// Pins everything that the selection uses in the cache.
    fn touch_used(&mut self) {
        for (square, face) in self.transitions.fading_sources() {
            self.cache.promote(TileKey::block_map(self.tree.node(face.source).id));
            let leaf = self.tree.node(square).id;
            face.mesh_lod.iter().for_each(|lod| self.cache.promote(TileKey::mesh(leaf, *lod)));
        }
        // The coarsest last, so that it is evicted last among equals.
        for at in self.selection.used_nodes.iter().rev() {
            self.cache.pin(TileKey::block_map(self.tree.node(*at).id));
        }
        for key in &self.selection.used_meshes {
            self.cache.pin(*key);
        }
        for at in self.casters.nodes.iter().rev() {
            self.cache.pin(TileKey::block_map(self.tree.node(*at).id));
        }
    }

    /// Selects what casts shadows on the last selection, within the budget that it leaves.
    fn select_shadow_casters(&mut self, view: &View) {
        let Selection { stats: counters, .. } = &self.selection;
        let capacity = self.cache.capacity_pages();
        let budget_pages = (capacity - capacity / 32).saturating_sub(counters.pages);
        let budget_nodes = slots_for(capacity).saturating_sub(counters.visited);
        let view = View { budget_pages, budget_nodes, tau_px: counters.tau_px, ..*view };
        let receivers = self.feedback.has_feedback().then_some(&self.selection);
        self.casters = self.sun.map(|sun| shadow_casters(&view, sun, &self.tree, receivers)).unwrap_or_default();
        let wanted: HashSet<TileKey> = self.selection.requests.iter().map(|w| w.key).collect();
        self.selection.requests.extend(self.casters.requests.iter().filter(|w| !wanted.contains(&w.key)));
    }

    /// Adds what a moving camera will need soon, as long as nothing is urgent and cache pages are free.
    fn preload(&mut self, request: &FrameRequest, heading: Camera) {
        if self.selection.requests.iter().any(|w| w.group == PriorityGroup::Urgent) || self.spare_pages() == 0 {
            return;
        }
        let ahead = select(&self.view(request, heading), &self.tree, &self.feedback, &mut self.scratch);
        for mut wanted in ahead.requests {
            if !self.selection.requests.iter().any(|w| w.key == wanted.key) {
                wanted.group = PriorityGroup::Preload;
                self.selection.requests.push(wanted);
            }
        }
    }

    /// Pages that may be filled while [`SPARE_SHARE`] stays free.
    fn spare_pages(&self) -> u32 {
        let kept = (SPARE_SHARE * f64::from(self.cache.capacity_pages())) as u32;
        self.cache.free_pages().saturating_sub(kept).saturating_sub(self.uploads.pages())
    }

    /// Takes in what has arrived. Returns whether nodes became known.
    fn receive(&mut self, now: Duration) -> bool {
        let known = self.tree.nodes().len();
        while self.uploads.has_room()
            && let Some(arrival) = self.downloads.poll(&mut self.tree, now)
        {
            self.has_news = true;
            match arrival {
                Arrival::Subtree(key, subtree) => {
                    self.counts.subtrees += self.pending_subtrees.push(key, subtree, &mut self.tree);
                }
                Arrival::Node(key, node) => {
                    self.tree.set_pages(key.id, node.pages.len() as u32);
                    self.uploads.push(key, PackedTile::Node(node));
                }
                Arrival::Mesh(key, mesh) => {
                    self.tree.set_mesh_pages(key, mesh.pages.len() as u32);
                    self.uploads.push(key, PackedTile::Mesh(mesh));
                }
            }
        }
        self.tree.nodes().len() > known
    }

    /// Uploads as much as a frame has time for. Returns whether anything was uploaded.
    fn upload(&mut self, upload: &mut impl Upload, now: Duration) -> bool {
        self.occlusion_gate.pass(now);
        let target = UploadTarget { tree: &mut self.tree, cache: &mut self.cache, upload };
        let uploaded = self.uploads.flush(target, &mut self.counts, now);
        for key in &uploaded {
            self.occlusion_gate.came(*key, self.generation + 1, now);
        }
        !uploaded.is_empty()
    }

    /// Takes in how many pixels of a frame hit each of the nodes that it was drawn with.
    pub fn report_hits(&mut self, query: &OcclusionQuery, pixels: &[u32]) {
        if !self.feedback.covers(query.generation, [query.view.width_px, query.view.height_px]) {
            let is_complete = self.is_fetched();
            self.feedback.update(query, pixels, is_complete, &self.tree);
            self.occlusion_gate.told(query.generation);
            self.lookahead.forget();
            self.has_news = true;
        }
    }

    /// Sets the direction to the sun if objects outside of the view are to cast shadows into it
    /// ([`RenderSettings::shadow_casting_sun`]).
    pub fn set_sun(&mut self, sun: Option<DVec3>) {
        if self.sun != sun {
            self.sun = sun;
            self.lookahead.forget();
        }
    }

    /// Whether levels of detail cross-fade ([`Transitions`]). Off by default.
    pub fn set_transitions(&mut self, is_on: bool) {
        self.transitions.set_enabled(is_on);
    }

    /// Ends all cross-fades: the next frame shows the selection as it is.
    pub fn end_transitions(&mut self) {
        self.transitions.reset();
    }

    /// Arrays for the ray-caster, for the last selection.
    pub fn frame_data(&self, request: &FrameRequest, settings: &RenderSettings) -> FrameData {
        let (fades, casters) = (&self.transitions, &self.casters.nodes[..]);
        let error_px = self.selection.stats.visible_error_px;
        let inputs = FrameInputs { transitions: fades, shadow_casters: casters, generation: self.generation, error_px };
        FrameData::new(inputs, &self.tree, &self.cache, &self.view(request, request.camera), settings)
    }
}

/// State of the session.
impl<F: TileFetcher> Streamer<F> {
    /// Fails if the city has no usable root, or its source will never serve it.
    pub fn check(&self) -> Result<(), StreamError> {
        let root = [TileKey::subtree(TileId::ROOT), TileKey::block_map(TileId::ROOT)];
        if root.iter().any(|key| self.tree.tile(*key).is_some_and(|tile| tile.is_bad())) {
            return Err(StreamError::RootUnusable { city: self.tree.manifest().name.clone() });
        }
        self.downloads.fatal_error().map_or(Ok(()), |why| Err(StreamError::Fatal(why.to_owned())))
    }

    /// Whether nothing can improve the last selection's frame: all tiles are resident, nothing fades, and feedback
    /// changed nothing.
    pub fn is_settled(&self) -> bool {
        self.is_fetched()
            && !self.adaptive.moves()
            && self.transitions.fading_count() == 0
            && (self.has_feedback([0, 0]) || !self.feedback.has_feedback())
    }

    /// Whether everything that the last selection asks for is resident.
    pub fn is_fetched(&self) -> bool {
        let is_uploaded = self.uploads.is_empty() || self.is_prefetching();
        self.tree.root().is_some() && self.selection.requests.is_empty() && is_uploaded
    }

    /// Whether the hits of the last selection are known from a frame of at least this size, and changed nothing.
    pub fn has_feedback(&self, size_px: [u32; 2]) -> bool {
        self.feedback.covers(self.generation, size_px)
    }

    /// Whether the next frame has something to upload or to select again, so that it need not wait for an arrival.
    pub fn has_work(&self) -> bool {
        let arrived = !self.uploads.is_empty() || self.has_news;
        arrived && !self.is_prefetching() || self.adaptive.moves() || self.transitions.fading_count() > 0
    }

    /// Whether nothing is wanted and nothing is in flight.
    pub fn is_idle(&self) -> bool {
        self.selection.requests.is_empty() && self.downloads.in_flight() == 0
    }

    /// Whether the last selection's frame lacks tiles, prefetched ones aside.
    pub fn lacks_tiles(&self) -> bool {
        self.selection.requests.iter().any(|wanted| wanted.group != PriorityGroup::Preload)
    }

    /// Whether arrivals belong to the idle prefetch rather than to the frame.
    fn is_prefetching(&self) -> bool {
        self.last_request.is_some_and(|request| self.lookahead.is_of(&request))
    }

    /// The scene tree.
    pub fn tree(&self) -> &SceneTree {
        &self.tree
    }

    /// The tile cache.
    pub fn cache(&self) -> &AtlasCache {
        &self.cache
    }

    /// The requests in flight.
    pub fn downloads(&self) -> &Downloads<F> {
        &self.downloads
    }

    /// The last selection.
    pub fn selection(&self) -> &Selection {
        &self.selection
    }

    /// The hits of the last frames.
    pub fn feedback(&self) -> &OcclusionFeedback {
        &self.feedback
    }

    /// The cross-fades of the last frame.
    pub fn transitions(&self) -> &Transitions {
        &self.transitions
    }

    /// Tiles that became resident so far.
    pub fn tile_counts(&self) -> TileCounts {
        self.counts
    }

    /// Tiles that were evicted from the cache so far.
    pub fn evicted(&self) -> u64 {
        self.uploads.evicted()
    }

    /// Tiles that were fetched again after their eviction.
    pub fn fetched_again(&self) -> u64 {
        self.uploads.fetched_again()
    }
}
