//! The finished tiles and meshes of a block of one level in one scratch file: a magic number, the hash of what they are made from, the
//! bytes and points of each, a list in bincode, its length in 8 bytes, and a BLAKE3 hash of everything before. Only the version of the
//! program that wrote a pack reads it.

use super::files::write_renamed;
use crate::error::BakeError;
use crate::hash::ShortHash;
use crate::mesh::EncodedLod;
use crate::scene::grid::BLOCK_LEAVES;
use insula_protocol::TileId;
use insula_protocol::codec::bincode;
use insula_protocol::subtree::{MeshLod, NodeDeviation};
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const MAGIC: [u8; 4] = *b"INTB";
const POINT_BYTES: usize = 12;

/// The nodes that a pack contains: `BLOCK_LEAVES` x `BLOCK_LEAVES` nodes of one level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct PackId {
    pub(crate) level: u8,
    pub(crate) y: u32,
    pub(crate) x: u32,
}

impl PackId {
    /// The pack that contains `id`.
    pub(crate) fn of(id: TileId) -> Self {
        Self { level: id.level(), y: id.y() / BLOCK_LEAVES, x: id.x() / BLOCK_LEAVES }
    }

    fn path(self, folder: &Path) -> PathBuf {
        folder.join(format!("{}-{}-{}.pack", self.level, self.x, self.y))
    }
}

/// The nodes of a pack that are to be baked.
#[derive(Debug)]
pub(crate) struct PackNodes {
    pub(crate) pack: PackId,
    pub(crate) nodes: Vec<TileId>,
}

impl PackNodes {
    /// Groups nodes of one level by pack.
    pub(crate) fn group(mut nodes: Vec<TileId>) -> Vec<Self> {
        nodes.sort_by_key(|id| PackId::of(*id));
        let groups = nodes.chunk_by(|a, b| PackId::of(*a) == PackId::of(*b));
        groups.map(|nodes| Self { pack: PackId::of(nodes[0]), nodes: nodes.to_vec() }).collect()
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct EncodedTile {
    pub(crate) id: TileId,
    /// Lowest point of the node and its descendants, metres above the city's origin.
    pub(crate) z_min_m: f32,
    /// Highest point of the node and its descendants, metres above the city's origin.
    pub(crate) z_max_m: f32,
    pub(crate) deviation: NodeDeviation,
    /// Points on what its leaves draw, for the deviations of its ancestors.
    pub(crate) points: Vec<[f32; 3]>,
    pub(crate) bytes: Vec<u8>,
    /// Whether it shows the same as its children.
    pub(crate) shows_children: bool,
}

/// A tile that is in its pack, or in the object of its region.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct StoredTile {
    pub(crate) id: TileId,
    pub(crate) z_min_m: f32,
    pub(crate) z_max_m: f32,
    pub(crate) deviation: NodeDeviation,
    /// Of its bytes.
    pub(crate) offset: u64,
    pub(crate) bytes: u32,
    /// Number of its points in the pack.
    pub(crate) points: u32,
    /// Whether it shows the same as its children.
    pub(crate) shows_children: bool,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LeafMesh {
    pub(crate) id: TileId,
    /// Levels of detail, the finest first.
    pub(crate) lods: Vec<EncodedLod>,
}

/// A mesh tile that is in its pack, or in the object of its region.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct StoredMesh {
    pub(crate) id: TileId,
    /// Level of detail, 0 for the finest.
    pub(crate) lod: u8,
    pub(crate) info: MeshLod,
    /// Of its bytes.
    pub(crate) offset: u64,
}

/// The content of a pack before it is written.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct EncodedPack {
    pub(crate) tiles: Vec<EncodedTile>,
    /// Empty for parents.
    pub(crate) meshes: Vec<LeafMesh>,
}

/// What is in a pack.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct StoredPack {
    pub(crate) tiles: Vec<StoredTile>,
    pub(crate) meshes: Vec<StoredMesh>,
}

fn head(input: ShortHash) -> Vec<u8> {
    [MAGIC.as_slice(), input.as_slice()].concat()
}

/// Writes a pack into `folder`, without synchronising: [`find`] detects a file that a power failure cut short. `input` is the hash of
/// what the content is made from. Fails if the file cannot be written.
pub(crate) fn write(
    folder: &Path,
    pack: PackId,
    input: ShortHash,
    EncodedPack { tiles, meshes }: &EncodedPack,
) -> Result<StoredPack, BakeError> {
    let (mut all, mut stored) = (head(input), StoredPack::default());
    for EncodedTile { id, z_min_m, z_max_m, deviation, points, bytes, shows_children } in tiles {
        stored.tiles.push(StoredTile {
            id: *id,
            z_min_m: *z_min_m,
            z_max_m: *z_max_m,
            deviation: *deviation,
            offset: all.len() as u64,
            bytes: bytes.len() as u32,
            points: points.len() as u32,
            shows_children: *shows_children,
        });
        all.extend_from_slice(bytes);
        all.extend(points.iter().flatten().flat_map(|v| v.to_le_bytes()));
    }
    for LeafMesh { id, lods } in meshes {
        for (lod, EncodedLod { info, bytes }) in (0u8..).zip(lods) {
            stored.meshes.push(StoredMesh { id: *id, lod, info: *info, offset: all.len() as u64 });
            all.extend_from_slice(bytes);
        }
    }
    let path = pack.path(folder);
    let list = bincode::to_bytes(&stored).map_err(|_| BakeError::Scratch { path: path.clone() })?;
    all.extend_from_slice(&list);
    all.extend_from_slice(&(list.len() as u64).to_le_bytes());
    all.extend_from_slice(blake3::hash(&all).as_bytes());
    write_renamed(&path, |file| file.write_all(&all))?;
    Ok(stored)
}

/// The content of a pack that an interrupted run made from the same input; `None` if there is none or it is damaged.
pub(crate) fn find(folder: &Path, pack: PackId, input: ShortHash) -> Option<StoredPack> {
    let bytes = fs::read(pack.path(folder)).ok()?;
    let (body, hash) = bytes.split_last_chunk::<{ blake3::OUT_LEN }>()?;
    if !body.starts_with(&head(input)) || blake3::hash(body) != *hash {
        return None;
    }
    let (body, length) = body.split_last_chunk::<8>()?;
    let start = body.len().checked_sub(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    bincode::long_from_bytes(&body[start..]).ok()
}

/// Whether there are packs in a folder, whatever they are made from.
pub(crate) fn has_any(folder: &Path) -> bool {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).any(|path| path.extension().is_some_and(|end| end == "pack"))
}

fn points_bytes(count: u32) -> u64 {
    u64::from(count) * POINT_BYTES as u64
}

/// Reads tiles and meshes back. Keeps the last pack open, because neighbours are read one after the other.
pub(crate) struct PackReader<'a> {
    folder: &'a Path,
    open: Option<(PackId, fs::File)>,
}

impl<'a> PackReader<'a> {
    pub(crate) fn new(folder: &'a Path) -> Self {
        Self { folder, open: None }
    }

    /// The tile's bytes. Fails if the pack cannot be read.
    pub(crate) fn read(&mut self, stored: &StoredTile) -> Result<Vec<u8>, BakeError> {
        self.read_at(stored.id, stored.offset, u64::from(stored.bytes))
    }

    /// The tile's points. Fails if the pack cannot be read.
    pub(crate) fn read_points(&mut self, stored: &StoredTile) -> Result<Vec<[f32; 3]>, BakeError> {
        let bytes = self.read_at(stored.id, stored.offset + u64::from(stored.bytes), points_bytes(stored.points))?;
        let (points, _) = bytes.as_chunks::<POINT_BYTES>();
        let point = |b: &[u8; POINT_BYTES]| {
            std::array::from_fn(|i| f32::from_le_bytes([b[4 * i], b[4 * i + 1], b[4 * i + 2], b[4 * i + 3]]))
        };
        Ok(points.iter().map(point).collect())
    }

    /// The bytes of a mesh. Fails if the pack cannot be read.
    pub(crate) fn read_mesh(&mut self, stored: &StoredMesh) -> Result<Vec<u8>, BakeError> {
        self.read_at(stored.id, stored.offset, stored.info.bytes.into())
    }

    fn read_at(&mut self, id: TileId, offset: u64, len: u64) -> Result<Vec<u8>, BakeError> {
        let pack = PackId::of(id);
        let path = pack.path(self.folder);
        let failed = |cause| BakeError::io(&path, "read", cause);
        let mut file = match self.open.take() {
            Some((open, file)) if open == pack => file,
            _ => fs::File::open(&path).map_err(failed)?,
        };
        let mut bytes = vec![0; len as usize];
        file.seek(SeekFrom::Start(offset)).and_then(|_| file.read_exact(&mut bytes)).map_err(failed)?;
        self.open = Some((pack, file));
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::folder::TestFolder;

    const INPUT: ShortHash = [7; 16];

    fn tile([x, y]: [u32; 2], byte: u8, len: usize) -> EncodedTile {
        let deviation = NodeDeviation { drawn_m: 0.5, drawn_max_m: 2.0, source_m: 0.25, source_max_m: y as f32 };
        let id = TileId::new(4, x, y).unwrap();
        let points = vec![[1.5, f32::from(byte), -2.0]; usize::from(byte) - 1];
        EncodedTile {
            id,
            z_min_m: -1.5,
            z_max_m: x as f32,
            deviation,
            points,
            bytes: vec![byte; len],
            shows_children: byte == 2,
        }
    }

    #[test]
    fn pack_round_trips_and_damage_is_detected() {
        let folder = TestFolder::new("pack");
        let tiles = vec![tile([8, 8], 1, 100), tile([9, 8], 2, 7), tile([9, 9], 3, 1000)];
        let lod = |error_m: f32, length: usize| {
            let info = MeshLod { error_m, bytes: length as u32, triangles: 12, texture_px: 7 };
            EncodedLod { info, bytes: vec![length as u8; length] }
        };
        let lods = [vec![lod(0.1, 40), lod(0.2, 20)], vec![], vec![lod(0.5, 9)]];
        let meshes = tiles.iter().zip(lods).map(|(tile, lods)| LeafMesh { id: tile.id, lods }).collect();
        let (pack, content) = (PackId::of(tiles[0].id), EncodedPack { tiles, meshes });
        assert!(find(&folder.path, pack, INPUT).is_none() && !has_any(&folder.path));
        let stored = write(&folder.path, pack, INPUT, &content).unwrap();
        assert!(has_any(&folder.path));
        assert_eq!(find(&folder.path, pack, INPUT).unwrap(), stored);
        assert_eq!(find(&folder.path, pack, [8; 16]), None, "made from something else");
        let mut reader = PackReader::new(&folder.path);
        for (tile, stored) in content.tiles.iter().zip(&stored.tiles).rev() {
            assert_eq!(reader.read(stored).unwrap(), tile.bytes);
            assert_eq!(reader.read_points(stored).unwrap(), tile.points);
        }
        let of_meshes: Vec<_> = stored.meshes.iter().map(|mesh| (mesh.id.x(), mesh.lod)).collect();
        assert_eq!(of_meshes, [(8, 0), (8, 1), (9, 0)]);
        for mesh in &stored.meshes {
            assert_eq!(reader.read_mesh(mesh).unwrap(), vec![mesh.info.bytes as u8; mesh.info.bytes as usize]);
        }
        let path = pack.path(&folder.path);
        let good = fs::read(&path).unwrap();
        for at in 0..good.len() {
            fs::write(&path, &good[..at]).unwrap();
            assert_eq!(find(&folder.path, pack, INPUT), None, "cut to {at}");
            let mut bad = good.clone();
            bad[at] ^= 1;
            fs::write(&path, bad).unwrap();
            assert_eq!(find(&folder.path, pack, INPUT), None, "flipped {at}");
        }
    }

    #[test]
    fn empty_pack_is_found_again() {
        let folder = TestFolder::new("empty-pack");
        let pack = PackId { level: 3, y: 0, x: 0 };
        write(&folder.path, pack, INPUT, &EncodedPack::default()).unwrap();
        assert_eq!(find(&folder.path, pack, INPUT), Some(StoredPack::default()));
    }
}
