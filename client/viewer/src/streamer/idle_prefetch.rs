//! Idle prefetch: while the camera rests and nothing is missing, the tiles that a turn of 30 degrees to either side would show
//! are fetched.
//!
//! Each side view is selected like the frame itself, by what its own rays hit, so that occluded tiles are not fetched. Its
//! occlusion feedback starts from that of the frame and is refined by small frames, which the shell draws but does not show.

use super::{FrameRequest, Streamer, TileFetcher};
use crate::{
    camera::{Camera, View},
    frame::{FrameData, FrameInputs, RenderSettings},
    scene::SceneTree,
    select::{
        Selection, SelectionScratch,
        occlusion_feedback::{OcclusionFeedback, OcclusionQuery},
        select,
        transitions::Transitions,
    },
};

/// Turns to the left and to the right of the view whose tiles are prefetched, in degrees.
const TURNS_DEG: [f64; 2] = [30.0, -30.0];
/// Side views are drawn with this fraction of the frame's width and height: enough to tell what occludes what while tiles
/// are missing.
pub const FEEDBACK_DOWNSCALE: u32 = 4;

/// Next step of the idle prefetch.
pub enum LookaheadState {
    /// A small frame must be drawn, and its hits reported with [`Streamer::report_prefetch_hits`].
    Draw(Box<FrameData>),
    /// Tiles are on their way.
    Waiting,
    /// Everything is resident, the frame itself is not settled, or the cache has no free pages.
    Done,
}

/// Side views of a frame that is complete.
#[derive(Debug, Default)]
pub(super) struct Lookahead {
    /// The frame that the side views belong to.
    of: Option<FrameRequest>,
    /// Number of side views that are complete.
    done: usize,
    feedback: OcclusionFeedback,
    selection: Selection,
    /// Side views do not cross-fade: this shows the selection as it is.
    transitions: Transitions,
    /// Counts draw lists that differ from the one before.
    generation: u64,
}

impl Lookahead {
    /// Whether the side views are those of `request`.
    pub(super) fn is_of(&self, request: &FrameRequest) -> bool {
        self.of.as_ref() == Some(request)
    }

    /// Starts with the first side view of `request`, knowing what the rays of its frame hit.
    fn begin(&mut self, request: &FrameRequest, feedback: &OcclusionFeedback) {
        let (of, feedback) = (Some(*request), feedback.for_other_view());
        *self = Self { of, feedback, generation: self.generation + 1, ..Self::default() };
    }

    /// Drops all side views: the frame changes.
    pub(super) fn forget(&mut self) {
        self.of = None;
        self.end();
    }

    /// Stops prefetching for this frame.
    fn end(&mut self) {
        self.done = TURNS_DEG.len();
        self.selection = Selection::default();
    }

    /// Goes on to the next side view.
    fn next(&mut self, feedback: &OcclusionFeedback) {
        self.done += 1;
        self.generation += 1;
        self.feedback = feedback.for_other_view();
        self.selection = Selection::default();
    }

    /// Camera of the current side view.
    fn camera(&self) -> Option<Camera> {
        Some(self.of?.camera.turned(*TURNS_DEG.get(self.done)?))
    }

    fn select(&mut self, view: &View, tree: &SceneTree, scratch: &mut SelectionScratch) {
        let selection = select(view, tree, &self.feedback, scratch);
        self.generation += u64::from(selection.draw_tiles != self.selection.draw_tiles);
        self.selection = selection;
        self.transitions.step(&self.selection, tree, 0.0);
    }

    /// Selection of the current side view.
    pub(super) fn selection(&self) -> &Selection {
        &self.selection
    }

    fn has_feedback(&self, size_px: [u32; 2]) -> bool {
        self.feedback.covers(self.generation, size_px)
    }
}

impl<F: TileFetcher> Streamer<F> {
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
        let small =
            FrameRequest { size_px: request.size_px.map(|side| (side / FEEDBACK_DOWNSCALE).max(1)), ..*request };
        while let Some(camera) = self.lookahead.camera() {
            if !self.lookahead.has_feedback(small.size_px) {
                let Lookahead { transitions, generation, .. } = &self.lookahead;
                let inputs = FrameInputs {
                    transitions: transitions,
                    shadow_casters: &[],
                    generation: *generation,
                    error_px: 0.0,
                };
                let view = self.view(&small, camera);
                let settings = RenderSettings::default();
                return LookaheadState::Draw(FrameData::new(inputs, &self.tree, &self.cache, &view, &settings).into());
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
        self.lookahead.feedback.update(query, pixels, is_complete, &self.tree);
        self.occlusion_gate.told_all();
        self.select_prefetch(request);
    }

    fn is_prefetch_fetched(&self) -> bool {
        self.lookahead.selection.requests.is_empty() && self.uploads.is_empty()
    }

    /// Selects the current side view; ends the prefetch when its next tile does not fit into free pages.
    pub(super) fn select_prefetch(&mut self, request: &FrameRequest) {
        if let Some(camera) = self.lookahead.camera() {
            let view = self.view(request, camera);
            self.lookahead.select(&view, &self.tree, &mut self.scratch);
        }
        let first = self.lookahead.selection.requests.first();
        if self.uploads.is_empty() && first.is_some_and(|w| self.tree.tile_pages(w.key) > self.spare_pages()) {
            self.lookahead.end();
        }
    }
}
