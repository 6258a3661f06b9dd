//! The tiles of a region, or of the levels above all regions: one object of bytes in the order of the archives, and an index.

use super::scan::put_file;
use super::sealed::{SealedKind, SealedStore};
use crate::error::BakeError;
use crate::hash::{ShortHash, short_hash};
use crate::write::archive::archive_order;
use crate::write::mesh_pack::StoredMesh;
use crate::write::tile_bytes::TileContent;
use crate::write::tile_pack::StoredTile;
use crate::write::tile_tree::TileTree;
use insula_protocol::subtree::{MeshLod, NodeDeviation};
use insula_protocol::{TileId, mesh_tile};
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
    /// In the order of the archive.
    pub(super) tiles: Vec<TileEntry>,
    /// In the order of the archive; their bytes follow those of all tiles.
    pub(super) meshes: Vec<MeshEntry>,
    /// Place and hash of each block of leaves.
    pub(super) fingerprints: Vec<((u32, u32), ShortHash)>,
    /// Points of the root, for its ancestors.
    pub(super) root_points: Vec<[f32; 3]>,
}

/// A tile, and what is known of its node.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct TileEntry {
    level: u8,
    x: u32,
    y: u32,
    z_range_m: [f32; 2],
    /// Drawn, drawn at most, source, source at most.
    deviation: [f32; 4],
    shows_children: bool,
    pub(super) start: u64,
    pub(super) bytes: u32,
    pub(super) hash: ShortHash,
}

/// A mesh tile.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct MeshEntry {
    level: u8,
    x: u32,
    y: u32,
    lod: u8,
    error_m: f32,
    triangles: u32,
    texture_px: u32,
    pub(super) start: u64,
    pub(super) bytes: u32,
    pub(super) hash: ShortHash,
}

impl TileEntry {
    pub(super) fn new(tile: &StoredTile, start: u64, hash: ShortHash) -> Self {
        let NodeDeviation { drawn_m, drawn_max_m, source_m, source_max_m } = tile.deviation;
        Self {
            level: tile.id.level(),
            x: tile.id.x(),
            y: tile.id.y(),
            z_range_m: [tile.z_min_m, tile.z_max_m],
            deviation: [drawn_m, drawn_max_m, source_m, source_max_m],
            shows_children: tile.shows_children,
            start,
            bytes: tile.bytes,
            hash,
        }
    }

    /// The tile, with its place in the object of bytes; `None` if there is no such node.
    pub(super) fn stored(&self) -> Option<StoredTile> {
        let [drawn_m, drawn_max_m, source_m, source_max_m] = self.deviation;
        Some(StoredTile {
            id: TileId::new(self.level, self.x, self.y)?,
            z_min_m: self.z_range_m[0],
            z_max_m: self.z_range_m[1],
            deviation: NodeDeviation { drawn_m, drawn_max_m, source_m, source_max_m },
            offset: self.start,
            bytes: self.bytes,
            points: 0,
            shows_children: self.shows_children,
            unchanged: false,
        })
    }
}

impl MeshEntry {
    fn new(mesh: &StoredMesh, start: u64, hash: ShortHash) -> Self {
        let MeshLod { error_m, bytes, triangles, texture_px } = mesh.info;
        let (level, x, y, lod) = (mesh.id.level(), mesh.id.x(), mesh.id.y(), mesh.lod);
        Self { level, x, y, lod, error_m, triangles, texture_px, start, bytes, hash }
    }

    /// The mesh, with its place in the object of bytes; `None` if there is no such node.
    pub(super) fn stored(&self) -> Option<StoredMesh> {
        let Self { error_m, bytes, triangles, texture_px, .. } = *self;
        let info = MeshLod { error_m, bytes, triangles, texture_px };
        let id = TileId::new(self.level, self.x, self.y)?;
        mesh_tile::archive_id(id, self.lod)?;
        Some(StoredMesh { id, lod: self.lod, info, offset: self.start })
    }
}

impl TileIndex {
    /// All tiles and meshes; `None` if one is of no node.
    pub(super) fn stored(&self) -> Option<(Vec<StoredTile>, Vec<StoredMesh>)> {
        let tiles = self.tiles.iter().map(TileEntry::stored).collect::<Option<_>>()?;
        Some((tiles, self.meshes.iter().map(MeshEntry::stored).collect::<Option<_>>()?))
    }
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
        let (start, hash) = push(bytes.tile(tile)?)?;
        index.tiles.push(TileEntry::new(tile, start, hash));
    }
    let mut meshes: Vec<&StoredMesh> = tree.meshes().iter().collect();
    meshes.sort_by_cached_key(|mesh| mesh_tile::archive_id(mesh.id, mesh.lod).map(archive_order));
    for mesh in meshes {
        let (start, hash) = push(bytes.mesh(mesh)?)?;
        index.meshes.push(MeshEntry::new(mesh, start, hash));
    }
    writer.flush().map_err(failed)?;
    drop(writer);
    index.bytes = format!("{folder}/bytes");
    put_file(objects, &index.bytes, path)?;
    objects.write(&index_name(folder), INDEX_KIND, &index)?;
    Ok(index)
}
