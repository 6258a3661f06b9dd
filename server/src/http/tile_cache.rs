//! Recently requested tiles, checked and ready to be sent. Each thread has its own cache.

use super::representation::Representation;
use axum::http::HeaderMap;
use insula_protocol::{TileId, TileKind};
use lru::LruCache;
use prometheus_client::metrics::gauge::Gauge;
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::{Arc, Mutex, PoisonError};

/// Estimated memory of an entry besides its body.
const ENTRY_BYTES: usize = 1024;

/// A tile of one open city.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct TileCacheKey {
    /// Differs between all cities and versions that the process has opened.
    pub(super) serial: u64,
    pub(super) kind: TileKind,
    /// The tile's id in its archive; for a mesh it encodes leaf and level of detail.
    pub(super) id: TileId,
}

/// A checked tile with the headers of its 200 response.
#[derive(Debug)]
pub(super) struct CachedTile {
    pub(super) representation: Representation,
    pub(super) headers: HeaderMap,
}

/// A cache bounded in bytes that evicts the least recently used tiles.
#[derive(Debug)]
pub(super) struct TileCache {
    max_bytes: usize,
    /// Bytes of all tile caches of the server.
    cached_bytes: Gauge,
    entries: Mutex<TileCacheEntries>,
}

#[derive(Debug)]
struct TileCacheEntries {
    tiles: LruCache<TileCacheKey, Arc<CachedTile>, BuildHasherDefault<KeyHasher>>,
    bytes: usize,
}

impl TileCache {
    /// `cached_bytes` counts the bytes of this cache as well.
    pub(super) fn new(max_bytes: usize, cached_bytes: Gauge) -> Self {
        let tiles = LruCache::unbounded_with_hasher(BuildHasherDefault::default());
        Self { max_bytes, cached_bytes, entries: Mutex::new(TileCacheEntries { tiles, bytes: 0 }) }
    }

    pub(super) fn get(&self, key: &TileCacheKey) -> Option<Arc<CachedTile>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner).tiles.get(key).cloned()
    }

    /// Adds a tile, unless it is larger than the whole cache.
    pub(super) fn insert(&self, key: TileCacheKey, tile: Arc<CachedTile>) {
        let size = |tile: &CachedTile| tile.representation.body.len() + ENTRY_BYTES;
        if size(&tile) > self.max_bytes {
            return;
        }
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        let before = entries.bytes;
        entries.bytes += size(&tile);
        if let Some(replaced) = entries.tiles.put(key, tile) {
            entries.bytes -= size(&replaced);
        }
        while entries.bytes > self.max_bytes
            && let Some((_, evicted)) = entries.tiles.pop_lru()
        {
            entries.bytes -= size(&evicted);
        }
        self.cached_bytes.inc_by(entries.bytes as i64 - before as i64);
    }
}

impl Drop for TileCache {
    fn drop(&mut self) {
        let entries = self.entries.get_mut().unwrap_or_else(PoisonError::into_inner);
        self.cached_bytes.dec_by(entries.bytes as i64);
    }
}

/// A fast hasher without protection against chosen collisions: keys are only tiles that exist, so clients cannot choose them.
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
    use crate::http::representation::quoted;

    #[test]
    fn evicts_least_recently_used_tiles_to_stay_below_its_size() {
        let tile = |bytes: usize| {
            let representation = Representation::immutable(vec![0; bytes].into(), quoted("tag"), "x/y", true);
            Arc::new(CachedTile { representation, headers: HeaderMap::new() })
        };
        let key = |x| TileCacheKey { serial: 1, kind: TileKind::BlockMap, id: TileId::new(9, x, 0).unwrap() };
        let cache = TileCache::new(10 * (100 + ENTRY_BYTES), Gauge::default());
        for x in 0..100 {
            cache.insert(key(x), tile(100));
            assert!(cache.get(&key(0)).is_some(), "it was used recently");
            let entries = cache.entries.lock().unwrap();
            assert_eq!(entries.bytes, entries.tiles.len() * (100 + ENTRY_BYTES));
            assert!(entries.bytes <= cache.max_bytes);
            assert_eq!(cache.cached_bytes.get(), entries.bytes as i64);
        }
        assert!(cache.get(&key(99)).is_some() && cache.get(&key(50)).is_none());
        cache.insert(key(99), tile(50));
        assert_eq!(cache.entries.lock().unwrap().bytes, 10 * (100 + ENTRY_BYTES) - 50, "replaced, not counted twice");
        cache.insert(key(7), tile(1 << 20));
        assert!(cache.get(&key(7)).is_none() && cache.get(&key(99)).is_some(), "an oversized tile evicts nothing");
    }
}
