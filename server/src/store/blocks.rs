//! Blocks of remote archives in memory and on disk; each is fetched once, however many want it.
//!
//! In: an object and a range of its bytes. Out: those bytes. Next: `remote` makes a [`Source`](super::Source) of it.

use super::{
    ReadError,
    disk::{BlockKey, Disk},
};
use crate::config::BlockCacheConfig;
use bytes::{Bytes, BytesMut};
use moka::future::Cache as Memory;
use object_store::{GetOptions, GetRange, ObjectStore, path::Path};
use prometheus_client::{
    metrics::{counter::Counter, family::Family, histogram::Histogram},
    registry::Registry,
};
use std::{io, ops::Range, sync::Arc, time::Duration};
use tokio::{
    sync::Semaphore,
    time::{Instant, sleep, timeout},
};

const FIRST_WAIT: Duration = Duration::from_millis(20);
const LONGEST_WAIT: Duration = Duration::from_secs(1);
const BUCKETS_SECS: [f64; 10] = [1e-3, 2.5e-3, 5e-3, 1e-2, 2.5e-2, 5e-2, 0.1, 0.5, 2.5, 10.0];

/// An archive in a store, as it was when the city was opened.
#[derive(Debug)]
pub(super) struct Object {
    pub(super) store: Arc<dyn ObjectStore>,
    pub(super) path: Path,
    pub(super) tag: Option<String>,
    pub(super) file_bytes: u64,
    /// Of its address, tag and length.
    pub(super) hash: u128,
}

/// What is counted of stores and caches.
#[derive(Debug, Clone)]
pub(crate) struct StoreMetrics {
    reads: Family<[(&'static str, &'static str); 1], Counter>,
    fetches: Family<[(&'static str, &'static str); 1], Counter>,
    seconds: Histogram,
    disk_errors: Counter,
}

impl StoreMetrics {
    pub(crate) fn register(&self, to: &mut Registry) {
        to.register("block_reads", "Reads of blocks of remote archives by where they were found", self.reads.clone());
        to.register("store_fetches", "Requests to stores by outcome", self.fetches.clone());
        to.register("store_fetch_seconds", "Time of a request to a store", self.seconds.clone());
        let about = "Blocks that could not be kept on disk";
        to.register("disk_cache_errors", about, self.disk_errors.clone());
    }

    fn read(&self, from: &'static str) {
        self.reads.get_or_create(&[("from", from)]).inc();
    }
}

/// All blocks that this process keeps.
#[derive(Debug)]
pub(crate) struct Blocks {
    memory: Memory<BlockKey, Bytes>,
    disk: Option<Arc<Disk>>,
    block_bytes: u64,
    fetches: Semaphore,
    patience: Duration,
    pub(crate) counters: StoreMetrics,
}

impl Blocks {
    /// Errors: the cache's folder cannot be used.
    pub(crate) fn new(config: &BlockCacheConfig) -> io::Result<Self> {
        let weight = |_: &BlockKey, block: &Bytes| u32::try_from(block.len() + 128).unwrap_or(u32::MAX);
        let disk = config.folder.as_ref().map(|folder| Disk::open(folder, config.folder_bytes)).transpose()?;
        Ok(Self {
            memory: Memory::builder().max_capacity(config.memory_bytes).weigher(weight).build(),
            disk: disk.map(Arc::new),
            block_bytes: config.block_bytes,
            fetches: Semaphore::new(config.fetches),
            patience: Duration::from_secs(config.timeout_secs),
            counters: StoreMetrics {
                reads: Family::default(),
                fetches: Family::default(),
                seconds: Histogram::new(BUCKETS_SECS),
                disk_errors: Counter::default(),
            },
        })
    }

    fn keys(&self, object: &Object, range: &Range<u64>) -> impl Iterator<Item = BlockKey> + use<> {
        let hash = object.hash;
        let numbers = range.start / self.block_bytes..range.end.div_ceil(self.block_bytes);
        numbers.map(move |index| BlockKey { object: hash, index })
    }

    /// The bytes of a range that lies inside the object.
    pub(super) async fn read(&self, object: &Object, range: Range<u64>) -> Result<Bytes, ReadError> {
        let mut out = BytesMut::new();
        for key in self.keys(object, &range) {
            let block = self.block(object, key).await?;
            let start = key.index * self.block_bytes;
            let part = range.start.max(start) - start..range.end.min(start + block.len() as u64) - start;
            let part = block.slice(part.start as usize..part.end as usize);
            if part.len() as u64 == range.end - range.start {
                return Ok(part);
            }
            out.extend_from_slice(&part);
        }
        Ok(out.freeze())
    }

    /// Whoever comes while a block is on its way waits for it.
    async fn block(&self, object: &Object, key: BlockKey) -> Result<Bytes, ReadError> {
        let entry = self.memory.entry(key).or_try_insert_with(self.load(object, key)).await;
        let entry = entry.map_err(|error: Arc<ReadError>| (*error).clone())?;
        if !entry.is_fresh() {
            self.counters.read("memory");
        }
        Ok(entry.into_value())
    }

    async fn load(&self, object: &Object, key: BlockKey) -> Result<Bytes, ReadError> {
        if let Some(disk) = self.disk.clone() {
            let found = tokio::task::spawn_blocking(move || disk.get(key)).await;
            if let Ok(Some(block)) = found {
                self.counters.read("disk");
                return Ok(block);
            }
        }
        let block = self.fetch(object, key.index).await?;
        self.counters.read("store");
        if let Some(disk) = self.disk.clone() {
            let (errors, block) = (self.counters.disk_errors.clone(), block.clone());
            tokio::task::spawn_blocking(move || {
                if let Err(error) = disk.put(key, &block) {
                    errors.inc();
                    tracing::debug!(%error, "a block cannot be kept on disk");
                }
            });
        }
        Ok(block)
    }

    /// Asks until the store answers or patience is over, waiting longer each time.
    async fn fetch(&self, object: &Object, index: u64) -> Result<Bytes, ReadError> {
        let gone = |_| ReadError::Failed("the server ends".into());
        let end = Instant::now() + self.patience;
        let mut wait = FIRST_WAIT;
        loop {
            let permit = timeout(self.patience, self.fetches.acquire()).await;
            let _permit = permit.map_err(|_| ReadError::Failed("the store is busy".into()))?.map_err(gone)?;
            let start = Instant::now();
            let got = timeout(self.patience / 3, self.get(object, index)).await;
            let got = got.unwrap_or_else(|_| Err(ReadError::Failed("the store does not answer".into())));
            self.counters.seconds.observe(start.elapsed().as_secs_f64());
            let outcome = if got.is_ok() { "ok" } else { "failed" };
            self.counters.fetches.get_or_create(&[("outcome", outcome)]).inc();
            match got {
                Err(ReadError::Failed(reason)) if Instant::now() + wait < end => {
                    tracing::debug!(object = %object.path, reason, "the store failed: asking again");
                }
                done => return done,
            }
            drop(_permit);
            sleep(wait).await;
            wait = (wait * 2).min(LONGEST_WAIT);
        }
    }

    async fn get(&self, object: &Object, index: u64) -> Result<Bytes, ReadError> {
        let failed = |error: object_store::Error| match error {
            object_store::Error::NotFound { .. } | object_store::Error::Precondition { .. } => ReadError::Replaced,
            error => ReadError::Failed(error.to_string()),
        };
        let start = index * self.block_bytes;
        let range = start..(start + self.block_bytes).min(object.file_bytes);
        let wanted = range.end - range.start;
        let options = GetOptions { range: Some(GetRange::Bounded(range)), ..GetOptions::default() };
        let got = object.store.get_opts(&object.path, options).await.map_err(failed)?;
        // The store says of what these bytes are: what was replaced is never mixed with what was there.
        if got.meta.e_tag != object.tag || got.meta.size != object.file_bytes {
            return Err(ReadError::Replaced);
        }
        let bytes = got.bytes().await.map_err(failed)?;
        if bytes.len() as u64 == wanted { Ok(bytes) } else { Err(ReadError::Failed("half an answer".into())) }
    }

    /// These blocks hold what fails its checksum.
    pub(super) async fn forget(&self, object: &Object, range: Range<u64>) {
        for key in self.keys(object, &range) {
            self.memory.invalidate(&key).await;
            if let Some(disk) = self.disk.clone() {
                // An error is a task that was cancelled at the end of the process.
                let _ = tokio::task::spawn_blocking(move || disk.remove(key)).await;
            }
        }
    }

    /// What is asked of a store besides blocks, with the same patience.
    pub(super) async fn patiently<T, F>(&self, mut ask: impl FnMut() -> F) -> Result<T, object_store::Error>
    where
        F: Future<Output = Result<T, object_store::Error>>,
    {
        let end = Instant::now() + self.patience;
        let mut wait = FIRST_WAIT;
        loop {
            match ask().await {
                Err(error) if !is_final(&error) && Instant::now() + wait < end => {}
                done => return done,
            }
            sleep(wait).await;
            wait = (wait * 2).min(LONGEST_WAIT);
        }
    }
}

/// Asking again will not help.
fn is_final(error: &object_store::Error) -> bool {
    use object_store::Error;
    matches!(
        error,
        Error::NotFound { .. }
            | Error::InvalidPath { .. }
            | Error::NotSupported { .. }
            | Error::NotModified { .. }
            | Error::PermissionDenied { .. }
            | Error::Unauthenticated { .. }
    )
}
