//! The server's URLs, built and read in one place (design 11).

use crate::{TileId, mesh_tile};

/// Prefix of everything that is versioned.
pub const CITIES: &str = "/v1/cities";

/// Archives of a city that tiles come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Layer {
    /// Which nodes exist.
    Subtrees,
    /// V-BlockMaps.
    BlockMaps,
    /// Leaves' triangles, one tile for each level of detail; a city may have none.
    Meshes,
}

impl Layer {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Subtrees, Self::BlockMaps, Self::Meshes];

    /// Whether every city has it.
    pub const fn is_always_there(self) -> bool {
        !matches!(self, Self::Meshes)
    }

    /// The word in URLs.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Subtrees => "subtrees",
            Self::BlockMaps => "blockmaps",
            Self::Meshes => "meshes",
        }
    }

    /// The file in a city's folder.
    pub const fn file_name(self) -> &'static str {
        match self {
            Self::Subtrees => "subtrees.pmtiles",
            Self::BlockMaps => "blockmaps.pmtiles",
            Self::Meshes => "meshes.pmtiles",
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

/// Path of one level of detail of a leaf's mesh.
pub fn mesh(city: &str, version: &str, leaf: TileId, lod: u8) -> String {
    format!("{}/{lod}", tile(city, version, Layer::Meshes, leaf))
}

/// Path of one tile by its place in the archive; of a mesh in a city of `depth` levels. `None` if it cannot lie there.
pub fn at_place(city: &str, version: &str, layer: Layer, place: TileId, depth: u8) -> Option<String> {
    match layer {
        Layer::Meshes => mesh_tile::at_place(place, depth).map(|(leaf, lod)| mesh(city, version, leaf, lod)),
        Layer::Subtrees | Layer::BlockMaps => Some(tile(city, version, layer, place)),
    }
}

/// Path of one tile; of a mesh, what its levels of detail have in common.
pub fn tile(city: &str, version: &str, layer: Layer, id: TileId) -> String {
    format!("{CITIES}/{city}/{version}/{}/{id}", layer.word())
}
