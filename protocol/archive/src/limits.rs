//! Limits of what a program accepts from an archive.

use insula_protocol::{TileKind, mesh_tile, object_tile, visibility_tile};
use std::time::Duration;

/// Longest time for reading the directories of a city. Those of ten million tiles take a second.
pub const MAX_OPENING_TIME: Duration = Duration::from_secs(30);
/// Largest range that is read at once, a tile or a directory; checked before memory is allocated.
pub const MAX_READ_BYTES: u64 = 16 << 20;
const _: () = assert!(MAX_READ_BYTES >= MAX_TILE_BYTES as u64);

/// Largest subtree tile: 1,365 nodes of 21 bytes, meshes of 1,024 leaves of 77 bytes, and a header.
const MAX_SUBTREE_BYTES: usize = 128 << 10;
/// Largest V-BlockMap tile: a million incompressible texels and all planes take less.
const MAX_BLOCKMAP_BYTES: usize = 8 << 20;

/// Largest tile of any kind, with its frame.
pub const MAX_TILE_BYTES: usize = mesh_tile::MAX_BYTES;
const _: () = assert!(MAX_TILE_BYTES >= MAX_BLOCKMAP_BYTES && MAX_TILE_BYTES >= MAX_SUBTREE_BYTES);
const _: () = assert!(MAX_TILE_BYTES >= object_tile::MAX_BYTES && MAX_TILE_BYTES >= visibility_tile::MAX_BYTES);

/// Largest tile of one kind, with its frame.
pub const fn max_tile_bytes(kind: TileKind) -> usize {
    match kind {
        TileKind::Subtree => MAX_SUBTREE_BYTES,
        TileKind::BlockMap => MAX_BLOCKMAP_BYTES,
        TileKind::Mesh => mesh_tile::MAX_BYTES,
        TileKind::Objects => object_tile::MAX_BYTES,
        TileKind::Visibility => visibility_tile::MAX_BYTES,
    }
}
