//! Decoded tiles that wait for their upload to the cache.
//!
//! The queue is bounded: arrivals are taken in only while [`UploadQueue::has_room`]. A frame uploads only as many bytes as it has
//! time for.

use crate::cache::{AtlasCache, InsertResult, PAGE_BYTES, PackedTile, Upload};
use crate::scene::{SceneTree, TileEvent, TileKey};
use serde::Serialize;
use std::collections::{HashSet, VecDeque};
use std::ops::Range;
use std::time::Duration;

const UPLOAD_BYTES_PER_SEC: f64 = 512e6;
/// Least and most bytes that a frame may upload, whatever its duration. Its last tile may exceed them.
const FRAME_BYTES: Range<f64> = 8e6..64e6;
/// Bytes of waiting tiles above which no arrival is taken in.
const CAPACITY_BYTES: u64 = 32 << 20;
/// Evicted tiles that are remembered for the count of those that are fetched again.
const MAX_EVICTED_KEYS: usize = 1 << 17;

/// Tiles that became resident, by kind.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct TileCounts {
    pub blockmaps: u64,
    pub subtrees: u64,
    /// Meshes of leaves; each level of detail counts.
    pub meshes: u64,
    /// Tiles that were given up: missing on the server, or damaged repeatedly.
    pub bad: u64,
}

/// Decoded tiles in the order of their arrival.
#[derive(Debug, Default)]
pub(super) struct UploadQueue {
    waiting: VecDeque<(TileKey, PackedTile)>,
    waiting_bytes: u64,
    uploaded_at: Duration,
    /// Tiles that have been evicted at least once, the first [`MAX_EVICTED_KEYS`] of them.
    evicted_keys: HashSet<TileKey>,
    /// Evictions so far.
    pub(super) evicted: u64,
    /// Tiles that were uploaded again after their eviction.
    pub(super) fetched_again: u64,
}

impl UploadQueue {
    /// Whether further arrivals may be taken in.
    pub(super) fn has_room(&self) -> bool {
        self.waiting_bytes < CAPACITY_BYTES
    }

    pub(super) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Pages that the waiting tiles will take.
    pub(super) fn pages(&self) -> u32 {
        (self.waiting_bytes / PAGE_BYTES) as u32
    }

    pub(super) fn push(&mut self, key: TileKey, tile: PackedTile) {
        self.waiting_bytes += bytes_of(&tile);
        self.waiting.push_back((key, tile));
    }

    /// Moves as many tiles into the cache as the frame has time for. Returns their keys, also of tiles that did not fit.
    pub(super) fn flush(
        &mut self,
        target: UploadTarget<'_, impl Upload>,
        counts: &mut TileCounts,
        now: Duration,
    ) -> Vec<TileKey> {
        let UploadTarget { tree, cache, upload } = target;
        let secs = now.saturating_sub(self.uploaded_at).as_secs_f64();
        let max_bytes = (secs * UPLOAD_BYTES_PER_SEC).clamp(FRAME_BYTES.start, FRAME_BYTES.end) as u64;
        self.uploaded_at = now;
        let (mut bytes, mut keys) = (0, Vec::new());
        while bytes < max_bytes
            && let Some((key, tile)) = self.waiting.pop_front()
        {
            self.waiting_bytes -= bytes_of(&tile);
            bytes += bytes_of(&tile);
            let is_mesh = matches!(tile, PackedTile::Mesh(..));
            let (event, evicted) = match cache.insert(key, tile, upload) {
                InsertResult::Inserted { evicted } => (TileEvent::Upload, evicted),
                InsertResult::Full { evicted } => (TileEvent::Drop, evicted),
            };
            let count = if is_mesh { &mut counts.meshes } else { &mut counts.blockmaps };
            *count += u64::from(event == TileEvent::Upload);
            self.fetched_again += u64::from(self.evicted_keys.contains(&key));
            self.evicted += evicted.len() as u64;
            if !tree.apply(key, event) {
                // Its node was evicted meanwhile.
                cache.remove(key);
            }
            keys.push(key);
            for key in evicted {
                self.record_eviction(key);
                tree.apply(key, TileEvent::Drop);
            }
        }
        keys
    }

    /// Counts a tile that was evicted together with its node.
    pub(super) fn tile_evicted(&mut self, key: TileKey) {
        self.evicted += 1;
        self.record_eviction(key);
    }

    fn record_eviction(&mut self, key: TileKey) {
        if self.evicted_keys.len() < MAX_EVICTED_KEYS {
            self.evicted_keys.insert(key);
        }
    }
}

/// What an upload changes.
pub(super) struct UploadTarget<'a, U> {
    pub(super) tree: &'a mut SceneTree,
    pub(super) cache: &'a mut AtlasCache,
    pub(super) upload: &'a mut U,
}

fn bytes_of(tile: &PackedTile) -> u64 {
    tile.pages().len() as u64 * PAGE_BYTES
}
