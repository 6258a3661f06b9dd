//! A block's finished tiles in one scratch file.
//!
//! In: a block's tiles, of one level. Out: a file, and where each tile lies in it. Next: `tree` and `archive` read it.
//!
//! Layout, little-endian: magic, number of tiles, per tile x, y, z_min, z_max, bytes (4 bytes each), the tiles, a blake3 of
//! all before. Scratch files are read only by the program that wrote them; the hash finds what a power cut left.

use std::{
    fs,
    io::{Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
};

use insula_protocol::TileId;

use crate::{error::BakeError, scene::grid::BLOCK_LEAVES};

const MAGIC: [u8; 4] = *b"INSP";
const HEAD_BYTES: usize = 8;
const ENTRY_BYTES: usize = 20;
const HASH_BYTES: usize = blake3::OUT_LEN;

/// The block that a pack holds: `BLOCK_LEAVES` x `BLOCK_LEAVES` nodes of one level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PackId {
    pub(crate) level: u8,
    pub(crate) y: u32,
    pub(crate) x: u32,
}

impl PackId {
    /// The pack that `id` belongs into.
    pub(crate) fn of(id: TileId) -> Self {
        Self { level: id.level(), y: id.y() / BLOCK_LEAVES, x: id.x() / BLOCK_LEAVES }
    }

    fn path(self, folder: &Path) -> PathBuf {
        folder.join(format!("{}-{}-{}.pack", self.level, self.x, self.y))
    }
}

/// An encoded tile.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct EncodedTile {
    pub(crate) id: TileId,
    /// Lowest point of it and its descendants, metres above the city's origin.
    pub(crate) z_min_m: f32,
    /// Highest point likewise.
    pub(crate) z_max_m: f32,
    pub(crate) bytes: Vec<u8>,
}

/// A tile that lies in its pack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct StoredTile {
    pub(crate) id: TileId,
    pub(crate) z_min_m: f32,
    pub(crate) z_max_m: f32,
    offset: u64,
    pub(crate) bytes: u32,
    /// Whether the city to update has the same tile; not kept in the pack.
    pub(crate) unchanged: bool,
}

/// Writes the pack under a temporary name, then renames it.
pub(crate) fn write(folder: &Path, pack: PackId, tiles: &[EncodedTile]) -> Result<Vec<StoredTile>, BakeError> {
    let (mut bytes, mut stored) = (Vec::new(), Vec::with_capacity(tiles.len()));
    bytes.extend_from_slice(&MAGIC);
    bytes.extend_from_slice(&(tiles.len() as u32).to_le_bytes());
    let mut offset = (HEAD_BYTES + ENTRY_BYTES * tiles.len()) as u64;
    for tile in tiles {
        let (z_min_m, z_max_m, len) = (tile.z_min_m, tile.z_max_m, tile.bytes.len() as u32);
        for word in [tile.id.x(), tile.id.y(), z_min_m.to_bits(), z_max_m.to_bits(), len] {
            bytes.extend_from_slice(&word.to_le_bytes());
        }
        stored.push(StoredTile { id: tile.id, z_min_m, z_max_m, offset, bytes: len, unchanged: false });
        offset += u64::from(len);
    }
    for tile in tiles {
        bytes.extend_from_slice(&tile.bytes);
    }
    put(&pack.path(folder), bytes)?;
    Ok(stored)
}

/// Writes bytes and their hash under a temporary name, then renames the file.
pub(super) fn put(path: &Path, mut bytes: Vec<u8>) -> Result<(), BakeError> {
    bytes.extend_from_slice(blake3::hash(&bytes).as_bytes());
    let temporary = path.with_extension("tmp");
    let written = fs::File::create(&temporary).and_then(|mut file| file.write_all(&bytes));
    written.map_err(|cause| BakeError::io(&temporary, "written", cause))?;
    fs::rename(&temporary, path).map_err(|cause| BakeError::io(path, "written", cause))
}

/// What [`put`] wrote there, if it is whole and begins with `magic`.
pub(super) fn whole(path: &Path, magic: [u8; 4]) -> Option<Vec<u8>> {
    let mut bytes = fs::read(path).ok()?;
    let body = bytes.len().checked_sub(HASH_BYTES)?;
    let sound = blake3::hash(&bytes[..body]).as_bytes()[..] == bytes[body..] && bytes.starts_with(&magic);
    bytes.truncate(body);
    sound.then_some(bytes)
}

/// What a pack from an earlier, interrupted run holds; `None` if there is none or it is not whole.
pub(crate) fn find(folder: &Path, pack: PackId) -> Option<Vec<StoredTile>> {
    let bytes = whole(&pack.path(folder), MAGIC)?;
    let body = bytes.len();
    let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    let count = word(4)? as usize;
    let mut offset = HEAD_BYTES.checked_add(count.checked_mul(ENTRY_BYTES)?)? as u64;
    let mut stored = Vec::new();
    for entry in 0..count {
        let at = HEAD_BYTES + entry * ENTRY_BYTES;
        let id = TileId::new(pack.level, word(at)?, word(at + 4)?)?;
        let (z_min_m, z_max_m) = (f32::from_bits(word(at + 8)?), f32::from_bits(word(at + 12)?));
        let bytes = word(at + 16)?;
        stored.push(StoredTile { id, z_min_m, z_max_m, offset, bytes, unchanged: false });
        offset += u64::from(bytes);
    }
    (offset == body as u64).then_some(stored)
}

/// Reads tiles back; keeps the last pack open, since neighbours are asked for one after the other.
pub(crate) struct PackReader<'a> {
    folder: &'a Path,
    open: Option<(PackId, fs::File)>,
}

impl<'a> PackReader<'a> {
    pub(crate) fn new(folder: &'a Path) -> Self {
        Self { folder, open: None }
    }

    /// The tile's bytes.
    pub(crate) fn read(&mut self, stored: &StoredTile) -> Result<Vec<u8>, BakeError> {
        let pack = PackId::of(stored.id);
        let path = pack.path(self.folder);
        let failed = |cause| BakeError::io(&path, "read", cause);
        let mut file = match self.open.take() {
            Some((open, file)) if open == pack => file,
            _ => fs::File::open(&path).map_err(failed)?,
        };
        let mut bytes = vec![0; stored.bytes as usize];
        file.seek(SeekFrom::Start(stored.offset)).and_then(|_| file.read_exact(&mut bytes)).map_err(failed)?;
        self.open = Some((pack, file));
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::write::scratch::tests::Folder;

    fn tile([x, y]: [u32; 2], byte: u8, len: usize) -> EncodedTile {
        EncodedTile { id: TileId::new(4, x, y).unwrap(), z_min_m: -1.5, z_max_m: x as f32, bytes: vec![byte; len] }
    }

    #[test]
    fn round_trip_and_damage() {
        let folder = Folder::new("pack");
        let tiles = [tile([8, 8], 1, 100), tile([9, 8], 2, 7), tile([9, 9], 3, 1000)];
        let pack = PackId::of(tiles[0].id);
        assert_eq!(find(&folder.path, pack), None);
        let stored = write(&folder.path, pack, &tiles).unwrap();
        assert_eq!(find(&folder.path, pack).unwrap(), stored);
        let mut reader = PackReader::new(&folder.path);
        for (tile, stored) in tiles.iter().zip(&stored).rev() {
            assert_eq!(reader.read(stored).unwrap(), tile.bytes);
        }
        let path = pack.path(&folder.path);
        let good = fs::read(&path).unwrap();
        for cut in [0, 3, 40, good.len() - 1] {
            fs::write(&path, &good[..cut]).unwrap();
            assert_eq!(find(&folder.path, pack), None, "cut to {cut}");
        }
        for at in [0, 5, 9, 30, 200, good.len() - 1] {
            let mut bad = good.clone();
            bad[at] ^= 1;
            fs::write(&path, bad).unwrap();
            assert_eq!(find(&folder.path, pack), None, "flipped {at}");
        }
    }

    #[test]
    fn a_block_without_tiles_is_known_to_be_done() {
        let folder = Folder::new("empty-pack");
        let pack = PackId { level: 3, y: 0, x: 0 };
        write(&folder.path, pack, &[]).unwrap();
        assert_eq!(find(&folder.path, pack), Some(vec![]));
    }
}
