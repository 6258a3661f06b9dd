//! Which of the wanted tiles to request now, given what is known of occlusion.
//!
//! | phase | requested |
//! |---|---|
//! | no frame has reported yet which tiles are visible | the root's tile, subtrees of large error, requests in flight |
//! | a frame is being drawn | coarse tiles in any case, and a bounded number of fine ones |
//! | between frames | everything, except tiles that a tile in flight may occlude ([`super::occlusion_gate`]) |
//! | the source does not respond | everything: tiles that are cached locally must not wait for the network |

use super::{Streamer, TileFetcher};
use crate::{
    scene::{TileKey, TileState},
    select::{OCCLUDED_TAU_FACTOR, priority::TileRequest},
};
use insula_protocol::{TileId, route::Layer};
use std::time::Duration;

/// Tiles whose error exceeds this multiple of tau are requested while a frame is drawn, whether they turn out visible or not.
const COARSE_TIMES_TAU: f64 = 4.0;
/// Frames that the policy waits for the first occlusion feedback. A shell that never reports any gets all tiles after that.
const MAX_BLIND_FRAMES: u32 = 8;

impl<F: TileFetcher> Streamer<F> {
    /// Requests for the time between two frames.
    pub(super) fn requests_between_frames(&mut self, tau_px: f64, now: Duration) -> Vec<TileRequest> {
        if self.is_blind() && self.blind_frames < MAX_BLIND_FRAMES {
            self.blind_frames += u32::from(!self.selection.draw_tiles.is_empty());
            return self.requests_before_feedback(tau_px);
        }
        self.gate_requests(&self.selection.requests, self.selection.requests.clone(), now)
    }

    /// Requests while a frame is drawn: at most `fine` of the tiles that only the last frame's rays ask for.
    pub(super) fn requests_while_drawing(&self, tau_px: f64, fine: usize, now: Duration) -> Vec<TileRequest> {
        if self.is_blind() {
            return self.requests_before_feedback(tau_px);
        }
        self.gate_requests(&self.selection.requests, self.coarse_requests(COARSE_TIMES_TAU * tau_px, fine), now)
    }

    /// Requests of the idle prefetch: no more than fit into cache pages that nothing uses.
    pub(super) fn requests_of_prefetch(&self, now: Duration) -> Vec<TileRequest> {
        let wanted = &self.lookahead.selection().requests;
        let mut free_pages = self.spare_pages();
        let mut fits = |w: &TileRequest| {
            let pages = self.tree.tile_pages(w.key);
            let fits = pages <= free_pages;
            free_pages = free_pages.saturating_sub(pages);
            fits
        };
        let fitting = wanted.iter().copied().take_while(|w| fits(w)).collect();
        self.gate_requests(wanted, fitting, now)
    }

    /// `requests` without those that `all` wanted tiles may occlude.
    fn gate_requests(&self, all: &[TileRequest], requests: Vec<TileRequest>, now: Duration) -> Vec<TileRequest> {
        match self.last_view {
            Some(view) if !self.is_blind() && self.downloads.failing_since().is_none() => {
                let started_at = |key| self.downloads.started_at(key);
                self.occlusion_gate.front(all, requests, (&self.tree, &view), started_at, now)
            }
            _ => requests,
        }
    }

    /// Whether no frame has reported yet which tiles are visible.
    pub(super) fn is_blind(&self) -> bool {
        !self.feedback.has_feedback()
    }

    fn requests_before_feedback(&self, tau_px: f64) -> Vec<TileRequest> {
        let is_coarse_subtree =
            |w: &TileRequest| w.key.layer() == Layer::Subtrees && w.exceeds(OCCLUDED_TAU_FACTOR * tau_px);
        let root = TileKey::block_map(TileId::ROOT);
        let is_first = |w: &&TileRequest| w.key == root || is_coarse_subtree(w) || self.is_loading(w.key);
        self.selection.requests.iter().filter(is_first).copied().collect()
    }

    /// Wanted tiles with an error above `coarse_px`, those in flight, and the first `fine` of the rest.
    fn coarse_requests(&self, coarse_px: f64, mut fine: usize) -> Vec<TileRequest> {
        let is_taken = |w: &&TileRequest| {
            let is_free = w.exceeds(coarse_px) || self.is_loading(w.key);
            let is_taken = is_free || fine > 0;
            fine -= usize::from(is_taken && !is_free);
            is_taken
        };
        self.selection.requests.iter().filter(is_taken).copied().collect()
    }

    fn is_loading(&self, key: TileKey) -> bool {
        self.tree.tile(key).is_some_and(|tile| tile.state() == TileState::Loading)
    }
}
