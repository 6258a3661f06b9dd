//! The directories of archives that are in memory: the most recently used ones of all archives of the process, under one limit.

use crate::directory::DirectoryEntry;
use lru::LruCache;
use std::any::Any;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

/// Memory unless [`set_most_directory_bytes`] says otherwise: 5.6 million tiles.
const DEFAULT_MOST_BYTES: usize = 128 << 20;
/// Estimated memory of a directory besides its entries.
const DIRECTORY_BYTES: usize = 256;

static RESIDENT: LazyLock<Mutex<Resident>> = LazyLock::new(|| Mutex::new(Resident::new(DEFAULT_MOST_BYTES)));
static NEXT_ARCHIVE: AtomicU64 = AtomicU64::new(0);

/// Sets the memory for the directories of all archives. Root directories count, and stay. One other directory stays, too.
pub fn set_most_directory_bytes(bytes: usize) {
    let mut resident = resident();
    resident.most = bytes;
    resident.evict();
}

/// Memory of the directories of all archives.
pub fn directory_bytes() -> usize {
    resident().bytes
}

fn resident() -> MutexGuard<'static, Resident> {
    RESIDENT.lock().unwrap_or_else(PoisonError::into_inner)
}

fn bytes_of(entries: usize) -> usize {
    entries * size_of::<DirectoryEntry>() + DIRECTORY_BYTES
}

/// The directories of all archives.
struct Resident {
    /// By number of the archive and position in its file.
    directories: LruCache<(u64, u64), (Arc<dyn Any + Send + Sync>, usize)>,
    bytes: usize,
    most: usize,
}

impl Resident {
    fn new(most: usize) -> Self {
        Self { directories: LruCache::unbounded(), bytes: 0, most }
    }

    fn get(&mut self, key: (u64, u64)) -> Option<Arc<dyn Any + Send + Sync>> {
        self.directories.get(&key).map(|(directory, _)| Arc::clone(directory))
    }

    fn put(&mut self, key: (u64, u64), directory: Arc<dyn Any + Send + Sync>, bytes: usize) {
        self.bytes += bytes;
        if let Some((_, replaced)) = self.directories.put(key, (directory, bytes)) {
            self.bytes -= replaced;
        }
        self.evict();
    }

    fn evict(&mut self) {
        while self.bytes > self.most && self.directories.len() > 1 {
            let Some((_, (_, oldest))) = self.directories.pop_lru() else { return };
            self.bytes -= oldest;
        }
    }

    fn remove_archive(&mut self, archive: u64) {
        let keys = self.directories.iter().map(|(key, _)| *key).filter(|(of, _)| *of == archive);
        for key in keys.collect::<Vec<_>>() {
            if let Some((_, bytes)) = self.directories.pop(&key) {
                self.bytes -= bytes;
            }
        }
    }
}

/// The directories of one archive, by their position in the file.
#[derive(Debug)]
pub(crate) struct ResidentDirectories {
    archive: u64,
    /// Memory of a root directory that stays.
    root_bytes: usize,
}

impl ResidentDirectories {
    pub(crate) fn new() -> Self {
        Self { archive: NEXT_ARCHIVE.fetch_add(1, Relaxed), root_bytes: 0 }
    }

    /// Counts a root directory of so many entries, which the archive keeps.
    pub(crate) fn with_root(entries: usize) -> Self {
        let mut directories = Self::new();
        directories.root_bytes = bytes_of(entries);
        let mut resident = resident();
        resident.bytes += directories.root_bytes;
        resident.evict();
        directories
    }

    pub(crate) fn get<T: Any + Send + Sync>(&self, offset: u64) -> Option<Arc<T>> {
        resident().get((self.archive, offset))?.downcast().ok()
    }

    /// Adds a directory of so many entries.
    pub(crate) fn put<T: Any + Send + Sync>(&self, offset: u64, directory: Arc<T>, entries: usize) {
        resident().put((self.archive, offset), directory, bytes_of(entries));
    }
}

impl Drop for ResidentDirectories {
    fn drop(&mut self) {
        let mut resident = resident();
        resident.remove_archive(self.archive);
        resident.bytes -= self.root_bytes;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_recently_used_directories_of_all_archives_are_evicted() {
        let mut resident = Resident::new(400);
        for offset in 0..4 {
            resident.put((offset % 2, offset), Arc::new(offset), 100);
        }
        // The same again takes no more.
        resident.put((1, 1), Arc::new(9_u64), 100);
        let mut found = |keys: [(u64, u64); 3]| keys.map(|key| resident.get(key)?.downcast::<u64>().ok().map(|v| *v));
        assert_eq!(found([(0, 0), (1, 1), (1, 0)]), [Some(0), Some(9), None]);
        resident.put((2, 4), Arc::new(4_u64), 100);
        assert!(resident.get((0, 2)).is_none(), "of another archive, and used longest ago");
        assert_eq!((resident.bytes, resident.directories.len()), (400, 4));
        resident.remove_archive(1);
        assert_eq!((resident.bytes, resident.directories.len()), (200, 2));
        // One that is larger than all memory stays alone.
        resident.put((7, 7), Arc::new(7_u64), 900);
        assert_eq!((resident.bytes, resident.directories.len()), (900, 1));
    }

    #[test]
    fn the_directories_of_an_archive_go_with_it() {
        let archive = ResidentDirectories::with_root(0);
        let directory = Arc::new(vec![1, 2]);
        archive.put(5, Arc::clone(&directory), 2);
        assert_eq!(archive.get::<Vec<i32>>(5), Some(Arc::clone(&directory)));
        assert_eq!(ResidentDirectories::new().get::<Vec<i32>>(5), None, "of another archive");
        assert!(directory_bytes() >= bytes_of(0) + bytes_of(2));
        drop(archive);
        assert_eq!(Arc::strong_count(&directory), 1);
    }
}
