//! Counts the memory of the scene tree by subtree, and which subtrees the present frame uses.
//!
//! The nodes that one subtree tile lists become known together and are evicted together. A subtree is in use in a frame if the
//! frame's selection visits one of its nodes, or a node whose children it lists. Then those above it are in use, too.

use super::key::TileKey;
use insula_protocol::{Subtree, TileId};
use std::cmp::Reverse;
use std::collections::HashMap;

/// The memory that the nodes of a tree take, by subtree.
#[derive(Debug, Clone)]
pub(super) struct TreeMemory {
    pub(super) max_bytes: usize,
    pub(super) bytes: usize,
    /// Bytes of the subtrees that are in use in the present frame.
    pub(super) used_bytes: usize,
    pub(super) frame: u64,
    /// By the id of their root.
    pub(super) subtrees: HashMap<TileId, ResidentSubtree>,
    /// Resident tiles of evicted nodes that the owner of the cache has not taken yet.
    pub(super) evicted_tiles: Vec<TileKey>,
}

#[derive(Debug, Clone, Default)]
pub(super) struct ResidentSubtree {
    /// Nodes that it lists, parents before their children. Its root is listed by the subtree above.
    pub(super) nodes: Vec<TileId>,
    pub(super) bytes: usize,
    /// The last frame that used it.
    last_frame: u64,
}

impl Default for TreeMemory {
    fn default() -> Self {
        let (subtrees, evicted_tiles) = (HashMap::new(), Vec::new());
        Self { max_bytes: usize::MAX, bytes: 0, used_bytes: 0, frame: 1, subtrees, evicted_tiles }
    }
}

/// The root of the subtree tile that lists a node.
pub(super) fn listing_subtree(id: TileId) -> TileId {
    id.parent().map_or(TileId::ROOT, Subtree::root_of)
}

impl TreeMemory {
    pub(super) fn add_node(&mut self, id: TileId, bytes: usize) {
        self.add_bytes(id, bytes).nodes.push(id);
    }

    /// Adds `bytes` to a node. What has just arrived is in use until the next frame.
    pub(super) fn add_bytes(&mut self, id: TileId, bytes: usize) -> &mut ResidentSubtree {
        let root = listing_subtree(id);
        let subtree = self.subtrees.entry(root).or_default();
        self.used_bytes += if subtree.last_frame == self.frame { bytes } else { subtree.bytes + bytes };
        self.bytes += bytes;
        subtree.bytes += bytes;
        subtree.last_frame = self.frame;
        subtree
    }

    /// Marks a subtree and those above it as used.
    pub(super) fn mark_used(&mut self, root: TileId) {
        let mut next = Some(root);
        while let Some(root) = next
            && let Some(subtree) = self.subtrees.get_mut(&root)
            && subtree.last_frame != self.frame
        {
            subtree.last_frame = self.frame;
            self.used_bytes += subtree.bytes;
            next = root.parent().map(Subtree::root_of);
        }
    }

    /// Roots of the subtrees that are not in use, in the order in which they may be evicted: those above others come after them.
    pub(super) fn unused_subtrees(&self) -> Vec<TileId> {
        let unused = self.subtrees.iter().filter(|(_, subtree)| subtree.last_frame != self.frame);
        let mut unused: Vec<_> = unused.map(|(root, subtree)| (subtree.last_frame, Reverse(*root))).collect();
        unused.sort_unstable();
        unused.into_iter().map(|(_, Reverse(root))| root).collect()
    }
}
