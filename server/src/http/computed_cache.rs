//! What was made for requests and may be asked for again: opened search indexes, objects that pass filters, files of tilesets, and parts
//! of cities that are sorted for drawings.
//!
//! All share one limit, beyond which what was used longest ago goes.

use super::fair_queue::{FairQueue, Shed, StopFlag};
use super::representation::{Representation, etag_of};
use crate::store::CityIndex;
use axum::http::HeaderValue;
use bytes::Bytes;
#[cfg(feature = "bake")]
use insula_draw::DrawnPart;
#[cfg(feature = "bake")]
use insula_protocol::{TileId, route::TilesetFileKind};
use moka::future::Cache;
use std::net::IpAddr;
#[cfg(feature = "bake")]
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::Handle;

/// What nobody asks for goes after this time, also with its city.
const MAX_IDLE: Duration = Duration::from_secs(600);
/// Estimated memory of an entry besides its content.
const ENTRY_BYTES: usize = 256;

/// By [`CityStore::serial`](crate::store::CityStore::serial), so that versions are told apart.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) enum ComputedKey {
    Index(u64),
    /// The result of a filter.
    Filtered(u64, Box<str>),
    #[cfg(feature = "bake")]
    File(u64, TilesetFile),
    /// A part of a city for drawings, by the name that their options have for it.
    #[cfg(feature = "bake")]
    Part(u64, Box<str>),
    /// What the proposals of a city change.
    #[cfg(feature = "bake")]
    Proposals(u64),
}

#[derive(Debug, Clone)]
enum Computed {
    Index(CityIndex),
    Bytes(ComputedBytes),
    #[cfg(feature = "bake")]
    Part(Arc<DrawnPart>),
}

/// The content of a response. Its ETag is a part of the work, which takes milliseconds for megabytes.
#[derive(Debug, Clone)]
pub(super) struct ComputedBytes {
    pub(super) body: Bytes,
    pub(super) etag: HeaderValue,
}

impl ComputedBytes {
    pub(super) fn new(body: impl Into<Bytes>) -> Self {
        let body = body.into();
        Self { etag: etag_of(&body), body }
    }

    /// The content of a response that never changes under its URL.
    pub(super) fn immutable(self, content_type: &'static str, is_public: bool) -> Representation {
        Representation::immutable(self.body, self.etag, content_type, is_public)
    }
}

/// A file of a tileset.
#[cfg(feature = "bake")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum TilesetFile {
    Root,
    Node(TilesetFileKind, TileId),
}

/// See the module. Cheap to clone.
#[derive(Debug, Clone)]
pub(super) struct ComputedCache(Cache<ComputedKey, Computed>);

impl ComputedCache {
    /// A cache of at most `max_bytes`.
    pub(super) fn new(max_bytes: usize) -> Self {
        let weigh = |key: &ComputedKey, value: &Computed| {
            let name = match key {
                ComputedKey::Filtered(_, text) => text.len(),
                #[cfg(feature = "bake")]
                ComputedKey::Part(_, text) => text.len(),
                _ => 0,
            };
            let bytes = match value {
                Computed::Index(index) => index.byte_len(),
                Computed::Bytes(made) => made.body.len(),
                #[cfg(feature = "bake")]
                Computed::Part(part) => part.byte_len(),
            };
            u32::try_from(name + bytes + ENTRY_BYTES).unwrap_or(u32::MAX)
        };
        Self(Cache::builder().max_capacity(max_bytes as u64).weigher(weigh).time_to_idle(MAX_IDLE).build())
    }

    /// The index of a city, if it is in memory.
    pub(super) async fn index(&self, serial: u64) -> Option<CityIndex> {
        match self.0.get(&ComputedKey::Index(serial)).await? {
            Computed::Index(index) => Some(index),
            _ => None,
        }
    }

    pub(super) async fn keep_index(&self, serial: u64, index: CityIndex) {
        self.keep(ComputedKey::Index(serial), Computed::Index(index)).await;
    }

    /// A part of a city, if it is in memory.
    #[cfg(feature = "bake")]
    pub(super) async fn part(&self, key: &ComputedKey) -> Option<Arc<DrawnPart>> {
        match self.0.get(key).await? {
            Computed::Part(part) => Some(part),
            _ => None,
        }
    }

    /// Keeps a part. To be called again when a drawing has made it larger: the cache counts what it is now.
    #[cfg(feature = "bake")]
    pub(super) async fn keep_part(&self, key: ComputedKey, part: Arc<DrawnPart>) {
        self.keep(key, Computed::Part(part)).await;
    }

    /// Returns what is in memory. Otherwise waits for the client's turn in `queue`, looks again, and calls `make`. It does not wait for
    /// an equal request of another client, whose turn may come later or whose work may have low priority.
    pub(super) async fn find_or_make<E: Send + 'static>(
        &self,
        key: ComputedKey,
        queue: &FairQueue,
        client: IpAddr,
        make: impl FnOnce(&StopFlag) -> Result<Vec<u8>, E> + Send + 'static,
    ) -> Result<Result<ComputedBytes, E>, Shed> {
        if let Some(found) = self.bytes_of(&key).await {
            return Ok(Ok(found));
        }
        let (cache, runtime) = (self.clone(), Handle::current());
        let work = move |stop: &StopFlag| {
            if let Some(found) = runtime.block_on(cache.bytes_of(&key)) {
                return Ok(found);
            }
            // Without spare capacity, which the cache would not count.
            let made = ComputedBytes::new(make(stop)?.into_boxed_slice());
            runtime.block_on(cache.keep(key, Computed::Bytes(made.clone())));
            Ok(made)
        };
        queue.run(client, work).await
    }

    async fn bytes_of(&self, key: &ComputedKey) -> Option<ComputedBytes> {
        match self.0.get(key).await? {
            Computed::Bytes(made) => Some(made),
            _ => None,
        }
    }

    async fn keep(&self, key: ComputedKey, computed: Computed) {
        self.0.insert(key, computed).await;
        self.evict().await;
    }

    /// Removes at once what is beyond the limit: the cache itself waits for some hundred changes or milliseconds, in which requests can
    /// make many times as much.
    async fn evict(&self) {
        self.0.run_pending_tasks().await;
    }

    pub(super) async fn bytes(&self) -> u64 {
        self.evict().await;
        self.0.weighted_size()
    }
}

#[cfg(test)]
mod tests {
    use super::super::fair_queue::QueueLimits;
    use super::*;
    use insula_objects::search::{SearchIndex, SearchIndexBuilder};
    use std::sync::Arc;
    use std::sync::atomic::AtomicUsize;
    use std::sync::atomic::Ordering::Relaxed;
    use tokio::sync::oneshot;

    #[tokio::test]
    async fn indexes_of_many_cities_stay_within_the_limit() {
        let index = || {
            let mut builder = SearchIndexBuilder::new();
            (0..1000).for_each(|object| builder.add(&format!("Street {object}"), object));
            Arc::new(SearchIndex::open(builder.finish().unwrap()).unwrap())
        };
        let limit = 3 * (index().byte_len() + ENTRY_BYTES);
        let cache = ComputedCache::new(limit);
        for city in 0..20 {
            cache.keep_index(city, index()).await;
            // Not only when somebody looks.
            assert!(cache.0.weighted_size() <= limit as u64, "{city}");
        }
        let kept = (0..20).map(|city| cache.index(city));
        assert_eq!(futures_util::future::join_all(kept).await.into_iter().flatten().count(), 3);
    }

    #[tokio::test]
    async fn equal_requests_of_a_client_are_made_once() {
        let limits = QueueLimits { at_once: 2, waiting: 120, at_ease: 1, max_time: Duration::from_secs(600) };
        let (queue, cache, made) = (FairQueue::new(limits), ComputedCache::new(1 << 20), Arc::new(AtomicUsize::new(0)));
        let request = |client: u8, text: &str| {
            let made = Arc::clone(&made);
            let make = move |_: &StopFlag| Ok::<_, ()>(vec![made.fetch_add(1, Relaxed) as u8]);
            cache.find_or_make(ComputedKey::Filtered(1, text.into()), &queue, [192, 0, 2, client].into(), make)
        };
        let all = futures_util::future::join_all((0..120).map(|_| request(1, "a"))).await;
        assert!(all.iter().all(|found| matches!(found, Ok(Ok(found)) if *found.body == [0])));
        assert!(matches!(request(2, "a").await, Ok(Ok(found)) if *found.body == [0]), "of another client");
        assert!(matches!(request(2, "b").await, Ok(Ok(found)) if *found.body == [1]), "another filter");
    }

    #[tokio::test]
    async fn a_request_does_not_wait_for_the_turn_of_another_client() {
        let limits = QueueLimits { at_once: 2, waiting: 120, at_ease: 1, max_time: Duration::from_secs(600) };
        let (queue, cache) = (FairQueue::new(limits), ComputedCache::new(0));
        let ask = |client: u8, text: &str, make: Box<dyn FnOnce() + Send>| {
            let (cache, queue, key) = (cache.clone(), queue.clone(), ComputedKey::Filtered(1, text.into()));
            tokio::spawn(async move {
                let make = move |_: &StopFlag| {
                    make();
                    Ok::<_, ()>(vec![client])
                };
                cache.find_or_make(key, &queue, [192, 0, 2, client].into(), make).await.map(|made| made.unwrap().body)
            })
        };
        let ((started, starts), (end, ends)) = (oneshot::channel(), oneshot::channel());
        let long = ask(1, "long", Box::new(move || (started.send(()).unwrap(), ends.blocking_recv().unwrap()).1));
        starts.await.unwrap();
        // It waits behind that.
        let same = ask(1, "same", Box::new(|| ()));
        while queue.waiting() == 0 {
            tokio::task::yield_now().await;
        }
        assert_eq!(ask(2, "same", Box::new(|| ())).await.unwrap().unwrap(), [2].as_slice());
        assert!(!same.is_finished());
        end.send(()).unwrap();
        long.await.unwrap().unwrap();
        assert_eq!(same.await.unwrap().unwrap(), [1].as_slice());
    }
}
