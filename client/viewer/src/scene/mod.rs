//! The scene tree: which nodes of a city are known, their bounds and errors, and the states of their tiles.

mod eviction;
mod key;
mod memory;
pub mod tile;
mod tree;
mod visibility;
mod visible_set;

#[cfg(test)]
pub(crate) use eviction::MAX_SUBTREE_BYTES;
pub use key::TileKey;
pub use tile::{TileEvent, TileRecord, TileState};
pub use tree::{LeafLod, NodeIndex, SceneTree, TreeNode};
