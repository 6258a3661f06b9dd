//! A city's archives in a folder or on a plain host. Its index of texts is read in one piece at the first search.

use super::{BoxFuture, ObjectSource, PendingGroup, PendingTile, Shareable, TileSource};
use crate::scene::TileKey;
use crate::source::FetchError;
use bytes::Bytes;
use futures_util::lock::Mutex;
use insula_archive::city::SEARCH_FILE;
use insula_archive::{ArchiveError, LazyCity, ReadError, SharedSource};
use insula_objects::search::{SearchHit, SearchIndex};
use insula_protocol::manifest::CityMarks;
use insula_protocol::{Manifest, TileGroup, TileId, TileKind, mesh_tile};
use std::sync::Arc;

/// Future of a city's index; `None` if it has none.
pub type PendingIndex = BoxFuture<'static, Result<Option<SearchIndex<Bytes>>, FetchError>>;

/// A city without a server, and what reads its index.
pub struct ArchivedCity<R> {
    location: String,
    city: LazyCity,
    read_index: R,
    /// `None` before the first search, `Some(None)` if the city has no index. Searches wait for the first one.
    index: Mutex<Option<Option<Arc<SearchIndex<Bytes>>>>>,
}

impl<R: Fn() -> PendingIndex> ArchivedCity<R> {
    /// The city of a manifest. `open` returns the source of each archive; `location` is for people. `read_index` is called at the first
    /// search, and again after it failed.
    pub fn new(location: String, manifest: &Manifest, open: impl Fn(TileKind) -> SharedSource, read_index: R) -> Self {
        Self { location, city: LazyCity::new(manifest, open), read_index, index: Mutex::new(None) }
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

/// A tile's id in its archive. Fails if a mesh cannot exist.
fn archive_id(key: TileKey) -> Result<TileId, FetchError> {
    match key.kind() {
        TileKind::Mesh => mesh_tile::archive_id(key.id, key.lod).ok_or(FetchError::Missing),
        TileKind::BlockMap | TileKind::Subtree | TileKind::Objects | TileKind::Visibility => Ok(key.id),
    }
}

impl<R: Fn() -> PendingIndex + Shareable> TileSource for ArchivedCity<R> {
    fn tile(&self, key: TileKey) -> PendingTile<'_> {
        Box::pin(async move {
            let id = archive_id(key)?;
            self.city.archive(key.kind()).tile(id).await.map_err(from_archive)?.ok_or(FetchError::Missing)
        })
    }

    fn group<'a>(&'a self, group: TileGroup, keys: &'a [TileKey]) -> PendingGroup<'a> {
        Box::pin(async move {
            let ids = keys.iter().map(|key| archive_id(*key)).collect::<Result<Vec<_>, _>>()?;
            self.city.archive(group.kind()).tiles(&ids).await.map_err(from_archive)
        })
    }

    fn has_groups(&self) -> bool {
        true
    }

    fn location(&self) -> &str {
        &self.location
    }
}

impl<R: Fn() -> PendingIndex + Shareable> ObjectSource for ArchivedCity<R> {
    fn search<'a>(&'a self, query: &'a str, limit: usize) -> BoxFuture<'a, Result<Option<Vec<SearchHit>>, FetchError>> {
        Box::pin(async move { Ok(self.index().await?.map(|index| index.search(query, limit))) })
    }
}

fn from_archive(error: ArchiveError) -> FetchError {
    match error {
        ArchiveError::Read(ReadError::Missing) => FetchError::Missing,
        ArchiveError::Read(ReadError::Busy { status, retry_after }) => FetchError::Busy { status, retry_after },
        ArchiveError::Read(ReadError::Failed(reason)) => FetchError::Network(reason),
        ArchiveError::Read(ReadError::Damaged(_)) => FetchError::Broken,
        ArchiveError::Read(ReadError::Replaced) | ArchiveError::OtherVersion => FetchError::replaced(),
        ArchiveError::Read(ReadError::Unusable(reason)) => FetchError::Unusable(reason),
        damaged => FetchError::Archive(damaged.to_string()),
    }
}

/// What an error of the network means to an archive.
pub fn to_read_error(error: FetchError) -> ReadError {
    match error {
        FetchError::Missing => ReadError::Missing,
        FetchError::Busy { status, retry_after } => ReadError::Busy { status, retry_after },
        FetchError::Unusable(reason) => ReadError::Unusable(reason),
        FetchError::Broken | FetchError::Damaged(_) => ReadError::Damaged(error.to_string()),
        FetchError::Network(reason) | FetchError::Archive(reason) => ReadError::Failed(reason),
    }
}
