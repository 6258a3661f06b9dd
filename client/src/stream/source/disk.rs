//! Fetched tiles kept on disk for the next time: `--disk-cache-mib`.
//!
//! Only tiles that decode are kept, under the city's name, version and address: a server cannot place tiles into a city of
//! another server. Whatever fails here costs a fetch and no pixel.

use bytes::Bytes;
use insula_archive::disk_cache::DiskCache;
use insula_objects::filter::FilteredObjects;
use insula_objects::search::SearchHit;
use insula_protocol::text::printable;
use insula_protocol::{Manifest, TileGroup, TileKind};
use insula_viewer::scene::TileKey;
use insula_viewer::source::{BoxFuture, FetchError, ObjectSource, PendingGroup, PendingTile, TileSource};
use std::io;
use std::sync::{Arc, Once};

/// File extension of what is kept.
pub const EXTENSION: &str = "tile";

/// The disk cache of this program's user. `None` if it cannot be used; a warning says why, once.
pub fn open_user_cache(max_bytes: u64) -> Option<DiskCache> {
    static WARNING: Once = Once::new();
    let warn = |reason: &str| {
        WARNING.call_once(|| {
            let advice = "set XDG_CACHE_HOME to a folder that can be written";
            eprintln!("warning: tiles are not kept: {}; {advice}", printable(reason));
        });
    };
    let Some(folders) = directories::ProjectDirs::from("", "", "insula") else {
        warn("there is no home folder");
        return None;
    };
    let path = folders.cache_dir().join("tiles");
    let opened = DiskCache::open(&path, EXTENSION, max_bytes).and_then(|cache| check_writable(&cache).map(|()| cache));
    opened.inspect_err(|error| warn(&format!("{}: {error}", path.display()))).ok()
}

/// Fails if nothing can be written to the cache.
fn check_writable(cache: &DiskCache) -> io::Result<()> {
    const KEY: &str = "is-writable";
    cache.replace(KEY, b"")?;
    cache.remove(KEY);
    Ok(())
}

/// A city whose tiles are read from a disk cache first.
pub struct CachedCity {
    inner: Arc<dyn ObjectSource>,
    cache: Arc<DiskCache>,
    prefix: String,
}

impl CachedCity {
    /// Tiles of the city of `manifest` at the URL `address`, from `cache` or else from `inner`.
    pub fn new(inner: Arc<dyn ObjectSource>, cache: Arc<DiskCache>, address: &str, manifest: &Manifest) -> Self {
        let Manifest { name, version, .. } = manifest;
        Self { inner, cache, prefix: format!("{name}-{version}-{}", origin_hash(address)) }
    }

    fn cache_key(&self, key: TileKey) -> String {
        let id = key.id;
        let tile = format!("{}-{}-{}-{}-{}", self.prefix, key.kind().path_segment(), id.level(), id.x(), id.y());
        if key.kind() == TileKind::Mesh { format!("{tile}-{}", key.lod) } else { tile }
    }
}

/// 32 hexadecimal digits that differ between cities of other schemes, hosts, ports or paths.
fn origin_hash(address: &str) -> String {
    // Parsing gives the host in lower case, and leaves out the scheme's own port.
    let address = reqwest::Url::parse(address).map_or(address.to_owned(), String::from);
    blake3::hash(address.as_bytes()).to_hex()[..32].to_owned()
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

    fn group<'a>(&'a self, group: TileGroup, keys: &'a [TileKey]) -> PendingGroup<'a> {
        self.inner.group(group, keys)
    }

    fn has_groups(&self) -> bool {
        self.inner.has_groups()
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

impl ObjectSource for CachedCity {
    fn search<'a>(&'a self, query: &'a str, limit: usize) -> BoxFuture<'a, Result<Option<Vec<SearchHit>>, FetchError>> {
        self.inner.search(query, limit)
    }

    fn filter<'a>(&'a self, text: &'a str) -> BoxFuture<'a, Result<Option<FilteredObjects>, FetchError>> {
        self.inner.filter(text)
    }

    fn opens_objects(&self) -> bool {
        self.inner.opens_objects()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::TileId;
    use insula_test_support::small_city::empty_manifest;
    use insula_viewer::source::FetchError;

    struct Nowhere;

    impl TileSource for Nowhere {
        fn tile(&self, _: TileKey) -> PendingTile<'_> {
            Box::pin(async { Err(FetchError::Missing) })
        }

        fn location(&self) -> &str {
            "nowhere"
        }
    }

    impl ObjectSource for Nowhere {
        fn opens_objects(&self) -> bool {
            false
        }
    }

    #[test]
    fn cities_of_the_same_name_and_version_at_other_addresses_share_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Arc::new(DiskCache::open(folder.path(), EXTENSION, 1 << 20).unwrap());
        let city = |address: &str| CachedCity::new(Arc::new(Nowhere), cache.clone(), address, &empty_manifest(3));
        let key = TileKey::mesh(TileId::new(20, 1_000_000, 1_000_000).unwrap(), 3);
        let evil = [
            "http://h:7700/v1/cities/test", "https://h/v1/cities/test", "http://h/x/test",
            "http://h.evil/v1/cities/test",
        ];
        evil.iter().for_each(|address| city(address).keep(key, &Bytes::from_static(b"evil")));
        let real = "http://h/v1/cities/test";
        assert!(!city(real).is_local(key) && !city(real).opens_objects());
        city(real).keep(key, &Bytes::from_static(b"real"));
        assert!(city("HTTP://H:80/v1/cities/test").is_local(key), "the same address");
        assert_eq!(cache.read(&city(real).cache_key(key)).unwrap(), "real");
    }

    #[test]
    fn the_longest_names_are_valid_keys() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Arc::new(DiskCache::open(folder.path(), EXTENSION, 1 << 20).unwrap());
        let mut manifest = empty_manifest(3);
        (manifest.name, manifest.version) = ("n".repeat(64), "v".repeat(64));
        let city = CachedCity::new(Arc::new(Nowhere), cache, "http://h", &manifest);
        for key in [TileKey::mesh, |id, _| TileKey::block_map(id), |id, _| TileKey::subtree(id)]
            .map(|key| key(TileId::new(20, 1_000_000, 1_000_000).unwrap(), 3))
        {
            city.keep(key, &Bytes::from_static(b"x"));
            assert!(city.is_local(key), "{key:?}");
        }
    }
}
