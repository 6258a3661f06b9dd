//! The server's URLs, built and read in one place (design 11).

use crate::{TileId, TileKind, mesh_tile};

/// Prefix of everything that is versioned.
pub const CITIES: &str = "/v1/cities";

/// Path of a city's manifest.
pub fn manifest(city: &str) -> String {
    format!("{CITIES}/{city}")
}

/// Path of one level of detail of a leaf's mesh.
pub fn mesh(city: &str, version: &str, leaf: TileId, lod: u8) -> String {
    format!("{}/{lod}", tile(city, version, TileKind::Mesh, leaf))
}

/// Path of one tile by its place in the archive; of a mesh in a city of `depth` levels. `None` if it cannot lie there.
pub fn archive_tile(city: &str, version: &str, kind: TileKind, place: TileId, depth: u8) -> Option<String> {
    match kind {
        TileKind::Mesh => mesh_tile::from_archive_id(place, depth).map(|(leaf, lod)| mesh(city, version, leaf, lod)),
        TileKind::Subtree | TileKind::BlockMap => Some(tile(city, version, kind, place)),
    }
}

/// Path of one tile; of a mesh, what its levels of detail have in common.
pub fn tile(city: &str, version: &str, kind: TileKind, id: TileId) -> String {
    format!("{CITIES}/{city}/{version}/{}/{id}", kind.path_segment())
}
