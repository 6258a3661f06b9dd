//! Bounds the memory of the scene tree: evicts subtrees that have not been used for longest.
//!
//! A subtree in use is never evicted, nor one above it, so that what the frame draws stays known. An evicted subtree is requested
//! again when a selection needs it.

use super::tile::{TileRecord, TileState};
use super::tree::{LOD_BYTES, NODE_BYTES, NodeIndex, SceneTree};
use super::{TileKey, TreeMemory, listing_subtree};
use insula_protocol::mesh_tile::MAX_LODS;
use insula_protocol::subtree::MAX_NODES;
use insula_protocol::{Subtree, TileId};

/// Memory for the largest subtree.
pub(crate) const MAX_SUBTREE_BYTES: usize = MAX_NODES * NODE_BYTES + 1024 * MAX_LODS as usize * LOD_BYTES;
/// Least memory of a tree, for some twenty of the largest subtrees.
const MIN_BYTES: usize = 16 << 20;
/// Share of the cache that the tree may take in addition.
const CACHE_SHARE: u64 = 4;
/// States of subtrees that are remembered although neither they nor the subtrees above them are resident.
const MAX_LOOSE_SUBTREES: usize = 4096;

impl SceneTree {
    /// Bounds the memory of the tree by a share of the cache's `cache_bytes`.
    pub fn bound_by_cache(&mut self, cache_bytes: u64) {
        self.set_max_bytes(usize::try_from(cache_bytes / CACHE_SHARE).unwrap_or(usize::MAX).max(MIN_BYTES));
    }

    /// Sets the most bytes that the tree may take.
    pub(crate) fn set_max_bytes(&mut self, bytes: usize) {
        self.memory.max_bytes = bytes;
    }

    /// Bytes that all known nodes take.
    pub fn bytes(&self) -> usize {
        self.memory.bytes
    }

    /// Most bytes that the tree may take.
    pub fn max_bytes(&self) -> usize {
        self.memory.max_bytes
    }

    /// Starts a frame: no subtree is in use.
    pub(crate) fn begin_frame(&mut self) {
        self.memory.frame += 1;
        self.memory.used_bytes = 0;
    }

    /// Marks the subtree below a visited node as in use. That which lists the node is marked by the visit of its ancestors.
    pub(crate) fn mark_visited(&mut self, index: NodeIndex) {
        let id = self.node(index).id;
        if Subtree::is_root(id) {
            self.memory.mark_used(id);
        }
    }

    /// Marks the subtree that lists a node as in use, if the node is known.
    pub(crate) fn mark_used(&mut self, index: NodeIndex) {
        if self.is_known(index) {
            self.memory.mark_used(listing_subtree(self.node(index).id));
        }
    }

    /// Marks the subtree below `root` as in use.
    pub(crate) fn mark_subtree_used(&mut self, root: TileId) {
        self.memory.mark_used(root);
    }

    /// Number of subtrees that may be requested for the present frame: they fit if all that is not in use is evicted.
    pub(crate) fn requestable_subtrees(&self) -> usize {
        self.memory.max_bytes.saturating_sub(self.memory.used_bytes) / MAX_SUBTREE_BYTES
    }

    /// Number of subtrees that fit without any eviction.
    pub(crate) fn prefetchable_subtrees(&self) -> usize {
        self.memory.max_bytes.saturating_sub(self.memory.bytes) / MAX_SUBTREE_BYTES
    }

    /// Marks the subtrees above `subtree` as in use.
    pub(super) fn mark_listing_used(&mut self, subtree: &Subtree) {
        if let Some(root) = subtree.nodes.first() {
            self.memory.mark_used(listing_subtree(root.id));
        }
    }

    /// Evicts unused subtrees until `subtree` fits. Its root must be known. Returns whether it fits.
    pub(crate) fn make_room(&mut self, subtree: &Subtree) -> bool {
        let free = |memory: &TreeMemory, share: usize| memory.bytes + MAX_SUBTREE_BYTES * share <= memory.max_bytes;
        if free(&self.memory, 1) {
            return true;
        }
        self.mark_listing_used(subtree);
        for unused in self.memory.unused_subtrees() {
            // Some more than needed, because sorting takes time.
            if free(&self.memory, 4) {
                break;
            }
            self.evict_subtree(unused);
        }
        free(&self.memory, 1)
    }

    /// Keys of the resident tiles of evicted nodes, which are to be removed from the cache.
    pub(crate) fn take_evicted_tiles(&mut self) -> Vec<TileKey> {
        std::mem::take(&mut self.memory.evicted_tiles)
    }

    fn evict_subtree(&mut self, root: TileId) {
        let Some(subtree) = self.memory.subtrees.remove(&root) else { return };
        self.memory.bytes -= subtree.bytes;
        self.subtrees.remove(&root);
        for id in subtree.nodes.into_iter().rev() {
            if Subtree::is_root(id) && self.subtrees.get(&id).is_some_and(|tile| !is_on_its_way(*tile)) {
                self.subtrees.remove(&id);
            }
            let Some(node) = self.remove(id) else { continue };
            let lods = node.lods.iter().zip(0..).filter(|(lod, _)| lod.tile.is_resident());
            self.memory.evicted_tiles.extend(lods.map(|(_, lod)| TileKey::mesh(id, lod)));
            self.memory.evicted_tiles.extend(node.tile.is_resident().then_some(TileKey::block_map(id)));
        }
    }

    /// Bounds what is remembered of subtrees that could not be fetched.
    pub(super) fn forget_loose_subtrees(&mut self) {
        if self.subtrees.len() > self.memory.subtrees.len() + MAX_LOOSE_SUBTREES {
            self.subtrees.retain(|_, tile| tile.is_resident() || is_on_its_way(*tile));
        }
    }
}

fn is_on_its_way(tile: TileRecord) -> bool {
    matches!(tile.state(), TileState::Queued | TileState::Loading | TileState::Decoded)
}
