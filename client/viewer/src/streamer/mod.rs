//! The streaming policy: selects what a frame shows, requests what it lacks, and uploads what arrives.
//!
//! A shell calls [`Streamer::update`] before each frame, draws [`Streamer::frame_data`], and reports with
//! [`Streamer::report_hits`] which nodes the frame's rays hit. The network does not wait for frames: while one is drawn, the shell
//! calls [`Streamer::update_while_drawing`] at each arrival. Only uploads wait for the frame's end, because the ray-caster reads
//! the atlas. While a complete frame rests, the shell calls [`Streamer::prefetch`].
//!
//! Times are durations since the session's start.

mod adaptive_threshold;
mod downloads;
mod error;
mod frame_request;
mod idle_prefetch;
mod occlusion_gate;
mod request_grouping;
mod request_policy;
mod request_queue;
mod status;
#[cfg(test)]
mod tests;
mod tile_store;
mod upload_queue;

use crate::additions::{AdditionError, PackedAddition};
use crate::cache::{Upload, slots_for};
use crate::camera::{Camera, View};
use crate::frame::{FrameData, FrameInputs, RenderSettings};
use crate::node_boxes::box_edges;
use crate::objects::ObjectStyles;
use crate::scene::{SceneTree, TileKey};
use crate::select::occlusion_feedback::{OcclusionFeedback, OcclusionQuery};
use crate::select::priority::{PriorityGroup, TileRequest};
use crate::select::shadow_casters::{ShadowCasters, shadow_casters};
use crate::select::transitions::Transitions;
use crate::select::{Selection, SelectionScratch, select};
use adaptive_threshold::{AdaptiveThreshold, SelectionOutcome};
pub use downloads::{Downloads, FetchOutcome, TileFetcher};
pub use error::StreamError;
pub use frame_request::FrameRequest;
use glam::{DVec2, DVec3};
use idle_prefetch::Lookahead;
pub use idle_prefetch::{FEEDBACK_DOWNSCALE, LookaheadState};
use insula_protocol::TileKind;
use insula_shaders::stone::Stone;
use occlusion_gate::OcclusionGate;
use request_policy::{RequestPhase, RequestPolicy};
pub use status::StreamStatus;
use std::collections::HashSet;
use std::time::Duration;
use tile_store::TileStore;
pub use upload_queue::TileCounts;

/// Share of the cache that one view may fill. The rest keeps what was needed recently.
const BUDGET_SHARE: f64 = 0.85;
/// Share of the cache, in 1/32, that shadow casters leave free.
const SHADOW_RESERVE: u32 = 32;
/// Requests for fine tiles that may start while one frame is drawn, as a multiple of the requests that may be in flight.
const FINE_LIMIT_FACTOR: usize = 2;
/// Frames that the first occlusion feedback is waited for. A shell that never reports any gets all tiles after that.
const MAX_BLIND_FRAMES: u32 = 8;

/// Everything of a session except drawing.
pub struct Streamer<F> {
    tiles: TileStore,
    downloads: Downloads<F>,
    selection: Selection,
    feedback: OcclusionFeedback,
    transitions: Transitions,
    lookahead: Lookahead,
    occlusion_gate: OcclusionGate,
    threshold: AdaptiveThreshold,
    scratch: SelectionScratch,
    /// Direction to the sun, if it casts shadows.
    sun: Option<DVec3>,
    /// Shadow casters of the last selection.
    casters: ShadowCasters,
    /// Counts draw lists that differ from the one before.
    generation: u64,
    last_view: Option<View>,
    last_request: Option<FrameRequest>,
    selected_at: Duration,
    updated_at: Duration,
    /// Tiles or feedback arrived after the last selection.
    has_news: bool,
    /// Frames drawn before the first occlusion feedback.
    blind_frames: u32,
}

impl<F: TileFetcher> Streamer<F> {
    /// A streamer without any tile. The cache has `pages` pages.
    pub fn new(tree: SceneTree, downloads: Downloads<F>, pages: u32) -> Self {
        Self {
            tiles: TileStore::new(tree, pages),
            downloads,
            selection: Selection::default(),
            feedback: OcclusionFeedback::default(),
            transitions: Transitions::default(),
            lookahead: Lookahead::default(),
            occlusion_gate: OcclusionGate::default(),
            threshold: AdaptiveThreshold::default(),
            scratch: SelectionScratch::default(),
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
        self.tiles.resize_cache(pages);
    }

    /// Has a cache of at least `pages` pages from now on, as the atlas has that is drawn from. What is resident stays.
    pub fn grow_cache(&mut self, pages: u32) {
        self.tiles.grow_cache(pages);
    }

    /// Draws objects in another way from the next frame on.
    pub fn set_styles(&mut self, styles: ObjectStyles, upload: &mut impl Upload) {
        self.tiles.cache.set_styles(styles, upload);
    }

    /// Draws the landmarks of stone `number` in another stone from the next frame on.
    pub fn set_stone(&mut self, number: usize, stone: Stone) {
        self.tiles.tree.set_stone(number, stone);
    }

    /// See [`AtlasCache::set_additions`](crate::cache::AtlasCache::set_additions).
    pub fn set_additions(
        &mut self,
        additions: Vec<PackedAddition>,
        upload: &mut impl Upload,
    ) -> Result<(), AdditionError> {
        self.tiles.cache.set_additions(additions, upload)
    }

    /// Shows or hides what is added, from the next frame on. What its rays hit is not known yet.
    pub fn show_additions(&mut self, are_shown: bool) {
        self.tiles.cache.show_additions(are_shown);
        self.generation += 1;
        self.lookahead.reset();
        self.has_news = true;
    }

    /// The view of a request seen from `camera`, with this cache's budget.
    pub fn view(&self, request: &FrameRequest, camera: Camera) -> View {
        let pages = f64::from(self.tiles.cache.tile_pages()) * BUDGET_SHARE;
        View {
            camera,
            width_px: request.size_px[0],
            height_px: request.size_px[1],
            tau_px: request.tau_px * self.threshold.factor(),
            switching: request.switching,
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
        self.generation += u64::from(self.transitions.step(&self.selection, &self.tiles.tree, secs));
    }

    /// Selects for `request` and requests missing tiles. Uploads nothing, so it needs no adapter.
    pub fn select_and_request(&mut self, request: &FrameRequest, now: Duration) {
        self.select(request, now);
        let is_waiting = self.is_blind() && self.blind_frames < MAX_BLIND_FRAMES;
        let phase = if is_waiting { RequestPhase::BeforeFeedback } else { RequestPhase::BetweenFrames };
        let requests = self.choose_requests(request, phase, now);
        self.blind_frames += u32::from(is_waiting && !self.selection.draw_tiles.is_empty());
        self.start_requests(request, &requests, now);
    }

    /// Requests for fine tiles that may start while the next frame is drawn: the initial value of
    /// [`Self::update_while_drawing`]'s `fine`.
    pub fn fine_requests_per_frame(&self) -> usize {
        FINE_LIMIT_FACTOR * self.downloads.limit()
    }

    /// Takes in arrivals and starts further requests for the last [`FrameRequest`] while its frame is drawn.
    ///
    /// The frame shows which tiles are visible, so only `fine` of the tiles without a large error are requested until then; the
    /// number is reduced by those started.
    pub fn update_while_drawing(&mut self, fine: &mut usize, now: Duration) {
        let Some(request) = self.last_request else { return };
        // Nothing is uploaded during the frame, so only new nodes can change the requests.
        if self.receive(now) {
            self.select(&request, now);
        }
        let phase =
            if self.is_blind() { RequestPhase::BeforeFeedback } else { RequestPhase::WhileDrawing { fine: *fine } };
        let requests = self.choose_requests(&request, phase, now);
        *fine = fine.saturating_sub(self.start_requests(&request, &requests, now));
    }

    /// Starts requests for the most important tiles. Others of the selection come along where one request can fetch them together.
    /// Returns how many tiles were requested.
    fn start_requests(&mut self, request: &FrameRequest, chosen: &[TileRequest], now: Duration) -> usize {
        let is_bounded = self.lookahead.is_of(request) || self.is_blind();
        let companions = if is_bounded { chosen } else { &self.selection.requests };
        self.downloads.request(&mut self.tiles.tree, chosen, companions, now)
    }

    /// The tiles to request now: those of the idle prefetch while that runs, else those of the frame in this `phase`.
    fn choose_requests(&self, request: &FrameRequest, phase: RequestPhase, now: Duration) -> Vec<TileRequest> {
        let policy = RequestPolicy {
            tree: &self.tiles.tree,
            downloads: &self.downloads,
            gate: &self.occlusion_gate,
            view: self.last_view.as_ref().filter(|_| !self.is_blind()),
            tau_px: request.tau_px,
            now,
        };
        if self.lookahead.is_of(request) {
            let spare_pages = self.tiles.spare_pages();
            policy.choose(&self.lookahead.selection.requests, RequestPhase::Prefetch { spare_pages })
        } else {
            policy.choose(&self.selection.requests, phase)
        }
    }

    fn select(&mut self, request: &FrameRequest, now: Duration) {
        self.tiles.cache.begin_frame();
        self.has_news = false;
        if self.lookahead.is_of(request) {
            // The frame is complete: tiles that arrive for the prefetch must not change it.
            self.pin_used_tiles();
            self.select_prefetch(request);
            return;
        }
        self.lookahead.reset();
        let view = self.view(request, request.camera);
        let has_moved = self.last_request.replace(*request) != Some(*request);
        let selection = select(&view, &self.tiles.tree, &self.feedback, &mut self.scratch);
        if selection.draw_tiles != self.selection.draw_tiles || self.last_view != Some(view) {
            self.generation += 1;
        }
        (self.selection, self.last_view) = (selection, Some(view));
        let stats = self.selection.stats;
        self.threshold.update(SelectionOutcome {
            factor: stats.tau_px / request.tau_px,
            budget_share: f64::from(stats.pages) / f64::from(view.budget_pages.max(1)),
            secs: now.saturating_sub(self.selected_at).as_secs_f64(),
            has_moved,
        });
        self.selected_at = now;
        self.select_shadow_casters(&view);
        self.mark_used_subtrees();
        self.pin_used_tiles();
        if let Some(heading) = request.heading {
            self.preload(request, heading);
        }
    }

    /// Marks the subtrees that the last selection needs, which are not evicted. Drops requests for more than fit beside them.
    fn mark_used_subtrees(&mut self) {
        let tree = &mut self.tiles.tree;
        tree.begin_frame();
        let visited = self.scratch.visited_nodes().chain(self.casters.visited.iter().copied());
        visited.for_each(|node| tree.mark_visited(node));
        self.transitions.fading_sources().for_each(|(node, _)| tree.mark_used(node));
        self.selection.used_subtrees.iter().for_each(|root| tree.mark_subtree_used(*root));
        let mut requestable = tree.requestable_subtrees();
        self.selection.requests.retain(|request| {
            let is_subtree = request.key.kind() == TileKind::Subtree;
            let is_kept = !is_subtree || requestable > 0;
            requestable = requestable.saturating_sub(usize::from(is_subtree));
            is_kept
        });
    }

    /// Pins the tiles of the last selection in the cache.
    fn pin_used_tiles(&mut self) {
        let TileStore { tree, cache, .. } = &mut self.tiles;
        for (node, drawn) in self.transitions.fading_sources() {
            cache.promote(TileKey::block_map(tree.node(drawn.source).id));
            drawn.mesh_lod.iter().for_each(|lod| cache.promote(TileKey::mesh(tree.node(node).id, *lod)));
        }
        // The coarsest last, so that it is evicted last among equals.
        for node in self.selection.used_nodes.iter().rev() {
            cache.pin(TileKey::block_map(tree.node(*node).id));
        }
        for key in &self.selection.used_meshes {
            cache.pin(*key);
        }
        for node in self.casters.nodes.iter().rev() {
            cache.pin(TileKey::block_map(tree.node(*node).id));
        }
    }

    /// Selects the shadow casters of the last selection, within the budget that it leaves.
    fn select_shadow_casters(&mut self, view: &View) {
        let stats = &self.selection.stats;
        let capacity = self.tiles.cache.tile_pages();
        let budget_pages = (capacity - capacity / SHADOW_RESERVE).saturating_sub(stats.pages);
        let budget_nodes = slots_for(capacity).saturating_sub(stats.visited);
        let view = View { budget_pages, budget_nodes, tau_px: stats.tau_px, ..*view };
        let receivers = self.feedback.has_feedback().then_some(&self.selection);
        self.casters = self.sun.map(|sun| shadow_casters(&view, sun, &self.tiles.tree, receivers)).unwrap_or_default();
        let wanted: HashSet<TileKey> = self.selection.requests.iter().map(|w| w.key).collect();
        self.selection.requests.extend(self.casters.requests.iter().filter(|w| !wanted.contains(&w.key)));
    }

    /// Adds what a moving camera will need soon, as long as nothing is urgent and cache pages are free.
    fn preload(&mut self, request: &FrameRequest, heading: Camera) {
        let is_urgent = self.selection.requests.iter().any(|w| w.group == PriorityGroup::Urgent);
        if is_urgent || self.tiles.spare_pages() == 0 {
            return;
        }
        let ahead = select(&self.view(request, heading), &self.tiles.tree, &self.feedback, &mut self.scratch);
        let has_room = self.tiles.tree.prefetchable_subtrees() > 0;
        for mut wanted in ahead.requests {
            let fits = has_room || wanted.key.kind() != TileKind::Subtree;
            if fits && !self.selection.requests.iter().any(|w| w.key == wanted.key) {
                wanted.group = PriorityGroup::Preload;
                self.selection.requests.push(wanted);
            }
        }
    }

    /// Takes in what has arrived. Returns whether nodes became known.
    fn receive(&mut self, now: Duration) -> bool {
        let received = self.tiles.receive(&mut self.downloads, now);
        self.has_news |= received.has_tiles;
        received.has_nodes
    }

    /// Uploads as much as a frame has time for. Returns whether anything was uploaded.
    fn upload(&mut self, upload: &mut impl Upload, now: Duration) -> bool {
        self.occlusion_gate.drop_expired(now);
        let uploaded = self.tiles.upload(upload, now);
        for key in &uploaded {
            self.occlusion_gate.tile_arrived(*key, self.generation + 1, now);
        }
        !uploaded.is_empty()
    }

    /// Takes in how many pixels of a frame hit each of the nodes that it was drawn with.
    pub fn report_hits(&mut self, query: &OcclusionQuery, pixels: &[u32]) {
        if !self.feedback.covers(query.generation, [query.view.width_px, query.view.height_px]) {
            let is_complete = self.is_fetched();
            self.feedback.update(query, pixels, is_complete, &self.tiles.tree);
            self.occlusion_gate.feedback_received(query.generation);
            self.lookahead.reset();
            self.has_news = true;
        }
    }

    /// Next step of the idle prefetch for a request whose frame is complete. To be called after [`Streamer::update`] with the same
    /// request until it is done.
    pub fn prefetch(&mut self, request: &FrameRequest) -> LookaheadState {
        if self.last_request != Some(*request) || !self.is_settled() || self.is_blind() {
            return LookaheadState::Done;
        }
        if !self.lookahead.is_of(request) {
            self.lookahead.begin(request, &self.feedback);
            self.select_prefetch(request);
        }
        let size_px = request.size_px.map(|side| (side / FEEDBACK_DOWNSCALE).max(1));
        while let Some(camera) = self.lookahead.camera() {
            if !self.lookahead.has_feedback(size_px) {
                let view = self.view(&FrameRequest { size_px, ..*request }, camera);
                let data = self.lookahead.frame_data(&self.tiles.tree, &self.tiles.cache, &view);
                return LookaheadState::Draw(data.into());
            }
            if !self.is_prefetch_fetched() {
                return LookaheadState::Waiting;
            }
            self.lookahead.next(&self.feedback);
            self.select_prefetch(request);
        }
        LookaheadState::Done
    }

    /// Takes in what the rays of a side view's frame hit.
    pub fn report_prefetch_hits(&mut self, request: &FrameRequest, query: &OcclusionQuery, pixels: &[u32]) {
        let is_complete = self.is_prefetch_fetched();
        self.lookahead.feedback.update(query, pixels, is_complete, &self.tiles.tree);
        self.occlusion_gate.complete_feedback_received();
        self.select_prefetch(request);
    }

    /// Selects the current side view. Ends the prefetch if its next tile does not fit into free pages.
    fn select_prefetch(&mut self, request: &FrameRequest) {
        if let Some(camera) = self.lookahead.camera() {
            let view = self.view(request, camera);
            self.lookahead.select(&view, &self.tiles.tree, &mut self.scratch);
        }
        let next = self.lookahead.selection.requests.first();
        let does_not_fit = |key: TileKey| match key.kind() {
            TileKind::Subtree => self.tiles.tree.prefetchable_subtrees() == 0,
            _ => self.tiles.tree.tile_pages(key) > self.tiles.spare_pages(),
        };
        if self.tiles.uploads.is_empty() && next.is_some_and(|w| does_not_fit(w.key)) {
            self.lookahead.end();
        }
    }

    /// Sets the direction to the sun if objects outside of the view are to cast shadows into it
    /// ([`RenderSettings::shadow_casting_sun`]).
    pub fn set_sun(&mut self, sun: Option<DVec3>) {
        if self.sun != sun {
            self.sun = sun;
            self.lookahead.reset();
        }
    }

    /// Multiplies tau by at least `factor` from the next frame on: more than 1 where frames of a moving view are too slow.
    pub fn set_tau_factor(&mut self, factor: f64) {
        if self.threshold.set_for_speed(factor) {
            self.lookahead.reset();
            // The next selection is of another view, whose hits only a frame tells, although nothing moves.
            self.has_news = true;
        }
    }

    /// Whether levels of detail cross-fade ([`Transitions`]). Off by default.
    pub fn set_transitions(&mut self, is_enabled: bool) {
        self.transitions.set_enabled(is_enabled);
    }

    /// Ends all cross-fades: the next frame shows the selection as it is.
    pub fn end_transitions(&mut self) {
        self.transitions.reset();
    }

    /// The boxes of the last selection's nodes, in the frame of a request ([`box_edges`]).
    pub fn box_edges(&self, request: &FrameRequest) -> Vec<[DVec2; 2]> {
        box_edges(self.tree(), &self.selection, &self.view(request, request.camera))
    }

    /// Arrays for the ray-caster, for the last selection.
    pub fn frame_data(&self, request: &FrameRequest, settings: &RenderSettings) -> FrameData {
        let inputs = FrameInputs {
            transitions: &self.transitions,
            shadow_casters: &self.casters.nodes,
            generation: self.generation,
            error_px: self.selection.stats.visible_error_px,
        };
        let view = self.view(request, request.camera);
        FrameData::new(inputs, &self.tiles.tree, &self.tiles.cache, &view, settings)
    }
}
