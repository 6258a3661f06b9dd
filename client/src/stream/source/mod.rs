//! Sources of a city's tiles.
//!
//! In: a [`TileKey`]. Out: that tile's bytes, or a [`FetchError`]. Next: `background_fetcher` decodes them.
//!
//! An Insula server responds with single tiles. A folder, or a host that supports range requests, holds archives of them.

pub mod archive;
pub mod disk;
pub mod folder;
pub mod server;
pub mod web;

use bytes::Bytes;
use insula_viewer::{scene::TileKey, streamer::FetchError};
use std::{future::Future, pin::Pin};

/// Future of a tile's bytes.
pub type PendingTile<'a> = Pin<Box<dyn Future<Output = Result<Bytes, FetchError>> + Send + 'a>>;

/// A source of one city's tiles.
pub trait TileSource: Send + Sync {
    /// A tile's bytes, at most [`insula_archive::limits::max_tile_bytes`]. They have not been checked.
    fn tile(&self, key: TileKey) -> PendingTile<'_>;

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

impl std::fmt::Debug for dyn TileSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.location())
    }
}
