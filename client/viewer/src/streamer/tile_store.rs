//! The tiles of a session: the scene tree, the cache, and decoded tiles on their way to them.

use super::downloads::{Downloads, TileFetcher};
use super::upload_queue::{TileCounts, UploadQueue, UploadTarget};
use crate::cache::{AtlasCache, PAGE_BYTES, Upload};
use crate::decode::DecodedTile;
use crate::scene::{SceneTree, TileEvent, TileKey};
use insula_protocol::{Subtree, TileId};
use std::time::Duration;

/// Share of the cache that prefetching leaves free.
const SPARE_SHARE: f64 = 0.1;

pub(super) struct TileStore {
    pub(super) tree: SceneTree,
    pub(super) cache: AtlasCache,
    pub(super) uploads: UploadQueue,
    pub(super) counts: TileCounts,
    pending_subtrees: PendingSubtrees,
}

/// Result of [`TileStore::receive`].
pub(super) struct Received {
    pub(super) has_tiles: bool,
    /// Nodes became known.
    pub(super) has_nodes: bool,
}

impl TileStore {
    /// A store with an empty cache of `pages` pages.
    pub(super) fn new(tree: SceneTree, pages: u32) -> Self {
        let mut store = Self {
            tree,
            cache: AtlasCache::new(0),
            uploads: UploadQueue::default(),
            counts: TileCounts::default(),
            pending_subtrees: PendingSubtrees::default(),
        };
        store.resize_cache(pages);
        store
    }

    /// Replaces the empty cache by one of `pages` pages, which also bounds the scene tree.
    pub(super) fn resize_cache(&mut self, pages: u32) {
        self.cache = AtlasCache::new(pages);
        self.tree.bound_by_cache(u64::from(pages) * PAGE_BYTES);
    }

    /// Has a cache of at least `pages` pages from now on. What is resident stays.
    pub(super) fn grow_cache(&mut self, pages: u32) {
        self.cache.grow(pages);
        self.tree.bound_by_cache(u64::from(self.cache.capacity_pages()) * PAGE_BYTES);
    }

    /// Takes in what has arrived: merges subtrees into the tree, and queues other tiles for their upload.
    pub(super) fn receive<F: TileFetcher>(&mut self, downloads: &mut Downloads<F>, now: Duration) -> Received {
        downloads.recheck_damaged(&mut self.tree, now);
        let last_serial = self.tree.last_serial();
        let mut has_tiles = false;
        while self.uploads.has_room()
            && let Some((key, decoded)) = downloads.poll(&mut self.tree, now)
        {
            has_tiles = true;
            match decoded {
                DecodedTile::Subtree(subtree) => {
                    self.counts.subtrees += self.pending_subtrees.push(key, subtree, &mut self.tree);
                    for key in self.tree.take_evicted_tiles() {
                        self.cache.remove(key);
                        self.uploads.tile_evicted(key);
                    }
                }
                DecodedTile::Visibility(tile) => self.tree.put_visibility(tile),
                DecodedTile::Packed(tile) => {
                    self.tree.set_pages(key, tile.pages().len() as u32);
                    self.uploads.push(key, tile);
                }
            }
        }
        Received { has_tiles, has_nodes: self.tree.last_serial() != last_serial }
    }

    /// Uploads as many tiles as a frame has time for. Returns their keys.
    pub(super) fn upload(&mut self, upload: &mut impl Upload, now: Duration) -> Vec<TileKey> {
        let target = UploadTarget { tree: &mut self.tree, cache: &mut self.cache, upload };
        self.uploads.flush(target, &mut self.counts, now)
    }

    /// Pages that prefetching may fill.
    pub(super) fn spare_pages(&self) -> u32 {
        let reserved = (SPARE_SHARE * f64::from(self.cache.tile_pages())) as u32;
        self.cache.free_pages().saturating_sub(reserved).saturating_sub(self.uploads.pages())
    }
}

/// Most subtrees that wait. Beyond that, the oldest is dropped, and requested again.
const CAPACITY: usize = 16;

/// Subtrees that arrived before the subtree above them. After a jump to an unknown place, those of all levels are requested at once.
#[derive(Debug, Default)]
pub(super) struct PendingSubtrees(Vec<(TileKey, Subtree)>);

impl PendingSubtrees {
    /// Adds a subtree, and merges all that can be merged now, for which others are evicted. Returns how many were merged.
    pub(super) fn push(&mut self, key: TileKey, subtree: Subtree, tree: &mut SceneTree) -> u64 {
        self.0.push((key, subtree));
        let mut merged = 0;
        while let Some(position) = self.0.iter().position(|(key, _)| is_root_known(*key, tree)) {
            let (key, subtree) = self.0.swap_remove(position);
            if tree.make_room(&subtree) {
                tree.merge(&subtree);
                tree.apply(key, TileEvent::Upload);
                merged += 1;
            } else {
                tree.apply(key, TileEvent::Drop);
            }
        }
        if self.0.len() > CAPACITY {
            let (key, _) = self.0.remove(0);
            tree.apply(key, TileEvent::Drop);
        }
        merged
    }
}

fn is_root_known(subtree: TileKey, tree: &SceneTree) -> bool {
    subtree.id == TileId::ROOT || tree.find(subtree.id).is_some()
}
