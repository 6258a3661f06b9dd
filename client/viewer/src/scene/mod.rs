//! What is known of a city: which nodes exist, where, how wrong, and what has been fetched of them.
//!
//! In: subtrees and events from `stream`. Out: [`SceneTree`]. Next: `select`.

pub mod tile;
pub mod tree;

pub use tile::{TileEvent, TileRecord, TileState};
pub use tree::{LeafLod, NodeIndex, SceneTree, TileKey, TreeNode};
