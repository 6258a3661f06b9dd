//! The finished meshes of a block's leaves in one scratch file.
//!
//! Layout, little-endian: magic, number of tiles, per tile x, y, level of detail, error, triangles, pixels, bytes (4
//! bytes each), the tiles, a BLAKE3 hash of everything before.

use super::files::{read_hashed, write_hashed};
use super::tile_pack::PackId;
use crate::error::BakeError;
use crate::mesh::EncodedLod;
use insula_protocol::TileId;
use insula_protocol::subtree::MeshLod;
use std::fs;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

const MAGIC: [u8; 4] = *b"INSQ";
const HEAD_BYTES: usize = 8;
const ENTRY_BYTES: usize = 28;

/// A mesh tile that is in its pack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct StoredMesh {
    pub(crate) id: TileId,
    /// Level of detail, 0 for the finest.
    pub(crate) lod: u8,
    pub(crate) info: MeshLod,
    /// Of its bytes in the pack.
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

/// Writes a pack into `folder`. Fails if the file cannot be written.
pub(crate) fn write(folder: &Path, pack: PackId, leaves: &[LeafMesh]) -> Result<Vec<StoredMesh>, BakeError> {
    let all = || leaves.iter().flat_map(|leaf| (0u8..).zip(&leaf.lods).map(|(lod, mesh)| (leaf.id, lod, mesh)));
    let count = all().count();
    let mut bytes = MAGIC.to_vec();
    bytes.extend_from_slice(&(count as u32).to_le_bytes());
    let mut offset = (HEAD_BYTES + ENTRY_BYTES * count) as u64;
    let mut stored = Vec::with_capacity(count);
    for (id, lod, EncodedLod { info, .. }) in all() {
        let MeshLod { error_m, bytes: length, triangles, texture_px } = *info;
        for word in [id.x(), id.y(), lod.into(), error_m.to_bits(), triangles, texture_px, length] {
            bytes.extend_from_slice(&word.to_le_bytes());
        }
        stored.push(StoredMesh { id, lod, info: *info, offset });
        offset += u64::from(length);
    }
    all().for_each(|(.., mesh)| bytes.extend_from_slice(&mesh.bytes));
    write_hashed(&pack_path(folder, pack), bytes)?;
    Ok(stored)
}

/// The content of a pack that an interrupted run wrote; `None` if there is none or it is damaged.
pub(crate) fn find(folder: &Path, pack: PackId) -> Option<Vec<StoredMesh>> {
    let bytes = read_hashed(&pack_path(folder, pack), MAGIC)?;
    let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    let count = word(4)? as usize;
    let mut offset = HEAD_BYTES.checked_add(count.checked_mul(ENTRY_BYTES)?)? as u64;
    let mut stored = Vec::new();
    for at in (0..count).map(|entry| HEAD_BYTES + entry * ENTRY_BYTES) {
        let id = TileId::new(pack.level, word(at)?, word(at + 4)?)?;
        let lod = u8::try_from(word(at + 8)?).ok()?;
        let error_m = f32::from_bits(word(at + 12)?);
        let info = MeshLod { error_m, triangles: word(at + 16)?, texture_px: word(at + 20)?, bytes: word(at + 24)? };
        stored.push(StoredMesh { id, lod, info, offset });
        offset += u64::from(info.bytes);
    }
    (offset == bytes.len() as u64).then_some(stored)
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
        assert_eq!(find(&folder.path, pack), None);
        let stored = write(&folder.path, pack, &leaves).unwrap();
        assert_eq!(
            stored.iter().map(|mesh| (mesh.id, mesh.lod)).collect::<Vec<_>>(),
            [(id(8, 8), 0), (id(8, 8), 1), (id(9, 9), 0)]
        );
        assert_eq!(find(&folder.path, pack).unwrap(), stored);
        for mesh in &stored {
            assert_eq!(read(&folder.path, mesh).unwrap(), vec![mesh.info.bytes as u8; mesh.info.bytes as usize]);
        }
        let path = pack_path(&folder.path, pack);
        let good = fs::read(&path).unwrap();
        for at in 0..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 1;
            fs::write(&path, bad).unwrap();
            assert_eq!(find(&folder.path, pack), None, "flipped {at}");
            fs::write(&path, &good[..at]).unwrap();
            assert_eq!(find(&folder.path, pack), None, "cut to {at}");
        }
    }
}
