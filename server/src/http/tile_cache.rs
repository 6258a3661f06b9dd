//! Tiles that were asked for lately, ready to be sent; each thread has its own.
//!
//! In: a tile that was read and checked. Out: the same, without reading or checking it again. Next: `tile`.

use super::representation::Representation;
use axum::http::HeaderMap;
use insula_protocol::{TileId, route::Layer};
use lru::LruCache;
use std::{
    hash::{BuildHasherDefault, Hasher},
    sync::{Arc, Mutex, PoisonError},
};

/// What an entry takes besides its bytes, about.
const ENTRY_BYTES: usize = 1024;

/// Of one opened city: another version has another serial. Meshes are named by their place in the archive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct TileCacheKey {
    pub(super) serial: u64,
    pub(super) layer: Layer,
    pub(super) id: TileId,
}

/// A checked tile with the headers of its whole answer.
#[derive(Debug)]
pub(super) struct CachedTile {
    pub(super) representation: Representation,
    pub(super) headers: HeaderMap,
}

/// The least recently used tile goes first when there are too many bytes.
#[derive(Debug)]
pub(super) struct TileCache {
    max_bytes: usize,
    kept: Mutex<TileCacheEntries>,
}

#[derive(Debug)]
struct TileCacheEntries {
    tiles: LruCache<TileCacheKey, Arc<CachedTile>, BuildHasherDefault<KeyHasher>>,
    bytes: usize,
}

impl TileCache {
    pub(super) fn new(max_bytes: usize) -> Self {
        let tiles = LruCache::unbounded_with_hasher(BuildHasherDefault::default());
        Self { max_bytes, kept: Mutex::new(TileCacheEntries { tiles, bytes: 0 }) }
    }

    pub(super) fn get(&self, key: &TileCacheKey) -> Option<Arc<CachedTile>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner).tiles.get(key).cloned()
    }

    pub(super) fn insert(&self, key: TileCacheKey, tile: Arc<CachedTile>) {
        let size = |tile: &CachedTile| tile.representation.body.len() + ENTRY_BYTES;
        if size(&tile) > self.max_bytes {
            return;
        }
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.bytes += size(&tile);
        if let Some(before) = kept.tiles.put(key, tile) {
            kept.bytes -= size(&before);
        }
        while kept.bytes > self.max_bytes
            && let Some((_, last)) = kept.tiles.pop_lru()
        {
            kept.bytes -= size(&last);
        }
    }
}

/// Keys are the server's own, of tiles that exist: nobody can choose them to collide, so that a quick mixer will do.
#[derive(Debug, Default)]
struct KeyHasher(u64);

impl Hasher for KeyHasher {
    fn finish(&self) -> u64 {
        self.0 ^ self.0 >> 29
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.write_u64(u64::from(*byte)));
    }

    fn write_u8(&mut self, value: u8) {
        self.write_u64(u64::from(value));
    }

    fn write_u32(&mut self, value: u32) {
        self.write_u64(u64::from(value));
    }

    fn write_u64(&mut self, value: u64) {
        self.0 = (self.0.rotate_left(5) ^ value).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }

    fn write_usize(&mut self, value: usize) {
        self.write_u64(value as u64);
    }

    fn write_isize(&mut self, value: isize) {
        self.write_u64(value as u64);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::http::representation::{IMMUTABLE, quoted};
    use axum::http::HeaderValue;

    #[test]
    fn it_never_holds_more_than_it_may_and_keeps_what_is_used() {
        let tile = |bytes: usize| {
            let representation = Representation {
                body: vec![0; bytes].into(),
                content_type: HeaderValue::from_static("x/y"),
                etag: quoted("tag"),
                cache_control: IMMUTABLE,
                encoding: None,
                vary: None,
            };
            Arc::new(CachedTile { representation, headers: HeaderMap::new() })
        };
        let key = |x| TileCacheKey { serial: 1, layer: Layer::BlockMaps, id: TileId::new(9, x, 0).unwrap() };
        let cache = TileCache::new(10 * (100 + ENTRY_BYTES));
        for x in 0..100 {
            cache.insert(key(x), tile(100));
            assert!(cache.get(&key(0)).is_some(), "it was asked for a moment ago");
            let kept = cache.kept.lock().unwrap();
            assert_eq!(kept.bytes, kept.tiles.len() * (100 + ENTRY_BYTES));
            assert!(kept.bytes <= cache.max_bytes);
        }
        assert!(cache.get(&key(99)).is_some() && cache.get(&key(50)).is_none());
        cache.insert(key(99), tile(50));
        assert_eq!(cache.kept.lock().unwrap().bytes, 10 * (100 + ENTRY_BYTES) - 50, "replaced, not counted twice");
        cache.insert(key(7), tile(1 << 20));
        assert!(cache.get(&key(7)).is_none() && cache.get(&key(99)).is_some(), "what is too large empties nothing");
    }
}
