//! The city's file `fingerprints.bin`: a hash of the input of each block of leaves, for a later `bake --update`.
//!
//! Layout, little-endian: magic, number of blocks (4 bytes each), the manifest's version (16 characters), per block x,
//! y (4 bytes each) and 16 bytes of hash, a BLAKE3 hash of everything before.

use super::files::write_synced;
use crate::error::BakeError;
use crate::hash::ShortHash;
use std::io::Read;
use std::path::{Path, PathBuf};

pub(super) const MAGIC: [u8; 4] = *b"INSF";
const HEAD_BYTES: usize = 24;
const ENTRY_BYTES: usize = 24;
const HASH_BYTES: usize = blake3::OUT_LEN;
/// A larger file is refused. The limit is enough for 40 million blocks.
const MAX_BYTES: u64 = 1 << 30;

/// The content of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Fingerprints {
    /// Version of the manifest in the same folder.
    pub(crate) version: String,
    /// (x, y) of each block and its hash, row by row.
    pub(crate) blocks: Vec<((u32, u32), ShortHash)>,
}

/// The file's name in a city's folder.
pub(super) const FILE_NAME: &str = "fingerprints.bin";

fn file_path(folder: &Path) -> PathBuf {
    folder.join(FILE_NAME)
}

impl Fingerprints {
    /// Writes the file and returns its length. Fails if it cannot be written.
    pub(crate) fn write(&self, folder: &Path) -> Result<u64, BakeError> {
        let mut bytes = Vec::with_capacity(HEAD_BYTES + ENTRY_BYTES * self.blocks.len() + HASH_BYTES);
        bytes.extend_from_slice(&MAGIC);
        bytes.extend_from_slice(&(self.blocks.len() as u32).to_le_bytes());
        bytes.extend_from_slice(format!("{:16.16}", self.version).as_bytes());
        for ((x, y), hash) in &self.blocks {
            bytes.extend_from_slice(&x.to_le_bytes());
            bytes.extend_from_slice(&y.to_le_bytes());
            bytes.extend_from_slice(hash);
        }
        bytes.extend_from_slice(blake3::hash(&bytes).as_bytes());
        write_synced(&file_path(folder), &bytes)?;
        Ok(bytes.len() as u64)
    }

    /// Reads the file of a city folder; `None` if there is none or it is damaged.
    pub(crate) fn read(folder: &Path) -> Option<Self> {
        let mut bytes = Vec::new();
        insula_archive::file::open_regular(&file_path(folder))
            .ok()?
            .take(MAX_BYTES + 1)
            .read_to_end(&mut bytes)
            .ok()?;
        if bytes.len() as u64 > MAX_BYTES {
            return None;
        }
        let (body, hash) = bytes.split_last_chunk::<HASH_BYTES>()?;
        if blake3::hash(body) != *hash || body.get(..4)? != MAGIC {
            return None;
        }
        let (head, entries) = body.split_at_checked(HEAD_BYTES)?;
        let (entries, rest) = entries.as_chunks::<ENTRY_BYTES>();
        let word = |bytes: &[u8]| Some(u32::from_le_bytes(bytes.get(..4)?.try_into().ok()?));
        if !rest.is_empty() || word(&head[4..])? as usize != entries.len() {
            return None;
        }
        let block = |entry: &[u8; ENTRY_BYTES]| {
            Some(((word(&entry[..4])?, word(&entry[4..8])?), entry.last_chunk::<16>().copied()?))
        };
        let version = std::str::from_utf8(&head[8..]).ok()?.trim_end().to_owned();
        Some(Self { version, blocks: entries.iter().map(block).collect::<Option<_>>()? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::folder::TestFolder;
    use std::fs;

    #[test]
    fn file_round_trips_and_damage_is_detected() {
        let folder = TestFolder::new("fingerprints");
        assert_eq!(Fingerprints::read(&folder.path), None);
        let blocks = vec![((0, 1), [7; 16]), ((u32::MAX, 3), std::array::from_fn(|i| i as u8))];
        let all = Fingerprints { version: "0123456789abcdef".into(), blocks };
        let length = all.write(&folder.path).unwrap();
        let good = fs::read(file_path(&folder.path)).unwrap();
        assert_eq!(length, good.len() as u64);
        assert_eq!(Fingerprints::read(&folder.path), Some(all));
        for cut in 0..good.len() {
            fs::write(file_path(&folder.path), &good[..cut]).unwrap();
            assert_eq!(Fingerprints::read(&folder.path), None, "cut to {cut}");
        }
        for at in 0..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 4;
            fs::write(file_path(&folder.path), bad).unwrap();
            assert_eq!(Fingerprints::read(&folder.path), None, "flipped {at}");
        }
    }
}
