//! Where a city's tiles come from: the one trait of all places.
//!
//! In: a [`TileKey`]. Out: that tile's bytes, or a [`FetchError`]. Next: `stream` decodes them.
//!
//! An Insula server answers with tiles; a folder, or a plain host that answers ranges, holds the archives that they lie in.

pub mod archive;
pub mod disk;
pub mod folder;
pub mod server;
pub mod web;

use bytes::Bytes;
use insula_viewer::{scene::TileKey, streamer::FetchError};
use std::{future::Future, pin::Pin};

/// A tile that is on its way.
pub type Pending<'a> = Pin<Box<dyn Future<Output = Result<Bytes, FetchError>> + Send + 'a>>;

/// Somewhere that has a city.
pub trait Source: Send + Sync {
    /// A tile's bytes, at most [`insula_archive::limits::max_tile_bytes`], not decoded yet.
    fn tile(&self, key: TileKey) -> Pending<'_>;

    /// Whether a tile is at hand without a network, and so worth asking for even while the network is down.
    fn is_near(&self, _key: TileKey) -> bool {
        false
    }

    /// A tile that this place gave has proven to be whole.
    fn keep(&self, _key: TileKey, _bytes: &Bytes) {}

    /// A tile that this place gave is damaged.
    fn forget(&self, _key: TileKey) {}

    /// For people: an address, or a folder.
    fn place(&self) -> &str;
}

impl std::fmt::Debug for dyn Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.place())
    }
}
