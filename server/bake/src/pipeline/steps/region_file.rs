//! The tiles of a region, or of the levels above all regions: one object of bytes in the order of the archives, and an index.

use super::scan::put_file;
use super::sealed::{SealedKind, SealedStore};
use crate::error::BakeError;
use crate::hash::{ShortHash, short_hash};
use crate::write::archive::archive_order;
use crate::write::tile_bytes::TileContent;
use crate::write::tile_pack::{StoredMesh, StoredTile};
use crate::write::tile_tree::TileTree;
use insula_protocol::mesh_tile;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

pub(super) const INDEX_KIND: SealedKind = *b"TILE";

/// Tiles of a part of the quadtree.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct TileIndex {
    /// Name of the object of their bytes.
    pub(super) bytes: String,
    /// In the order of the archive, with the hashes of their bytes.
    pub(super) tiles: Vec<(StoredTile, ShortHash)>,
    /// The same; their bytes follow those of all tiles.
    pub(super) meshes: Vec<(StoredMesh, ShortHash)>,
    /// Place and hash of each block of leaves.
    pub(super) fingerprints: Vec<((u32, u32), ShortHash)>,
    /// Points of the root, for its ancestors.
    pub(super) root_points: Vec<[f32; 3]>,
}

/// Name of the index in a folder of the store.
pub(super) fn index_name(folder: &str) -> String {
    format!("{folder}/index")
}

/// Writes the tiles of `levels` and all meshes of a tree. `index` has what is known besides. `path` is for the bytes. Fails if a tile
/// cannot be read, or an object not be written. Returns the index that is written.
pub(super) fn write(
    objects: SealedStore<'_>,
    folder: &str,
    tree: &TileTree,
    levels: std::ops::RangeInclusive<u8>,
    bytes: &mut dyn TileContent,
    mut index: TileIndex,
    path: &Path,
) -> Result<TileIndex, BakeError> {
    let failed = |cause| BakeError::io(path, "written", cause);
    let mut writer = BufWriter::new(File::create(path).map_err(failed)?);
    let mut start = 0;
    let mut push = |bytes: Vec<u8>| {
        writer.write_all(&bytes).map_err(failed)?;
        let place = (start, short_hash(&blake3::hash(&bytes)));
        start += bytes.len() as u64;
        Ok::<_, BakeError>(place)
    };
    let mut tiles: Vec<&StoredTile> = levels.flat_map(|level| tree.level(level)).collect();
    tiles.sort_by_cached_key(|tile| archive_order(tile.id));
    for tile in tiles {
        let (offset, hash) = push(bytes.tile(tile)?)?;
        index.tiles.push((StoredTile { offset, points: 0, ..*tile }, hash));
    }
    let mut meshes: Vec<&StoredMesh> = tree.meshes().iter().collect();
    meshes.sort_by_cached_key(|mesh| mesh_tile::archive_id(mesh.id, mesh.lod).map(archive_order));
    for mesh in meshes {
        let (offset, hash) = push(bytes.mesh(mesh)?)?;
        index.meshes.push((StoredMesh { offset, ..*mesh }, hash));
    }
    writer.flush().map_err(failed)?;
    drop(writer);
    index.bytes = format!("{folder}/bytes");
    put_file(objects, &index.bytes, path)?;
    objects.write(&index_name(folder), INDEX_KIND, &index)?;
    Ok(index)
}
