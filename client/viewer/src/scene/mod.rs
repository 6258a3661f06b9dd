//! The scene tree: which nodes of a city are known, their bounds and errors, and the states of their tiles.

mod key;
pub mod tile;
mod tree;

pub use key::TileKey;
pub use tile::{TileEvent, TileRecord, TileState};
pub use tree::{LeafLod, NodeIndex, SceneTree, TreeNode};
