//! Blocks of remote objects in memory and, if wanted, on disk. Each is fetched once however many callers want it.

use crate::disk_cache::DiskCache;
use crate::source::{BoxFuture, SharedSource};
use crate::{RangeRead, RangeSource, ReadError};
use bytes::Bytes;
use moka::future::Cache;
use std::fmt::{self, Debug};
use std::io;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use tokio::task::spawn_blocking;

/// Memory for a block besides its bytes.
const BLOCK_OVERHEAD_BYTES: usize = 128;
const EXTENSION: &str = "block";

/// One version of a remote object.
pub trait BlockObject: Debug + Send + Sync {
    /// Hash of the object's address and version: equal ids have equal bytes.
    fn id(&self) -> u128;

    /// Length in bytes.
    fn length(&self) -> u64;

    /// Fetches a range that lies inside the object. Fails with [`ReadError::Replaced`] if the object has another version now.
    fn fetch(&self, range: Range<u64>) -> BoxFuture<'_, Result<Bytes, ReadError>>;
}

/// Something to count or log.
#[derive(Debug)]
pub enum BlockEvent {
    /// A block was read from memory.
    MemoryHit,
    /// A block was read from disk.
    DiskHit,
    Fetched,
    /// A block could not be written to disk.
    DiskError(io::Error),
}

/// Sizes of a [`BlockCache`].
#[derive(Debug, Clone)]
pub struct BlockCacheOptions {
    pub block_bytes: u64,
    pub memory_bytes: u64,
    pub folder: Option<PathBuf>,
    /// Bytes of all blocks in the folder.
    pub folder_bytes: u64,
}

/// The blocks of all remote objects of this process.
pub struct BlockCache {
    memory: Cache<BlockKey, Bytes>,
    disk: Option<Arc<DiskCache>>,
    block_bytes: u64,
    observer: Arc<dyn Fn(BlockEvent) + Send + Sync>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct BlockKey {
    object: u128,
    index: u64,
}

impl BlockKey {
    fn name(self) -> String {
        format!("{:032x}-{:x}", self.object, self.index)
    }
}

impl BlockCache {
    /// Fails if the folder cannot be used. `observer` is called on any thread.
    pub fn new(options: &BlockCacheOptions, observer: impl Fn(BlockEvent) + Send + Sync + 'static) -> io::Result<Self> {
        let open = |folder: &PathBuf| DiskCache::open(folder, EXTENSION, options.folder_bytes);
        let disk = options.folder.as_ref().map(open).transpose()?;
        let weight =
            |_: &BlockKey, block: &Bytes| u32::try_from(block.len() + BLOCK_OVERHEAD_BYTES).unwrap_or(u32::MAX);
        Ok(Self {
            memory: Cache::builder().max_capacity(options.memory_bytes).weigher(weight).build(),
            disk: disk.map(Arc::new),
            block_bytes: options.block_bytes,
            observer: Arc::new(observer),
        })
    }

    /// The object, read through this cache.
    pub fn source(self: &Arc<Self>, object: Arc<dyn BlockObject>) -> SharedSource {
        Arc::new(BlockSource { cache: self.clone(), object })
    }

    fn keys(&self, object: &dyn BlockObject, range: &Range<u64>) -> impl Iterator<Item = BlockKey> + use<> {
        let object = object.id();
        let indices = range.start / self.block_bytes..range.end.div_ceil(self.block_bytes);
        indices.map(move |index| BlockKey { object, index })
    }

    /// Reads a range that lies inside the object. The bytes are a copy: whoever keeps them would else keep their whole block, uncounted.
    async fn read(&self, object: &dyn BlockObject, range: Range<u64>) -> Result<Bytes, ReadError> {
        let mut bytes = Vec::new();
        for key in self.keys(object, &range) {
            let block = self.block(object, key).await?;
            let start = key.index * self.block_bytes;
            let part = range.start.max(start) - start..range.end.min(start + block.len() as u64) - start;
            if bytes.is_empty() {
                // After the first block, so that an object that is not there costs nothing.
                bytes.reserve_exact((range.end - range.start) as usize);
            }
            bytes.extend_from_slice(block.get(part.start as usize..part.end as usize).unwrap_or_default());
        }
        Ok(bytes.into_boxed_slice().into())
    }

    /// A block, from memory or loaded. Concurrent readers of one block share one load.
    async fn block(&self, object: &dyn BlockObject, key: BlockKey) -> Result<Bytes, ReadError> {
        let entry = self.memory.entry(key).or_try_insert_with(self.load(object, key)).await;
        let entry = entry.map_err(|error: Arc<ReadError>| (*error).clone())?;
        if !entry.is_fresh() {
            (self.observer)(BlockEvent::MemoryHit);
        }
        Ok(entry.into_value())
    }

    async fn load(&self, object: &dyn BlockObject, key: BlockKey) -> Result<Bytes, ReadError> {
        if let Some(disk) = self.disk.clone()
            && let Ok(Some(block)) = spawn_blocking(move || disk.read(&key.name())).await
        {
            (self.observer)(BlockEvent::DiskHit);
            return Ok(block);
        }
        let start = key.index * self.block_bytes;
        let block = object.fetch(start..(start + self.block_bytes).min(object.length())).await?;
        (self.observer)(BlockEvent::Fetched);
        if let Some(disk) = self.disk.clone() {
            let (observer, block) = (self.observer.clone(), block.clone());
            spawn_blocking(move || {
                if let Err(error) = disk.write(&key.name(), &block) {
                    observer(BlockEvent::DiskError(error));
                }
            });
        }
        Ok(block)
    }

    async fn invalidate(&self, object: &dyn BlockObject, range: Range<u64>) {
        for key in self.keys(object, &range) {
            self.memory.invalidate(&key).await;
            if let Some(disk) = self.disk.clone() {
                // The task only fails if it is cancelled at the end of the process.
                let _ = spawn_blocking(move || disk.remove(&key.name())).await;
            }
        }
    }
}

impl Debug for BlockCache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("BlockCache").field("disk", &self.disk).finish_non_exhaustive()
    }
}

#[derive(Debug)]
struct BlockSource {
    cache: Arc<BlockCache>,
    object: Arc<dyn BlockObject>,
}

impl RangeSource for BlockSource {
    fn length(&self) -> Option<u64> {
        Some(self.object.length())
    }

    fn read(&self, range: Range<u64>) -> RangeRead {
        let range = range.start..range.end.min(self.object.length());
        if range.start > range.end {
            return RangeRead::Ready(Err(ReadError::Failed("the range lies outside the object".into())));
        }
        let (cache, object) = (self.cache.clone(), self.object.clone());
        RangeRead::Pending(Box::pin(async move { cache.read(&*object, range).await }))
    }

    fn invalidate(&self, range: Range<u64>) -> BoxFuture<'_, ()> {
        Box::pin(self.cache.invalidate(&*self.object, range))
    }
}

#[cfg(test)]
mod tests;
