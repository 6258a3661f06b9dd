//! Which files a tileset has, and their names.

use super::TILESET_JSON;
use insula_protocol::TileId;
use std::fmt;

/// A file of a tileset. Displayed as its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TilesetFile {
    Tileset,
    Subtree(TileId),
    /// The tiles from a node on, in the plain form.
    Tiles(TileId),
    Content(TileId),
}

impl fmt::Display for TilesetFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tileset => f.write_str(TILESET_JSON),
            Self::Subtree(root) => write!(f, "subtrees/{root}.subtree"),
            Self::Tiles(root) => write!(f, "tiles/{root}.json"),
            Self::Content(node) => write!(f, "content/{node}.glb"),
        }
    }
}
