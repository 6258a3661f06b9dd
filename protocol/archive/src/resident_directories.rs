//! The most recently used directories of an archive.

use crate::directory::DirectoryEntry;
use lru::LruCache;
use std::sync::Arc;

/// Memory for the directories of an archive: 1.4 million tiles.
const RESIDENT_BYTES: usize = 32 << 20;

/// Directories in memory, by their position in the file. The least recently used ones are evicted.
#[derive(Debug)]
pub(crate) struct ResidentDirectories<T> {
    directories: LruCache<u64, (Arc<T>, usize)>,
    bytes: usize,
}

impl<T> ResidentDirectories<T> {
    pub(crate) fn new() -> Self {
        Self { directories: LruCache::unbounded(), bytes: 0 }
    }

    pub(crate) fn get(&mut self, offset: u64) -> Option<Arc<T>> {
        self.directories.get(&offset).map(|(directory, _)| Arc::clone(directory))
    }

    /// Adds a directory of so many entries.
    pub(crate) fn put(&mut self, offset: u64, directory: Arc<T>, entries: usize) {
        let bytes = entries * size_of::<DirectoryEntry>();
        self.bytes += bytes;
        if let Some((_, replaced)) = self.directories.put(offset, (directory, bytes)) {
            self.bytes -= replaced;
        }
        while self.bytes > RESIDENT_BYTES && self.directories.len() > 1 {
            let Some((_, (_, oldest))) = self.directories.pop_lru() else { return };
            self.bytes -= oldest;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_recently_used_directories_are_evicted() {
        let mut resident = ResidentDirectories::new();
        let entries = RESIDENT_BYTES / size_of::<DirectoryEntry>() / 4;
        for offset in 0..4 {
            resident.put(offset, Arc::new(offset), entries);
        }
        // The same again takes no more.
        resident.put(1, Arc::new(9), entries);
        assert_eq!(resident.get(0).as_deref(), Some(&0));
        resident.put(4, Arc::new(4), entries);
        let found: Vec<Option<u64>> = (0..5).map(|offset| resident.get(offset).map(|found| *found)).collect();
        assert_eq!(found, [Some(0), Some(9), None, Some(3), Some(4)]);
        assert_eq!(resident.directories.iter().map(|(_, (_, bytes))| bytes).sum::<usize>(), resident.bytes);
        assert!(resident.bytes <= RESIDENT_BYTES);
        // One that is larger than all memory stays alone.
        resident.put(7, Arc::new(7), 9 * entries);
        assert_eq!((resident.directories.len(), resident.get(7).as_deref()), (1, Some(&7)));
    }
}
