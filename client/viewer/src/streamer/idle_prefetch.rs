//! Idle prefetch: while the camera is idle and no tile is missing, tiles within 30 degrees to either side of the view are
//! fetched.
//!
//! Each side view is selected like the frame itself, by what its own rays hit, so that occluded tiles are not fetched. Its
//! occlusion feedback starts from that of the frame. Small frames, which the shell draws but does not show, refine it.

use super::frame_request::FrameRequest;
use crate::cache::AtlasCache;
use crate::camera::{Camera, View};
use crate::frame::{FrameData, FrameInputs, RenderSettings};
use crate::scene::SceneTree;
use crate::select::occlusion_feedback::OcclusionFeedback;
use crate::select::transitions::Transitions;
use crate::select::{Selection, SelectionScratch, select};

/// Turns to the left and to the right of the view whose tiles are prefetched, in degrees.
const TURNS_DEG: [f64; 2] = [30.0, -30.0];
/// Divides the width and height of frames that are drawn only for their feedback. Their rays find the occluders while tiles
/// are missing.
pub const FEEDBACK_DOWNSCALE: u32 = 4;

/// Next step of the idle prefetch.
pub enum LookaheadState {
    /// A small frame must be drawn, and its hits reported with
    /// [`Streamer::report_prefetch_hits`](super::Streamer::report_prefetch_hits).
    Draw(Box<FrameData>),
    /// Tiles are on their way.
    Waiting,
    /// Everything is resident, the frame itself is not settled, or the cache has no free pages.
    Done,
}

/// The side views of a complete frame, one after the other.
#[derive(Debug, Default)]
pub(super) struct Lookahead {
    /// The frame that the side views belong to.
    request: Option<FrameRequest>,
    /// Number of side views that are complete.
    done: usize,
    pub(super) feedback: OcclusionFeedback,
    /// Selection of the current side view.
    pub(super) selection: Selection,
    /// Shows the selection as it is: side views do not cross-fade.
    transitions: Transitions,
    /// Counts draw lists that differ from the one before.
    generation: u64,
}

impl Lookahead {
    /// Whether the side views are those of `request`.
    pub(super) fn is_of(&self, request: &FrameRequest) -> bool {
        self.request.as_ref() == Some(request)
    }

    /// Starts with the first side view of `request`. `feedback` is that of its frame.
    pub(super) fn begin(&mut self, request: &FrameRequest, feedback: &OcclusionFeedback) {
        let (request, feedback) = (Some(*request), feedback.for_other_view());
        *self = Self { request, feedback, generation: self.generation + 1, ..Self::default() };
    }

    /// Drops all side views, because the frame changes.
    pub(super) fn reset(&mut self) {
        self.request = None;
        self.end();
    }

    /// Ends the prefetch for this frame.
    pub(super) fn end(&mut self) {
        self.done = TURNS_DEG.len();
        self.selection = Selection::default();
    }

    /// Goes on to the next side view.
    pub(super) fn next(&mut self, feedback: &OcclusionFeedback) {
        self.done += 1;
        self.generation += 1;
        self.feedback = feedback.for_other_view();
        self.selection = Selection::default();
    }

    /// Camera of the current side view; `None` if all are complete.
    pub(super) fn camera(&self) -> Option<Camera> {
        Some(self.request?.camera.turned(*TURNS_DEG.get(self.done)?))
    }

    pub(super) fn select(&mut self, view: &View, tree: &SceneTree, scratch: &mut SelectionScratch) {
        let selection = select(view, tree, &self.feedback, scratch);
        self.generation += u64::from(selection.draw_tiles != self.selection.draw_tiles);
        self.selection = selection;
        self.transitions.step(&self.selection, tree, 0.0);
    }

    /// Whether the hits of the current selection are known from a frame of at least this size.
    pub(super) fn has_feedback(&self, size_px: [u32; 2]) -> bool {
        self.feedback.covers(self.generation, size_px)
    }

    /// Arrays for the ray-caster, for a frame of the current selection.
    pub(super) fn frame_data(&self, tree: &SceneTree, cache: &AtlasCache, view: &View) -> FrameData {
        let inputs = FrameInputs {
            transitions: &self.transitions,
            shadow_casters: &[],
            generation: self.generation,
            error_px: 0.0,
        };
        FrameData::new(inputs, tree, cache, view, &RenderSettings::default())
    }
}
