//! The finished meshes of a block's leaves in one scratch file: the hash of what they are made from, their bytes, then a list.

use super::files::{pack_head, read_pack, write_pack};
use super::tile_pack::PackId;
use crate::error::BakeError;
use crate::hash::ShortHash;
use crate::mesh::EncodedLod;
use insula_protocol::TileId;
use insula_protocol::subtree::MeshLod;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

const MAGIC: [u8; 4] = *b"INTQ";

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

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LeafMesh {
    pub(crate) id: TileId,
    /// Levels of detail, the finest first.
    pub(crate) lods: Vec<EncodedLod>,
}

fn pack_path(folder: &Path, pack: PackId) -> PathBuf {
    folder.join(format!("m-{}-{}-{}.pack", pack.level, pack.x, pack.y))
}

/// Writes a pack into `folder`. `input` is the hash of what the meshes are made from. Fails if the file cannot be written.
pub(crate) fn write(
    folder: &Path,
    pack: PackId,
    input: ShortHash,
    leaves: &[LeafMesh],
) -> Result<Vec<StoredMesh>, BakeError> {
    let (mut all, mut stored) = (pack_head(MAGIC, input), Vec::new());
    for LeafMesh { id, lods } in leaves {
        for (lod, EncodedLod { info, bytes }) in (0u8..).zip(lods) {
            stored.push(StoredMesh { id: *id, lod, info: *info, offset: all.len() as u64 });
            all.extend_from_slice(bytes);
        }
    }
    write_pack(&pack_path(folder, pack), all, &stored)?;
    Ok(stored)
}

/// The content of a pack that an interrupted run made from the same input; `None` if there is none or it is damaged.
pub(crate) fn find(folder: &Path, pack: PackId, input: ShortHash) -> Option<Vec<StoredMesh>> {
    read_pack(&pack_path(folder, pack), &pack_head(MAGIC, input))
}

/// The bytes of a mesh tile. Fails if the pack cannot be read.
pub(crate) fn read(folder: &Path, stored: &StoredMesh) -> Result<Vec<u8>, BakeError> {
    let path = pack_path(folder, PackId::of(stored.id));
    let failed = |cause| BakeError::io(&path, "read", cause);
    let mut file = fs::File::open(&path).map_err(failed)?;
    let mut bytes = vec![0; stored.info.bytes as usize];
    file.seek(SeekFrom::Start(stored.offset)).and_then(|_| file.read_exact(&mut bytes)).map_err(failed)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::folder::TestFolder;

    const INPUT: ShortHash = [7; 16];

    #[test]
    fn pack_round_trips_and_damage_is_detected() {
        let folder = TestFolder::new("mesh-pack");
        let lod = |error_m: f32, length: usize| {
            let info = MeshLod { error_m, bytes: length as u32, triangles: 12, texture_px: 7 };
            EncodedLod { info, bytes: vec![length as u8; length] }
        };
        let id = |x, y| TileId::new(4, x, y).unwrap();
        let leaf = |id, lods| LeafMesh { id, lods };
        let leaves = [
            leaf(id(8, 8), vec![lod(0.1, 40), lod(0.2, 20)]),
            leaf(id(9, 8), vec![]),
            leaf(id(9, 9), vec![lod(0.5, 9)]),
        ];
        let pack = PackId::of(id(8, 8));
        assert_eq!(find(&folder.path, pack, INPUT), None);
        let stored = write(&folder.path, pack, INPUT, &leaves).unwrap();
        assert_eq!(
            stored.iter().map(|mesh| (mesh.id, mesh.lod)).collect::<Vec<_>>(),
            [(id(8, 8), 0), (id(8, 8), 1), (id(9, 9), 0)]
        );
        assert_eq!(find(&folder.path, pack, INPUT).unwrap(), stored);
        assert_eq!(find(&folder.path, pack, [8; 16]), None, "made from something else");
        for mesh in &stored {
            assert_eq!(read(&folder.path, mesh).unwrap(), vec![mesh.info.bytes as u8; mesh.info.bytes as usize]);
        }
        let path = pack_path(&folder.path, pack);
        let good = fs::read(&path).unwrap();
        for at in 0..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 1;
            fs::write(&path, bad).unwrap();
            assert_eq!(find(&folder.path, pack, INPUT), None, "flipped {at}");
            fs::write(&path, &good[..at]).unwrap();
            assert_eq!(find(&folder.path, pack, INPUT), None, "cut to {at}");
        }
    }
}
