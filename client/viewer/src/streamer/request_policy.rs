//! Which of the wanted tiles to request now, given what is known about occlusion.
//!
//! | phase | requested |
//! |---|---|
//! | before feedback | the root's tile, subtrees with a large error, requests in flight |
//! | while drawing | tiles with a large error, requests in flight, and a bounded number of other tiles |
//! | between frames | everything |
//! | idle prefetch | what fits into free cache pages |
//!
//! In the last three phases, tiles that others on their way may occlude wait ([`OcclusionGate`]), unless the source does not
//! respond: tiles that are cached locally must not wait for the network.

use super::downloads::{Downloads, TileFetcher};
use super::occlusion_gate::{GateInputs, OcclusionGate};
use crate::camera::View;
use crate::scene::{SceneTree, TileKey, TileState};
use crate::select::OCCLUDED_TAU_FACTOR;
use crate::select::priority::TileRequest;
use insula_protocol::{TileId, TileKind};
use std::time::Duration;

/// While a frame is drawn, tiles whose error exceeds this multiple of tau are requested whether they turn out to be visible or not.
const COARSE_TAU_FACTOR: f64 = 4.0;

/// What the policy needs to know, at one moment.
pub(super) struct RequestPolicy<'a, F> {
    pub(super) tree: &'a SceneTree,
    pub(super) downloads: &'a Downloads<F>,
    pub(super) gate: &'a OcclusionGate,
    /// View of the last selection; `None` before the first feedback.
    pub(super) view: Option<&'a View>,
    pub(super) tau_px: f64,
    pub(super) now: Duration,
}

/// A row of the table above.
pub(super) enum RequestPhase {
    BeforeFeedback,
    WhileDrawing { fine: usize },
    BetweenFrames,
    Prefetch { spare_pages: u32 },
}

impl<F: TileFetcher> RequestPolicy<'_, F> {
    pub(super) fn choose(&self, wanted: &[TileRequest], phase: RequestPhase) -> Vec<TileRequest> {
        match phase {
            RequestPhase::BeforeFeedback => self.before_feedback(wanted),
            RequestPhase::WhileDrawing { fine } => self.pass_gate(wanted, self.while_drawing(wanted, fine)),
            RequestPhase::BetweenFrames => self.pass_gate(wanted, wanted.to_vec()),
            RequestPhase::Prefetch { spare_pages } => self.pass_gate(wanted, self.that_fit(wanted, spare_pages)),
        }
    }

    fn before_feedback(&self, wanted: &[TileRequest]) -> Vec<TileRequest> {
        let large_error_px = OCCLUDED_TAU_FACTOR * self.tau_px;
        let is_coarse_subtree = |w: &TileRequest| w.key.kind() == TileKind::Subtree && w.exceeds(large_error_px);
        let root = TileKey::block_map(TileId::ROOT);
        let is_visibility = |w: &TileRequest| w.key.kind() == TileKind::Visibility;
        let is_first =
            |w: &&TileRequest| w.key == root || is_coarse_subtree(w) || is_visibility(w) || self.is_loading(w.key);
        wanted.iter().filter(is_first).copied().collect()
    }

    fn while_drawing(&self, wanted: &[TileRequest], mut fine: usize) -> Vec<TileRequest> {
        let coarse_px = COARSE_TAU_FACTOR * self.tau_px;
        let is_taken = |w: &&TileRequest| {
            let is_free = w.exceeds(coarse_px) || self.is_loading(w.key);
            let is_taken = is_free || fine > 0;
            fine -= usize::from(is_taken && !is_free);
            is_taken
        };
        wanted.iter().filter(is_taken).copied().collect()
    }

    fn that_fit(&self, wanted: &[TileRequest], mut spare_pages: u32) -> Vec<TileRequest> {
        let mut subtrees = self.tree.prefetchable_subtrees();
        let mut fits = |w: &&TileRequest| {
            if w.key.kind() == TileKind::Subtree {
                let fits = subtrees > 0;
                subtrees = subtrees.saturating_sub(1);
                return fits;
            }
            let pages = self.tree.tile_pages(w.key);
            let fits = pages <= spare_pages;
            spare_pages = spare_pages.saturating_sub(pages);
            fits
        };
        wanted.iter().take_while(|w| fits(w)).copied().collect()
    }

    /// `requests` without those that tiles of `all` may occlude.
    fn pass_gate(&self, all: &[TileRequest], requests: Vec<TileRequest>) -> Vec<TileRequest> {
        match self.view {
            Some(view) if self.downloads.failing_since().is_none() => {
                let started_at = |key| self.downloads.started_at(key);
                self.gate.filter(all, requests, &GateInputs { tree: self.tree, view, started_at, now: self.now })
            }
            _ => requests,
        }
    }

    fn is_loading(&self, key: TileKey) -> bool {
        self.tree.tile(key).is_some_and(|tile| tile.state() == TileState::Loading)
    }
}
