//! What is known of a city: which nodes exist, where, how wrong, and what has been fetched of them.
//!
//! In: subtrees and events from `stream`. Out: [`Tree`]. Next: `select`.

pub mod tile;
pub mod tree;

pub use tile::{Tile, TileEvent, TileState};
pub use tree::{Key, Lod, NodeIndex, Tree, TreeNode};
