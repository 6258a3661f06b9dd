//! The unpacked tiles and strips that were used last, bounded in bytes.

use lru::LruCache;
use std::sync::Arc;

/// Blocks of numbers by the image and the number of the block within it.
pub(super) struct BlockCache<T> {
    blocks: LruCache<(usize, u64), Arc<Vec<T>>>,
    bytes: u64,
    limit: u64,
}

impl<T> BlockCache<T> {
    pub(super) fn new(limit: u64) -> Self {
        Self { blocks: LruCache::unbounded(), bytes: 0, limit }
    }

    pub(super) fn get(&mut self, key: (usize, u64)) -> Option<Arc<Vec<T>>> {
        self.blocks.get(&key).cloned()
    }

    /// Keeps a block, and forgets those used least recently. The last one is kept whatever its size: the next window is
    /// likely within it.
    pub(super) fn put(&mut self, key: (usize, u64), block: Arc<Vec<T>>) {
        let size = size_of_block(&block);
        if let Some(replaced) = self.blocks.put(key, block) {
            self.bytes -= size_of_block(&replaced);
        }
        self.bytes += size;
        while self.bytes > self.limit
            && self.blocks.len() > 1
            && let Some((_, oldest)) = self.blocks.pop_lru()
        {
            self.bytes -= size_of_block(&oldest);
        }
    }
}

fn size_of_block<T>(block: &[T]) -> u64 {
    size_of_val(block) as u64
}
