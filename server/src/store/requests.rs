//! Requests to object stores: bounded, repeated while they fail, counted.

use crate::config::BlockCacheConfig;
use bytes::{Bytes, BytesMut};
use futures_util::TryStreamExt;
use insula_archive::ReadError;
use insula_archive::block_cache::{BlockCache, BlockCacheOptions, BlockEvent, BlockObject};
use insula_archive::source::BoxFuture;
use object_store::path::Path;
use object_store::{GetOptions, GetRange, GetResult, ObjectStore};
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::Registry;
use std::io;
use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Semaphore;
use tokio::time::{Instant, sleep, timeout};

const FIRST_WAIT: Duration = Duration::from_millis(20);
const LONGEST_WAIT: Duration = Duration::from_secs(1);
const BUCKETS_SECS: [f64; 10] = [1e-3, 2.5e-3, 5e-3, 1e-2, 2.5e-2, 5e-2, 0.1, 0.5, 2.5, 10.0];

/// Counters of object stores and of the block cache.
#[derive(Debug, Clone)]
pub(crate) struct StoreMetrics {
    reads: Family<[(&'static str, &'static str); 1], Counter>,
    fetches: Family<[(&'static str, &'static str); 1], Counter>,
    seconds: Histogram,
    disk_errors: Counter,
}

impl StoreMetrics {
    pub(super) fn new() -> Self {
        Self {
            reads: Family::default(),
            fetches: Family::default(),
            seconds: Histogram::new(BUCKETS_SECS),
            disk_errors: Counter::default(),
        }
    }

    pub(crate) fn register(&self, to: &mut Registry) {
        to.register("block_reads", "Reads of blocks of remote archives by where they were found", self.reads.clone());
        to.register("store_fetches", "Requests to stores by outcome", self.fetches.clone());
        to.register("store_fetch_seconds", "Time of a request to a store", self.seconds.clone());
        let about = "Blocks that could not be kept on disk";
        to.register("disk_cache_errors", about, self.disk_errors.clone());
    }

    /// Opens a block cache that counts here. Fails if its folder cannot be used.
    pub(super) fn block_cache(&self, config: &BlockCacheConfig) -> io::Result<BlockCache> {
        let options = BlockCacheOptions {
            block_bytes: config.block_bytes,
            memory_bytes: config.memory_bytes,
            folder: config.folder.clone(),
            folder_bytes: config.folder_bytes,
        };
        let metrics = self.clone();
        BlockCache::new(&options, move |event| metrics.observe(event))
    }

    fn observe(&self, event: BlockEvent) {
        let from = match event {
            BlockEvent::MemoryHit => "memory",
            BlockEvent::DiskHit => "disk",
            BlockEvent::Fetched => "store",
            BlockEvent::DiskError(error) => {
                self.disk_errors.inc();
                tracing::debug!(%error, "a block cannot be written to the disk cache");
                return;
            }
        };
        self.reads.get_or_create(&[("from", from)]).inc();
    }
}

/// The limits of this process for requests to all stores.
#[derive(Debug)]
pub(super) struct StoreRequests {
    permits: Semaphore,
    pub(super) timeout: Duration,
    metrics: StoreMetrics,
}

impl StoreRequests {
    pub(super) fn new(config: &BlockCacheConfig, metrics: StoreMetrics) -> Self {
        let timeout = Duration::from_secs(config.timeout_secs);
        Self { permits: Semaphore::new(config.fetches), timeout, metrics }
    }

    /// Repeats `request` until it succeeds, fails for good, or the timeout has passed. Waits longer each time.
    pub(super) async fn retry<T, F>(&self, mut request: impl FnMut() -> F) -> Result<T, object_store::Error>
    where
        F: Future<Output = Result<T, object_store::Error>>,
    {
        let end = Instant::now() + self.timeout;
        let mut wait = FIRST_WAIT;
        loop {
            match request().await {
                Err(error) if !is_final(&error) && Instant::now() + wait < end => {}
                done => return done,
            }
            sleep(wait).await;
            wait = (wait * 2).min(LONGEST_WAIT);
        }
    }

    /// Fetches a range, repeated like [`Self::retry`].
    async fn fetch(&self, object: &RemoteObject, range: Range<u64>) -> Result<Bytes, ReadError> {
        let closed = |_| ReadError::Failed("the server is shutting down".into());
        let end = Instant::now() + self.timeout;
        let mut wait = FIRST_WAIT;
        loop {
            let permit = timeout(self.timeout, self.permits.acquire()).await;
            let permit = permit.map_err(|_| ReadError::Failed("the store is busy".into()))?.map_err(closed)?;
            let start = Instant::now();
            let got = timeout(self.timeout / 3, object.get(range.clone())).await;
            let got = got.unwrap_or_else(|_| Err(ReadError::Failed("the store does not answer".into())));
            self.metrics.seconds.observe(start.elapsed().as_secs_f64());
            let outcome = if got.is_ok() { "ok" } else { "failed" };
            self.metrics.fetches.get_or_create(&[("outcome", outcome)]).inc();
            match got {
                Err(ReadError::Failed(reason)) if Instant::now() + wait < end => {
                    tracing::debug!(object = %object.path, reason, "the store failed: trying again");
                }
                done => return done,
            }
            drop(permit);
            sleep(wait).await;
            wait = (wait * 2).min(LONGEST_WAIT);
        }
    }
}

/// An archive in a store, in the version that it had when the city was opened.
#[derive(Debug)]
pub(super) struct RemoteObject {
    pub(super) requests: Arc<StoreRequests>,
    pub(super) store: Arc<dyn ObjectStore>,
    pub(super) path: Path,
    pub(super) tag: Option<String>,
    pub(super) length: u64,
    /// Hash of address, tag and length.
    pub(super) id: u128,
}

impl RemoteObject {
    async fn get(&self, range: Range<u64>) -> Result<Bytes, ReadError> {
        let failed = |error: object_store::Error| match error {
            object_store::Error::NotFound { .. } | object_store::Error::Precondition { .. } => ReadError::Replaced,
            error => ReadError::Failed(error.to_string()),
        };
        let wanted = range.end - range.start;
        let options = GetOptions { range: Some(GetRange::Bounded(range)), ..GetOptions::default() };
        let got = self.store.get_opts(&self.path, options).await.map_err(failed)?;
        // The response names the version of its bytes, so that two versions are never mixed.
        if got.meta.e_tag != self.tag || got.meta.size != self.length {
            return Err(ReadError::Replaced);
        }
        let bytes = read_body(got, wanted as usize).await.map_err(failed)?;
        if bytes.len() as u64 == wanted { Ok(bytes) } else { Err(ReadError::Failed("an incomplete response".into())) }
    }
}

impl BlockObject for RemoteObject {
    fn id(&self) -> u128 {
        self.id
    }

    fn length(&self) -> u64 {
        self.length
    }

    fn fetch(&self, range: Range<u64>) -> BoxFuture<'_, Result<Bytes, ReadError>> {
        Box::pin(self.requests.fetch(self, range))
    }
}

/// Reads a response's body. Fails if it is longer than `max_bytes`, whatever the response's headers say.
pub(super) async fn read_body(got: GetResult, max_bytes: usize) -> Result<Bytes, object_store::Error> {
    let mut stream = got.into_stream();
    let mut body = BytesMut::new();
    while let Some(part) = stream.try_next().await? {
        if body.len() + part.len() > max_bytes {
            let source = format!("the response is longer than {max_bytes} bytes").into();
            return Err(object_store::Error::Generic { store: "body", source });
        }
        body.extend_from_slice(&part);
    }
    Ok(body.freeze())
}

/// Whether a retry cannot help.
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
