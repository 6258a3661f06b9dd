//! The search of a city without a server: its index is read in one piece at the first search.

use super::{BoxFuture, PendingGroup, PendingTile, Shareable, TileSource, archive::ArchivedCity};
use crate::{scene::TileKey, source::FetchError};
use bytes::Bytes;
use futures_util::lock::Mutex;
use insula_archive::city::SEARCH_FILE;
use insula_objects::search::{SearchHit, SearchIndex};
use insula_protocol::{TileGroup, manifest::CityMarks};
use std::sync::Arc;

/// Future of a city's index; `None` if it has none.
pub type PendingIndex = BoxFuture<'static, Result<Option<SearchIndex<Bytes>>, FetchError>>;

/// A city without a server, and what reads its index.
pub struct SearchableCity<R> {
    inner: ArchivedCity,
    read_index: R,
    /// `None` before the first search, `Some(None)` if the city has no index. Searches wait for the first one.
    index: Mutex<Option<Option<Arc<SearchIndex<Bytes>>>>>,
}

impl<R: Fn() -> PendingIndex> SearchableCity<R> {
    /// `read_index` is called at the first search, and again after it failed.
    pub fn new(inner: ArchivedCity, read_index: R) -> Self {
        Self { inner, read_index, index: Mutex::new(None) }
    }

    async fn index(&self) -> Result<Option<Arc<SearchIndex<Bytes>>>, FetchError> {
        let mut known = self.index.lock().await;
        if let Some(index) = &*known {
            return Ok(index.clone());
        }
        let index = (self.read_index)().await?.map(Arc::new);
        *known = Some(index.clone());
        Ok(index)
    }
}

/// Checks the bytes of an index of a city whose manifest has these marks. Fails if they are none, or of another bake.
pub fn open_index(bytes: Bytes, marks: Option<CityMarks>) -> Result<SearchIndex<Bytes>, FetchError> {
    SearchIndex::of_city(bytes, marks).map_err(|error| FetchError::Archive(format!("{SEARCH_FILE}: {error}")))
}

impl<R: Fn() -> PendingIndex + Shareable> TileSource for SearchableCity<R> {
    fn tile(&self, key: TileKey) -> PendingTile<'_> {
        self.inner.tile(key)
    }

    fn group<'a>(&'a self, group: TileGroup, keys: &'a [TileKey]) -> PendingGroup<'a> {
        self.inner.group(group, keys)
    }

    fn has_groups(&self) -> bool {
        self.inner.has_groups()
    }

    fn search<'a>(&'a self, query: &'a str, limit: usize) -> BoxFuture<'a, Result<Option<Vec<SearchHit>>, FetchError>> {
        Box::pin(async move { Ok(self.index().await?.map(|index| index.search(query, limit))) })
    }

    fn location(&self) -> &str {
        self.inner.location()
    }
}
