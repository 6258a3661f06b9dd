//! Subtrees that arrived before the subtree above them.
//!
//! After a jump to an unknown place, the subtrees of all levels are requested at once, so they arrive in any order. There are few
//! of them: one for each level of subtrees.

use crate::scene::{SceneTree, TileEvent, TileKey};
use insula_protocol::{Subtree, TileId};

/// Most subtrees that wait. Beyond that, the oldest is dropped, and requested again.
const CAPACITY: usize = 16;

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
