//! An archive whose directories are fetched as needed.

use crate::ArchiveError;
use crate::directory::{ArchiveHeader, DirectoryBudget, DirectoryEntry, MAX_LEAF_DEPTH, find, tile_number};
use crate::limits::max_tile_bytes;
use crate::mark::ExpectedMark;
use crate::resident_directories::ResidentDirectories;
use crate::source::{BoxFuture, SharedSource, read_exactly};
use bytes::Bytes;
use futures_util::FutureExt as _;
use futures_util::future::{WeakShared, try_join_all};
use insula_protocol::{Manifest, TileId, TileKind};
use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Length of the first read. PMTiles puts the header and the root directory there.
const FIRST_READ_BYTES: u64 = 16 << 10;
/// Bytes between two tiles that are read and dropped rather than making two reads.
const MAX_GAP_BYTES: u64 = 1024;
/// Longest read of several tiles.
const MAX_RUN_BYTES: u64 = 256 << 10;

/// An archive that is opened at the first tile that is asked of it.
///
/// The first read has the header and the root directory. Leaf directories are fetched when a tile in them is, once however
/// many callers wait, and the most recently used ones stay in memory. A read that fails is repeated by the next caller.
#[derive(Debug)]
pub struct LazyArchive {
    source: SharedSource,
    max_tile_bytes: usize,
    /// `None` for any.
    mark: Option<ExpectedMark>,
    cache: Arc<Mutex<DirectoryCache>>,
}

/// A directory, with the header that leaf directories below it are read by.
#[derive(Debug)]
struct ArchiveDirectory {
    header: ArchiveHeader,
    entries: Vec<DirectoryEntry>,
}

type DirectoryResult = Result<Arc<ArchiveDirectory>, ArchiveError>;

#[derive(Debug)]
struct DirectoryCache {
    /// The root's position counts as 0.
    resident: ResidentDirectories,
    /// Only the callers own a fetch: it ends when the last of them gives up.
    pending: HashMap<u64, WeakShared<BoxFuture<'static, DirectoryResult>>>,
}

impl LazyArchive {
    /// Reads nothing yet. Tiles of more than `max_tile_bytes` will not be read.
    pub fn new(source: SharedSource, max_tile_bytes: usize) -> Self {
        let cache = DirectoryCache { resident: ResidentDirectories::new(), pending: HashMap::new() };
        Self { source, max_tile_bytes, mark: None, cache: Arc::new(Mutex::new(cache)) }
    }

    /// The same for an archive of the city of this manifest: reads of another one fail with [`ArchiveError::OtherVersion`].
    #[must_use]
    pub fn of_city(self, manifest: &Manifest) -> Self {
        Self { mark: Some(ExpectedMark::of(manifest)), ..self }
    }

    /// Reads a tile, unchecked. `None` if there is no such tile. Fails without reading if it is too long.
    pub async fn tile(&self, id: TileId) -> Result<Option<Bytes>, ArchiveError> {
        let Some(range) = self.find(tile_number(id)).await? else { return Ok(None) };
        if range.end - range.start > self.max_tile_bytes as u64 {
            return Err(ArchiveError::Directory("a tile is longer than any tile may be"));
        }
        Ok(Some(read_exactly(&self.source, range).await?))
    }

    /// Reads several tiles, unchecked, with few reads: tiles that lie next to each other are read together. The results are in the order
    /// of `ids`, `None` where there is no such tile, or it is too long.
    pub async fn tiles(&self, ids: &[TileId]) -> Result<Vec<Option<Bytes>>, ArchiveError> {
        let mut found = Vec::with_capacity(ids.len());
        for (index, id) in ids.iter().enumerate() {
            let range = self.find(tile_number(*id)).await?;
            let fits = |range: &Range<u64>| range.end - range.start <= self.max_tile_bytes as u64;
            found.extend(range.filter(fits).map(|range| (index, range)));
        }
        let runs = runs(found.iter().map(|(_, range)| range.clone()).collect());
        let read = |run: &Range<u64>| read_exactly(&self.source, run.clone());
        let bytes = try_join_all(runs.iter().map(read)).await?;
        let mut tiles = vec![None; ids.len()];
        for (index, range) in found {
            let at = runs.partition_point(|run| run.end < range.end);
            let Some((run, bytes)) = runs.get(at).zip(bytes.get(at)) else { continue };
            tiles[index] = Some(bytes.slice((range.start - run.start) as usize..(range.end - run.start) as usize));
        }
        Ok(tiles)
    }

    async fn find(&self, number: u64) -> Result<Option<Range<u64>>, ArchiveError> {
        let (source, mark) = (self.source.clone(), self.mark);
        let mut directory = self.directory(0, || Box::pin(load_root(source, mark))).await?;
        for _ in 0..=MAX_LEAF_DEPTH {
            match find(&directory.entries, number) {
                None => return Ok(None),
                Some(tile) if !tile.is_leaf() => return Ok(Some(tile.bytes())),
                Some(leaf) => {
                    let (source, header, range) = (self.source.clone(), directory.header.clone(), leaf.bytes());
                    directory = self.directory(range.start, || Box::pin(load_directory(source, header, range))).await?;
                }
            }
        }
        Err(ArchiveError::Directory("leaf directories are nested too deeply"))
    }

    /// The directory at `offset`, from memory or from a fetch that all who want it share.
    async fn directory(
        &self,
        offset: u64,
        load: impl FnOnce() -> BoxFuture<'static, Result<ArchiveDirectory, ArchiveError>>,
    ) -> DirectoryResult {
        let fetch = {
            let mut cache = lock(&self.cache);
            if let Some(directory) = cache.resident.get(offset) {
                return Ok(directory);
            }
            let pending = cache.pending.get(&offset).and_then(WeakShared::upgrade);
            pending.unwrap_or_else(|| {
                let (load, owner) = (load(), self.cache.clone());
                let fetch: BoxFuture<'static, _> = Box::pin(async move {
                    let loaded = load.await.map(Arc::new);
                    lock(&owner).finish(offset, loaded.as_ref().ok());
                    loaded
                });
                let fetch = fetch.shared();
                cache.pending.extend(fetch.downgrade().map(|fetch| (offset, fetch)));
                fetch
            })
        };
        fetch.await
    }
}

/// Ranges in ascending order that contain all `tiles` and little else: tiles with a small gap between them share one.
fn runs(mut tiles: Vec<Range<u64>>) -> Vec<Range<u64>> {
    tiles.sort_unstable_by_key(|range| (range.start, range.end));
    let mut runs: Vec<Range<u64>> = Vec::new();
    for tile in tiles {
        match runs.last_mut() {
            // Hostile directories have tiles that overlap.
            Some(run)
                if tile.start <= run.end + MAX_GAP_BYTES && tile.end.max(run.end) - run.start <= MAX_RUN_BYTES =>
            {
                run.end = run.end.max(tile.end);
            }
            Some(run) if tile.end <= run.end => {}
            _ => runs.push(tile),
        }
    }
    runs
}

impl DirectoryCache {
    fn finish(&mut self, offset: u64, loaded: Option<&Arc<ArchiveDirectory>>) {
        self.pending.remove(&offset);
        let Some(directory) = loaded else { return };
        self.resident.put(offset, directory.clone(), directory.entries.len());
    }
}

impl ArchiveDirectory {
    fn unpack(header: ArchiveHeader, packed: &[u8]) -> Result<Self, ArchiveError> {
        let entries = header.unpack(packed, &mut DirectoryBudget::of_one())?;
        Ok(Self { header, entries })
    }
}

fn lock(cache: &Mutex<DirectoryCache>) -> MutexGuard<'_, DirectoryCache> {
    cache.lock().unwrap_or_else(PoisonError::into_inner)
}

async fn load_root(source: SharedSource, mark: Option<ExpectedMark>) -> Result<ArchiveDirectory, ArchiveError> {
    let first = source.read(0..FIRST_READ_BYTES).bytes().await?;
    let header = ArchiveHeader::read(&first, source.length())?;
    if mark.is_some_and(|mark| !mark.accepts(header.mark)) {
        return Err(ArchiveError::OtherVersion);
    }
    let root = header.root.clone();
    if root.end > first.len() as u64 {
        return load_directory(source, header, root).await;
    }
    ArchiveDirectory::unpack(header, &first[root.start as usize..root.end as usize])
}

async fn load_directory(
    source: SharedSource,
    header: ArchiveHeader,
    range: Range<u64>,
) -> Result<ArchiveDirectory, ArchiveError> {
    ArchiveDirectory::unpack(header, &read_exactly(&source, range).await?)
}

/// The archives of a city, each opened at its first tile.
#[derive(Debug)]
pub struct LazyCity {
    subtrees: LazyArchive,
    blockmaps: LazyArchive,
    meshes: LazyArchive,
    objects: LazyArchive,
    visibility: LazyArchive,
}

impl LazyCity {
    /// The city of a manifest. `open` returns the source of each archive.
    pub fn new(manifest: &Manifest, open: impl Fn(TileKind) -> SharedSource) -> Self {
        let archive = |kind| LazyArchive::new(open(kind), max_tile_bytes(kind)).of_city(manifest);
        let [subtrees, blockmaps, meshes, objects, visibility] =
            [TileKind::Subtree, TileKind::BlockMap, TileKind::Mesh, TileKind::Objects, TileKind::Visibility]
                .map(archive);
        Self { subtrees, blockmaps, meshes, objects, visibility }
    }

    /// The archive of one kind of tile. Those of meshes, objects and visibility may not exist; their tiles then cannot be read.
    pub fn archive(&self, kind: TileKind) -> &LazyArchive {
        match kind {
            TileKind::Subtree => &self.subtrees,
            TileKind::BlockMap => &self.blockmaps,
            TileKind::Mesh => &self.meshes,
            TileKind::Objects => &self.objects,
            TileKind::Visibility => &self.visibility,
        }
    }
}

#[cfg(test)]
mod tests;
