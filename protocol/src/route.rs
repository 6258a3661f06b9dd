//! The server's URLs, built and read in one place (design 11).

use crate::TileId;

/// Prefix of everything that is versioned.
pub const CITIES: &str = "/v1/cities";

/// Archives of a city that tiles come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Layer {
    /// Which nodes exist.
    Subtrees,
    /// V-BlockMaps.
    BlockMaps,
}

impl Layer {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Subtrees, Self::BlockMaps];

    /// The word in URLs.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Subtrees => "subtrees",
            Self::BlockMaps => "blockmaps",
        }
    }

    /// The file in a city's folder.
    pub const fn file_name(self) -> &'static str {
        match self {
            Self::Subtrees => "subtrees.pmtiles",
            Self::BlockMaps => "blockmaps.pmtiles",
        }
    }

    /// The layer of a word.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|layer| layer.word() == word)
    }
}

/// Path of a city's manifest.
pub fn manifest(city: &str) -> String {
    format!("{CITIES}/{city}")
}

/// Path of one tile.
pub fn tile(city: &str, version: &str, layer: Layer, id: TileId) -> String {
    format!("{CITIES}/{city}/{version}/{}/{id}", layer.word())
}
