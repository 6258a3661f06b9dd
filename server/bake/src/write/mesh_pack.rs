//! A block's finished meshes in one scratch file.
//!
//! In: levels of detail of a block's leaves. Out: a file, and where each lies in it. Next: `tree` and `archive` read it.
//!
//! Layout, little-endian: magic, number of tiles, per tile x, y, level of detail, error, triangles, pixels, bytes (4 bytes
//! each), the tiles, a blake3 of all before.

use std::{
    fs,
    io::{Read, Seek, SeekFrom},
    path::{Path, PathBuf},
};

use insula_protocol::{TileId, subtree::MeshLod};

use super::pack::{self, PackId};
use crate::{error::BakeError, mesh::EncodedLod};

const MAGIC: [u8; 4] = *b"INSQ";
const HEAD_BYTES: usize = 8;
const ENTRY_BYTES: usize = 28;

/// A level of detail that lies in its pack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct StoredMesh {
    pub(crate) id: TileId,
    pub(crate) lod: u8,
    pub(crate) info: MeshLod,
    offset: u64,
}

/// A leaf's levels of detail, the finest first.
pub(crate) type LeafMesh = (TileId, Vec<EncodedLod>);

fn path(folder: &Path, pack: PackId) -> PathBuf {
    folder.join(format!("m-{}-{}-{}.pack", pack.level, pack.x, pack.y))
}

/// Writes the pack under a temporary name, then renames it.
pub(crate) fn write(folder: &Path, pack: PackId, leaves: &[LeafMesh]) -> Result<Vec<StoredMesh>, BakeError> {
    let all = || leaves.iter().flat_map(|(id, lods)| (0u8..).zip(lods).map(|(lod, made)| (*id, lod, made)));
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
    all().for_each(|(.., made)| bytes.extend_from_slice(&made.bytes));
    pack::put(&path(folder, pack), bytes)?;
    Ok(stored)
}

/// What a pack from an earlier, interrupted run holds; `None` if there is none or it is not whole.
pub(crate) fn find(folder: &Path, pack: PackId) -> Option<Vec<StoredMesh>> {
    let bytes = pack::whole(&path(folder, pack), MAGIC)?;
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

/// The bytes of a level of detail.
pub(crate) fn read(folder: &Path, stored: &StoredMesh) -> Result<Vec<u8>, BakeError> {
    let path = path(folder, PackId::of(stored.id));
    let failed = |cause| BakeError::io(&path, "read", cause);
    let mut file = fs::File::open(&path).map_err(failed)?;
    let mut bytes = vec![0; stored.info.bytes as usize];
    file.seek(SeekFrom::Start(stored.offset)).and_then(|_| file.read_exact(&mut bytes)).map_err(failed)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::write::scratch::tests::Folder;

    #[test]
    fn round_trip_and_damage() {
        let folder = Folder::new("mesh-pack");
        let lod = |error_m: f32, length: usize| {
            let info = MeshLod { error_m, bytes: length as u32, triangles: 12, texture_px: 7 };
            EncodedLod { info, bytes: vec![length as u8; length] }
        };
        let id = |x, y| TileId::new(4, x, y).unwrap();
        let leaves = [(id(8, 8), vec![lod(0.1, 40), lod(0.2, 20)]), (id(9, 8), vec![]), (id(9, 9), vec![lod(0.5, 9)])];
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
        let path = path(&folder.path, pack);
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
