//! Sources of a city's tiles.
//!
//! In: a [`TileKey`]. Out: that tile's bytes, or a [`FetchError`]. Next: the shell's [`TileFetcher`](crate::streamer::TileFetcher)
//! decodes them.
//!
//! An Insula server responds with single tiles. A folder, or a host that supports range requests, holds archives of them. HTTP is
//! the shell's, behind [`Transport`].

pub mod archive;
mod fetch_error;
pub mod group_request;
pub mod server;
pub mod web_folder;

use crate::scene::TileKey;
use bytes::Bytes;
pub use fetch_error::{FetchError, REPLACED};
pub use insula_archive::source::BoxFuture;
use insula_objects::filter::FilteredObjects;
use insula_objects::search::SearchHit;
use insula_protocol::TileGroup;
use std::ops::Range;

/// What several threads share, except in WebAssembly, where values of JavaScript belong to one.
#[cfg(not(target_arch = "wasm32"))]
pub trait Shareable: Send + Sync {}
#[cfg(not(target_arch = "wasm32"))]
impl<T: Send + Sync + ?Sized> Shareable for T {}

/// What several owners share.
#[cfg(target_arch = "wasm32")]
pub trait Shareable {}
#[cfg(target_arch = "wasm32")]
impl<T: ?Sized> Shareable for T {}

/// Future of a tile's bytes.
pub type PendingTile<'a> = BoxFuture<'a, Result<Bytes, FetchError>>;

/// Future of the tiles of a group, in the order of the keys that were asked for; `None` for a tile that must be fetched by itself.
pub type PendingGroup<'a> = BoxFuture<'a, Result<Vec<Option<Bytes>>, FetchError>>;

/// What to say where [`ObjectSource::opens_objects`] is false.
pub const WITHOUT_OBJECTS: &str =
    "this link opens an area without objects: ids, filters and colours need a link for the whole city";

/// A source of one city's tiles.
pub trait TileSource: Shareable {
    /// A tile's bytes, at most [`insula_archive::limits::max_tile_bytes`]. They have not been checked.
    fn tile(&self, key: TileKey) -> PendingTile<'_>;

    /// Several tiles of a group, with one request if possible. They have not been checked.
    fn group<'a>(&'a self, _group: TileGroup, keys: &'a [TileKey]) -> PendingGroup<'a> {
        Box::pin(std::future::ready(Ok(vec![None; keys.len()])))
    }

    /// Whether one request can fetch several tiles.
    fn has_groups(&self) -> bool {
        false
    }

    /// Whether a tile can be read without the network. Such tiles are requested even while the network fails.
    fn is_local(&self, _key: TileKey) -> bool {
        false
    }

    /// Called when a tile from this source has decoded.
    fn keep(&self, _key: TileKey, _bytes: &Bytes) {}

    /// Called when a tile from this source was damaged.
    fn forget(&self, _key: TileKey) {}

    /// URL or folder of the city, for messages.
    fn location(&self) -> &str;
}

/// A source that also answers questions about the objects of its city. Apart from their tiles, because what only draws needs no code
/// for it.
pub trait ObjectSource: TileSource {
    /// The objects whose texts match `query`, the best first, at most `limit`; `None` if the city has no search.
    fn search<'a>(
        &'a self,
        _query: &'a str,
        _limit: usize,
    ) -> BoxFuture<'a, Result<Option<Vec<SearchHit>>, FetchError>> {
        Box::pin(std::future::ready(Ok(None)))
    }

    /// The objects that pass a filter; `None` if this source evaluates no filters, or not this one.
    fn filter<'a>(&'a self, _text: &'a str) -> BoxFuture<'a, Result<Option<FilteredObjects>, FetchError>> {
        Box::pin(std::future::ready(Ok(None)))
    }

    /// Whether it may have objects: a share link for an area opens none.
    fn opens_objects(&self) -> bool {
        true
    }
}

impl std::fmt::Debug for dyn TileSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.location())
    }
}

impl std::fmt::Debug for dyn ObjectSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.location())
    }
}

/// Part of a file.
#[derive(Debug)]
pub struct RangeResponse {
    pub bytes: Bytes,
    /// Version of the file (ETag or date) if the host sends one.
    pub version: Option<String>,
    /// Length of the whole file if the host sends it.
    pub file_bytes: Option<u64>,
}

/// HTTP GET.
pub trait Transport: Shareable + std::fmt::Debug {
    /// Fetches `url`. Fails if the body has more than `limit_bytes`.
    fn get(&self, url: String, limit_bytes: usize) -> BoxFuture<'_, Result<Bytes, FetchError>>;

    /// Fetches a range of bytes that is not empty. The response is shorter only where the file ends. Fails if the host does
    /// not support range requests.
    fn get_range(&self, url: String, range: Range<u64>) -> BoxFuture<'_, Result<RangeResponse, FetchError>>;
}

/// Value of a `Content-Range` header: first and last byte, and the length of the file if the host knows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ContentRange {
    pub first: u64,
    pub last: u64,
    pub file_length: Option<u64>,
}

impl ContentRange {
    /// Parses `bytes 0-99/1000` or `bytes 0-99/*`.
    pub fn parse(text: &str) -> Option<Self> {
        let (range, length) = text.trim().strip_prefix("bytes")?.trim_start().split_once('/')?;
        let (first, last) = range.split_once('-')?;
        let (first, last) = (first.trim().parse().ok()?, last.trim().parse().ok()?);
        Some(Self { first, last, file_length: length.trim().parse().ok() })
    }

    /// Whether this is the response to a request for `first..=last`: shorter only where the file ends.
    pub fn satisfies(&self, first: u64, last: u64) -> bool {
        let is_file_end = self.last < last && self.file_length == self.last.checked_add(1);
        self.first == first && self.last >= first && (self.last == last || is_file_end)
    }
}
