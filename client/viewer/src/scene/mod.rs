//! The scene tree: which nodes of a city are known, their bounds and errors, and the states of their tiles.

mod key;
mod memory;
pub mod tile;
mod tree;

pub use key::TileKey;
#[cfg(test)]
pub(crate) use memory::MAX_SUBTREE_BYTES;
pub use tile::{TileEvent, TileRecord, TileState};
pub use tree::{LeafLod, NodeIndex, SceneTree, TreeNode};
