//! What was made for requests and may be asked for again: opened search indexes, and files of tilesets.
//!
//! Both share one limit, beyond which what was used longest ago goes.

use crate::store::CityIndex;
#[cfg(feature = "bake")]
use bytes::Bytes;
#[cfg(feature = "bake")]
use insula_protocol::{TileId, route::TilesetFileKind};
use moka::future::Cache;
use std::time::Duration;
#[cfg(feature = "bake")]
use std::{future::Future, sync::Arc};

/// What nobody asks for goes after this time, also with its city.
const MAX_IDLE: Duration = Duration::from_secs(600);
/// Estimated memory of an entry besides its content.
const ENTRY_BYTES: usize = 256;

/// By [`CityStore::serial`](crate::store::CityStore::serial), so that versions are told apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum ComputedKey {
    Index(u64),
    #[cfg(feature = "bake")]
    File(u64, TilesetFile),
}

#[derive(Debug, Clone)]
enum Computed {
    Index(CityIndex),
    #[cfg(feature = "bake")]
    File(Bytes),
}

/// A file of a tileset.
#[cfg(feature = "bake")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum TilesetFile {
    Root,
    Node(TilesetFileKind, TileId),
}

/// See the module.
#[derive(Debug)]
pub(super) struct ComputedCache(Cache<ComputedKey, Computed>);

impl ComputedCache {
    /// A cache of at most `max_bytes`.
    pub(super) fn new(max_bytes: usize) -> Self {
        let weigh = |_: &ComputedKey, value: &Computed| {
            let bytes = match value {
                Computed::Index(index) => index.byte_len(),
                #[cfg(feature = "bake")]
                Computed::File(bytes) => bytes.len(),
            };
            u32::try_from(bytes + ENTRY_BYTES).unwrap_or(u32::MAX)
        };
        Self(Cache::builder().max_capacity(max_bytes as u64).weigher(weigh).time_to_idle(MAX_IDLE).build())
    }

    /// The index of a city, if it is in memory.
    pub(super) async fn index(&self, serial: u64) -> Option<CityIndex> {
        match self.0.get(&ComputedKey::Index(serial)).await? {
            Computed::Index(index) => Some(index),
            #[cfg(feature = "bake")]
            Computed::File(_) => None,
        }
    }

    pub(super) async fn keep_index(&self, serial: u64, index: CityIndex) {
        self.0.insert(ComputedKey::Index(serial), Computed::Index(index)).await;
        self.evict().await;
    }

    /// Removes at once what is beyond the limit: the cache itself waits for some hundred changes or milliseconds, in which requests can
    /// make many times as much.
    async fn evict(&self) {
        self.0.run_pending_tasks().await;
    }

    /// A file of a city's tileset, which `make` makes unless it is in memory. Requests for the same file wait for one another.
    #[cfg(feature = "bake")]
    pub(super) async fn file<E: Send + Sync + Clone + 'static>(
        &self,
        serial: u64,
        file: TilesetFile,
        make: impl Future<Output = Result<Bytes, E>>,
    ) -> Result<Bytes, Arc<E>> {
        let mut is_made = false;
        let make = async {
            is_made = true;
            make.await.map(Computed::File)
        };
        let found = self.0.try_get_with(ComputedKey::File(serial, file), make).await?;
        if is_made {
            self.evict().await;
        }
        Ok(match found {
            Computed::File(bytes) => bytes,
            Computed::Index(_) => Bytes::new(),
        })
    }

    /// Bytes in memory.
    pub(super) async fn bytes(&self) -> u64 {
        self.evict().await;
        self.0.weighted_size()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_objects::search::{SearchIndex, SearchIndexBuilder};
    use std::sync::Arc;

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
}
