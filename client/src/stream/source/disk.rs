//! Fetched tiles kept on disk for the next time: `--disk-cache-mib`.
//!
//! Only tiles that decode are kept, under the city's name and version. Whatever fails here costs a fetch and no pixel.

use super::{PendingTile, TileSource};
use crate::error::{ClientError, Result};
use bytes::Bytes;
use insula_archive::disk_cache::DiskCache;
use insula_protocol::{Manifest, TileKind};
use insula_viewer::scene::TileKey;
use std::sync::Arc;

/// File extension of what is kept.
pub const EXTENSION: &str = "tile";

/// The disk cache of this program's user.
pub fn open_user_cache(max_bytes: u64) -> Result<DiskCache> {
    let folders = directories::ProjectDirs::from("", "", "insula")
        .ok_or_else(|| ClientError::Failed("there is no home folder to keep tiles in: set HOME".into()))?;
    let path = folders.cache_dir().join("tiles");
    DiskCache::open(&path, EXTENSION, max_bytes).map_err(ClientError::file(&path))
}

/// A city whose tiles are read from a disk cache first.
pub struct CachedCity {
    inner: Arc<dyn TileSource>,
    cache: Arc<DiskCache>,
    prefix: String,
}

impl CachedCity {
    /// Tiles of the city of `manifest`, from `cache` or else from `inner`.
    pub fn new(inner: Arc<dyn TileSource>, cache: Arc<DiskCache>, manifest: &Manifest) -> Self {
        Self { inner, cache, prefix: format!("{}-{}", manifest.name, manifest.version) }
    }

    fn cache_key(&self, key: TileKey) -> String {
        let id = key.id;
        let tile = format!("{}-{}-{}-{}-{}", self.prefix, key.kind().path_segment(), id.level(), id.x(), id.y());
        if key.kind() == TileKind::Mesh { format!("{tile}-{}", key.lod) } else { tile }
    }
}

impl TileSource for CachedCity {
    fn tile(&self, key: TileKey) -> PendingTile<'_> {
        let (cache, cache_key) = (self.cache.clone(), self.cache_key(key));
        Box::pin(async move {
            // A cancelled read is a miss.
            let cached = tokio::task::spawn_blocking(move || cache.read(&cache_key)).await;
            match cached.ok().flatten() {
                Some(bytes) => Ok(bytes),
                None => self.inner.tile(key).await,
            }
        })
    }

    fn is_local(&self, key: TileKey) -> bool {
        self.cache.contains(&self.cache_key(key))
    }

    fn keep(&self, key: TileKey, bytes: &Bytes) {
        if let Err(error) = self.cache.write(&self.cache_key(key), bytes) {
            tracing::debug!("a tile cannot be written to the disk cache: {error}");
        }
    }

    fn forget(&self, key: TileKey) {
        self.cache.remove(&self.cache_key(key));
    }

    fn location(&self) -> &str {
        self.inner.location()
    }
}
