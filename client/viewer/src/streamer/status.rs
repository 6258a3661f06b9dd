//! The state of a session.

use super::Streamer;
use super::downloads::{Downloads, TileFetcher};
use super::error::StreamError;
use super::upload_queue::TileCounts;
use crate::cache::AtlasCache;
use crate::scene::{SceneTree, TileKey};
use crate::select::Selection;
use crate::select::occlusion_feedback::OcclusionFeedback;
use crate::select::priority::PriorityGroup;
use crate::select::transitions::Transitions;
use insula_protocol::{TileId, TileKind};
use std::time::Duration;

/// People are told after the server has not responded for this time.
const SILENCE: Duration = Duration::from_millis(700);

/// State of streaming, as people see it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StreamStatus {
    /// The city is shown, and the server responds or is not needed.
    Ready,
    /// Nothing can be drawn yet.
    Loading,
    /// Tiles are missing and the server does not respond.
    Reconnecting,
    /// The city cannot be shown.
    Failed,
}

impl<F: TileFetcher> Streamer<F> {
    /// Status after the last selection.
    pub fn stream_status(&self, now: Duration) -> StreamStatus {
        // A frame that lacks no tiles needs no server.
        let failing_since = self.downloads.failing_since().filter(|_| self.lacks_tiles());
        match self.check() {
            Err(_) => StreamStatus::Failed,
            Ok(()) if failing_since.is_some_and(|since| now.saturating_sub(since) > SILENCE) => {
                StreamStatus::Reconnecting
            }
            Ok(()) if !self.has_frame() => StreamStatus::Loading,
            Ok(()) => StreamStatus::Ready,
        }
    }

    /// Whether the last selection can be drawn: it shows something of the city, or nothing of the city is in view.
    pub fn has_frame(&self) -> bool {
        !self.selection.draw_tiles.is_empty() || self.tree().root().is_some() && !self.may_show_more()
    }

    /// Whether tiles that are wanted may add something to an empty draw list. With the root's tile all areas in view are drawn, so those of
    /// known nodes do not: they are refined into children out of view, or cast shadows. Frames that wait for them would wait for ever,
    /// because they in turn wait for the hits of a frame.
    fn may_show_more(&self) -> bool {
        let root = TileKey::block_map(TileId::ROOT);
        self.selection.requests.iter().any(|wanted| {
            let is_in_view = wanted.group <= PriorityGroup::Normal;
            is_in_view && (wanted.key == root || wanted.key.kind() == TileKind::Subtree)
        })
    }

    /// Number of tiles that the last selection's frame lacks, preloaded ones aside.
    pub fn missing_tiles(&self) -> usize {
        self.selection.requests.iter().filter(|wanted| wanted.group != PriorityGroup::Preload).count()
    }

    /// Fails if the city has no usable root, or its source will never serve it.
    pub fn check(&self) -> Result<(), StreamError> {
        let root = [TileKey::subtree(TileId::ROOT), TileKey::block_map(TileId::ROOT)];
        if root.iter().any(|key| self.tree().tile(*key).is_some_and(|tile| tile.is_bad())) {
            return Err(StreamError::RootUnusable { city: self.tree().manifest().name.clone() });
        }
        self.downloads.fatal_error().map_or(Ok(()), |why| Err(StreamError::Fatal(why.to_owned())))
    }

    /// Whether nothing can improve the last selection's frame: all its tiles are resident, no node cross-fades, and feedback
    /// changed nothing.
    pub fn is_settled(&self) -> bool {
        self.is_fetched()
            && !self.threshold.is_changing()
            && self.transitions.fading_count() == 0
            && (self.has_feedback([0, 0]) || self.is_blind())
    }

    /// Whether everything that the last selection asks for is resident.
    pub fn is_fetched(&self) -> bool {
        let is_uploaded = self.tiles.uploads.is_empty() || self.is_prefetching();
        self.tree().root().is_some() && self.selection.requests.is_empty() && is_uploaded
    }

    /// Whether everything that the current side view of the idle prefetch asks for is resident.
    pub(super) fn is_prefetch_fetched(&self) -> bool {
        self.lookahead.selection.requests.is_empty() && self.tiles.uploads.is_empty()
    }

    /// Whether the hits of the last selection are known from a frame of at least this size, and changed nothing.
    pub fn has_feedback(&self, size_px: [u32; 2]) -> bool {
        self.feedback.covers(self.generation, size_px)
    }

    /// Whether no frame has reported yet which tiles are visible.
    pub(super) fn is_blind(&self) -> bool {
        !self.feedback.has_feedback()
    }

    /// Whether the next frame has something to upload or to select again, so that it need not wait for an arrival.
    pub fn has_work(&self) -> bool {
        let has_arrivals = !self.tiles.uploads.is_empty() || self.has_news;
        has_arrivals && !self.is_prefetching() || self.threshold.is_changing() || self.transitions.fading_count() > 0
    }

    /// Whether nothing is wanted and nothing is in flight.
    pub fn is_idle(&self) -> bool {
        self.selection.requests.is_empty() && self.downloads.in_flight() == 0
    }

    /// Whether the last selection's frame lacks tiles, preloaded ones aside.
    pub fn lacks_tiles(&self) -> bool {
        self.missing_tiles() > 0
    }

    /// Whether arrivals belong to the idle prefetch rather than to the frame.
    fn is_prefetching(&self) -> bool {
        self.last_request.is_some_and(|request| self.lookahead.is_of(&request))
    }

    /// The scene tree.
    pub fn tree(&self) -> &SceneTree {
        &self.tiles.tree
    }

    /// The tile cache.
    pub fn cache(&self) -> &AtlasCache {
        &self.tiles.cache
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
        self.tiles.counts
    }

    /// Number of tiles that were evicted from the cache so far.
    pub fn evicted(&self) -> u64 {
        self.tiles.uploads.evicted
    }

    /// Number of tiles that were fetched again after their eviction.
    pub fn fetched_again(&self) -> u64 {
        self.tiles.uploads.fetched_again
    }
}
