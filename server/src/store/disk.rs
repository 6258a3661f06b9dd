//! Blocks of remote archives on this machine's disk, so that a restart need not fetch them again.
//!
//! In: a block and its key. Out: the same bytes, or nothing. Next: `blocks`.
//!
//! A file a block: 32 bytes of BLAKE3, then the block. What cannot be written or read is as if it were not kept; what is
//! damaged is removed. The least recently used go first when there are too many bytes.

use bytes::Bytes;
use lru::LruCache;
use std::{
    fs, io,
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
    time::SystemTime,
};

const HASH_BYTES: usize = 32;

/// An archive (hash of its address and version) and the number of a block in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct BlockKey {
    pub(super) object: u128,
    pub(super) index: u64,
}

/// A bounded folder of blocks.
#[derive(Debug)]
pub(super) struct Disk {
    folder: PathBuf,
    max_bytes: u64,
    kept: Mutex<Kept>,
}

#[derive(Debug)]
struct Kept {
    blocks: LruCache<BlockKey, u64>,
    bytes: u64,
}

impl Disk {
    /// Makes the folder, or takes what an earlier run left in it. Errors: the folder cannot be made or read.
    pub(super) fn open(folder: &Path, max_bytes: u64) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        let mut found: Vec<(SystemTime, BlockKey, u64)> = Vec::new();
        for entry in fs::read_dir(folder)? {
            let entry = entry?;
            let about = entry.metadata()?;
            match key_of(&entry.file_name().to_string_lossy()) {
                Some(key) => found.push((about.modified().unwrap_or(SystemTime::UNIX_EPOCH), key, about.len())),
                None if about.is_file() && entry.path().extension().is_some_and(|e| e == "part") => {
                    // A write that was interrupted.
                    let _ = fs::remove_file(entry.path());
                }
                None => {}
            }
        }
        found.sort_by_key(|(time, ..)| *time);
        let disk = Self {
            folder: folder.to_owned(),
            max_bytes,
            kept: Mutex::new(Kept { blocks: LruCache::unbounded(), bytes: 0 }),
        };
        for (_, key, bytes) in found {
            disk.count(key, bytes);
        }
        Ok(disk)
    }

    /// The block, if it is kept and whole. It waits for the disk.
    pub(super) fn get(&self, key: BlockKey) -> Option<Bytes> {
        self.lock().blocks.get(&key)?;
        let bytes = fs::read(self.path(key)).ok().map(Bytes::from).filter(|bytes| is_whole(bytes));
        if bytes.is_none() {
            self.remove(key);
        }
        bytes.map(|bytes| bytes.slice(HASH_BYTES..))
    }

    /// Keeps a block. It waits for the disk.
    pub(super) fn put(&self, key: BlockKey, block: &[u8]) -> io::Result<()> {
        let (path, part) = (self.path(key), self.path(key).with_extension("part"));
        let mut bytes = Vec::with_capacity(HASH_BYTES + block.len());
        bytes.extend_from_slice(blake3::hash(block).as_bytes());
        bytes.extend_from_slice(block);
        fs::write(&part, &bytes).and_then(|()| fs::rename(&part, path)).inspect_err(|_| {
            let _ = fs::remove_file(&part);
        })?;
        self.count(key, bytes.len() as u64);
        Ok(())
    }

    /// Forgets a block.
    pub(super) fn remove(&self, key: BlockKey) {
        let mut kept = self.lock();
        if let Some(bytes) = kept.blocks.pop(&key) {
            kept.bytes -= bytes;
        }
        drop(kept);
        let _ = fs::remove_file(self.path(key));
    }

    fn count(&self, key: BlockKey, bytes: u64) {
        let mut kept = self.lock();
        kept.bytes += bytes;
        if let Some(before) = kept.blocks.put(key, bytes) {
            kept.bytes -= before;
        }
        while kept.bytes > self.max_bytes
            && let Some((oldest, bytes)) = kept.blocks.pop_lru()
        {
            kept.bytes -= bytes;
            let _ = fs::remove_file(self.path(oldest));
        }
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn path(&self, key: BlockKey) -> PathBuf {
        self.folder.join(format!("{:032x}-{:x}.block", key.object, key.index))
    }
}

fn key_of(name: &str) -> Option<BlockKey> {
    let (object, index) = name.strip_suffix(".block")?.split_once('-')?;
    let object = (object.len() == 32).then(|| u128::from_str_radix(object, 16).ok())??;
    Some(BlockKey { object, index: u64::from_str_radix(index, 16).ok()? })
}

fn is_whole(bytes: &[u8]) -> bool {
    bytes.split_at_checked(HASH_BYTES).is_some_and(|(hash, block)| blake3::hash(block).as_bytes() == hash)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_bounded_outlives_the_process_and_gives_nothing_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let key = |index| BlockKey { object: 7, index };
        let block = |index: u64| vec![index as u8; 100];
        let open = || Disk::open(folder.path(), 10 * 132).unwrap();
        let bytes = || fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().metadata().unwrap().len()).sum::<u64>();
        let disk = open();
        for index in 0..30 {
            disk.put(key(index), &block(index)).unwrap();
            assert_eq!(disk.get(key(0)).unwrap(), block(0), "in use");
            assert!(bytes() <= 10 * 132);
        }
        assert!(disk.get(key(5)).is_none());
        fs::write(folder.path().join("x.part"), "half").unwrap();
        fs::write(folder.path().join("notes.txt"), "not ours").unwrap();
        let disk = open();
        assert_eq!(disk.get(key(29)).unwrap(), block(29));
        assert!(!folder.path().join("x.part").exists() && folder.path().join("notes.txt").exists());
        let path = disk.path(key(29));
        for damage in [&b""[..], b"short", &[1; 132]] {
            fs::write(&path, damage).unwrap();
            assert!(disk.get(key(29)).is_none() && !path.exists());
            disk.put(key(29), &block(29)).unwrap();
        }
        fs::remove_dir_all(folder.path()).unwrap();
        assert!(disk.get(key(29)).is_none() && disk.put(key(1), &block(1)).is_err(), "without a disk it goes on");
    }
}
