//! Which of the wanted tiles to request now, given what is known about occlusion.
//!
//! | phase | requested |
//! |---|---|
//! | no feedback has been taken in yet | the root's tile, subtrees with a large error, requests in flight |
//! | a frame is being drawn | tiles with a large error, requests in flight, and a bounded number of other tiles |
//! | between frames | everything |
//! | idle prefetch | what fits into free cache pages |
//!
//! In the last three phases, tiles that others on their way may occlude wait ([`OcclusionGate`]), unless the source does not
//! respond: tiles that are cached locally must not wait for the network.

use super::{
    downloads::{Downloads, TileFetcher},
    occlusion_gate::{GateInputs, OcclusionGate},
};
use crate::{
    camera::View,
    scene::{SceneTree, TileKey, TileState},
    select::{OCCLUDED_TAU_FACTOR, priority::TileRequest},
};
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
    /// Requested tau, in pixels.
    pub(super) tau_px: f64,
    pub(super) now: Duration,
}

impl<F: TileFetcher> RequestPolicy<'_, F> {
    /// Requests before any feedback.
    pub(super) fn before_feedback(&self, wanted: &[TileRequest]) -> Vec<TileRequest> {
        let large_error_px = OCCLUDED_TAU_FACTOR * self.tau_px;
        let is_coarse_subtree = |w: &TileRequest| w.key.layer() == TileKind::Subtree && w.exceeds(large_error_px);
        let root = TileKey::block_map(TileId::ROOT);
        let is_first = |w: &&TileRequest| w.key == root || is_coarse_subtree(w) || self.is_loading(w.key);
        wanted.iter().filter(is_first).copied().collect()
    }

    /// Requests between two frames.
    pub(super) fn between_frames(&self, wanted: &[TileRequest]) -> Vec<TileRequest> {
        self.pass_gate(wanted, wanted.to_vec())
    }

    /// Requests while a frame is drawn: at most `fine` of the tiles without a large error, most important first.
    pub(super) fn while_drawing(&self, wanted: &[TileRequest], mut fine: usize) -> Vec<TileRequest> {
        let coarse_px = COARSE_TAU_FACTOR * self.tau_px;
        let is_taken = |w: &&TileRequest| {
            let is_free = w.exceeds(coarse_px) || self.is_loading(w.key);
            let is_taken = is_free || fine > 0;
            fine -= usize::from(is_taken && !is_free);
            is_taken
        };
        self.pass_gate(wanted, wanted.iter().filter(is_taken).copied().collect())
    }

    /// Requests of the idle prefetch: the first that fit into `spare_pages`.
    pub(super) fn for_prefetch(&self, wanted: &[TileRequest], mut spare_pages: u32) -> Vec<TileRequest> {
        let mut subtrees = self.tree.prefetchable_subtrees();
        let mut fits = |w: &&TileRequest| {
            if w.key.layer() == TileKind::Subtree {
                let fits = subtrees > 0;
                subtrees = subtrees.saturating_sub(1);
                return fits;
            }
            let pages = self.tree.tile_pages(w.key);
            let fits = pages <= spare_pages;
            spare_pages = spare_pages.saturating_sub(pages);
            fits
        };
        let fitting = wanted.iter().take_while(|w| fits(w)).copied().collect();
        self.pass_gate(wanted, fitting)
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
