//! An archive with all of its directories in memory.

use crate::{
    ArchiveError, RangeRead, ReadError,
    directory::{
        ArchiveHeader, DirectoryBudget, DirectoryEntry, HEADER_BYTES, MAX_LEAF_DEPTH, MAX_TILES, find, tile_id,
        tile_number,
    },
    source::{SharedSource, read_exactly},
};
use bytes::Bytes;
use insula_protocol::TileId;
use std::{collections::HashSet, ops::Range, time::Instant};

/// An archive whose directories have been read and checked: every tile lies inside the file.
#[derive(Debug)]
pub struct Archive {
    source: SharedSource,
    length: u64,
    #[cfg_attr(not(feature = "fs"), allow(dead_code, reason = "only folders are checked"))]
    data: Range<u64>,
    entries: Vec<DirectoryEntry>,
    longest_tile_bytes: u32,
}

impl Archive {
    /// Opens a file and reads its directories. Fails if that takes until `deadline`.
    #[cfg(feature = "fs")]
    pub fn open(path: &std::path::Path, deadline: Instant) -> Result<Self, crate::CityError> {
        use crate::{CityError, file::FileSource};
        use futures_util::FutureExt as _;
        let source = FileSource::open(path).map_err(|source| CityError::Io { path: path.to_owned(), source })?;
        let loaded = Self::load(std::sync::Arc::new(source), Some(deadline)).now_or_never();
        let waits = || Err(ReadError::Failed("a file does not answer at once".into()).into());
        let location = || path.display().to_string();
        loaded.unwrap_or_else(waits).map_err(|source| CityError::Archive { location: location(), source })
    }

    /// Reads the directories of an archive. The length of the source must be known. Fails if that takes until `deadline`.
    pub async fn load(source: SharedSource, deadline: Option<Instant>) -> Result<Self, ArchiveError> {
        let length = source.length().ok_or_else(|| ReadError::Failed("the length is unknown".into()))?;
        let first = read_exactly(&source, 0..length.min(HEADER_BYTES)).await?;
        let header = ArchiveHeader::read(&first, Some(length))?;
        let root = read_exactly(&source, header.root.clone()).await?;
        let mut loader = DirectoryLoader::new(source.clone(), header, DirectoryBudget::of_archive(length), deadline);
        loader.load(&root).await?;
        let longest_tile_bytes = loader.entries.iter().map(|entry| entry.length).max().unwrap_or(0);
        Ok(Self { source, length, data: loader.header.data, entries: loader.entries, longest_tile_bytes })
    }

    /// Where the bytes of a tile are. `None` if there is no such tile.
    pub fn find(&self, id: TileId) -> Option<Range<u64>> {
        find(&self.entries, tile_number(id)).map(DirectoryEntry::bytes)
    }

    /// Reads a range that [`Self::find`] returned.
    pub fn read(&self, range: Range<u64>) -> RangeRead {
        self.source.read(range)
    }

    /// See [`crate::RangeSource::invalidate`].
    pub async fn invalidate(&self, range: Range<u64>) {
        self.source.invalidate(range).await;
    }

    /// Reads a tile of a local file, unchecked. `None` if there is no such tile.
    pub fn tile(&self, id: TileId) -> Result<Option<Bytes>, ReadError> {
        self.find(id).map(|range| self.read(range).ready()).transpose()
    }

    /// All tiles of a local file, by level and then along the Hilbert curve.
    pub fn tiles(&self) -> impl Iterator<Item = (TileId, Result<Bytes, ReadError>)> {
        self.ids().map(|(id, entry)| (id, self.read(entry.bytes()).ready()))
    }

    /// Id and length in bytes of every tile.
    pub fn lengths(&self) -> impl Iterator<Item = (TileId, u32)> {
        self.ids().map(|(id, entry)| (id, entry.length))
    }

    fn ids(&self) -> impl Iterator<Item = (TileId, &DirectoryEntry)> {
        self.entries
            .iter()
            .flat_map(|entry| (entry.number..entry.end()).filter_map(move |number| Some((tile_id(number)?, entry))))
    }

    /// The deepest level that has a tile.
    pub fn deepest_level(&self) -> u8 {
        self.entries.last().and_then(|last| tile_id(last.end() - 1)).map_or(0, TileId::level)
    }

    /// Where the bytes of the tiles are in the file.
    #[cfg(feature = "fs")]
    pub(crate) fn data(&self) -> Range<u64> {
        self.data.clone()
    }

    /// Where the bytes of each tile are, equal ranges once, in ascending order.
    #[cfg(feature = "fs")]
    pub(crate) fn distinct_tiles(&self) -> Vec<Range<u64>> {
        let mut ranges: Vec<Range<u64>> = self.entries.iter().map(DirectoryEntry::bytes).collect();
        ranges.sort_unstable_by_key(|range| (range.start, range.end));
        ranges.dedup();
        ranges
    }

    /// Length of the longest tile in bytes.
    pub fn longest_tile_bytes(&self) -> u32 {
        self.longest_tile_bytes
    }

    /// Whether tiles of consecutive nodes are equal and share an entry.
    pub fn has_runs(&self) -> bool {
        self.entries.iter().any(|entry| entry.run > 1)
    }

    /// Number of tiles.
    pub fn len(&self) -> u64 {
        self.entries.iter().map(|entry| u64::from(entry.run)).sum()
    }

    /// Whether there is no tile.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Length of the file in bytes.
    pub fn file_bytes(&self) -> u64 {
        self.length
    }
}

/// Collects the tiles of nested directories.
struct DirectoryLoader {
    source: SharedSource,
    header: ArchiveHeader,
    budget: DirectoryBudget,
    deadline: Option<Instant>,
    /// Offsets of leaf directories. Each is listed once in a valid archive, so a repetition is a cycle or a bomb.
    visited: HashSet<u64>,
    /// Bytes of the section of leaf directories that are left: in a valid archive, leaf directories do not overlap.
    packed_bytes: u64,
    tiles: u64,
    entries: Vec<DirectoryEntry>,
}

impl DirectoryLoader {
    fn new(source: SharedSource, header: ArchiveHeader, budget: DirectoryBudget, deadline: Option<Instant>) -> Self {
        let packed_bytes = header.leaves.end - header.leaves.start;
        let (visited, entries) = (HashSet::new(), Vec::new());
        Self { source, header, budget, deadline, visited, packed_bytes, tiles: 0, entries }
    }

    /// Reads all directories, depth first. One directory of each depth is in memory.
    async fn load(&mut self, root: &[u8]) -> Result<(), ArchiveError> {
        let mut open = vec![self.header.unpack(root, &mut self.budget)?.into_iter()];
        while let Some(directory) = open.last_mut() {
            let Some(entry) = directory.next() else {
                open.pop();
                continue;
            };
            if self.entries.last().is_some_and(|last| last.end() > entry.number) {
                return Err(ArchiveError::Directory("its tiles are not in order"));
            }
            if !entry.is_leaf() {
                self.add_tiles(entry)?;
                continue;
            }
            if open.len() > usize::from(MAX_LEAF_DEPTH) {
                return Err(ArchiveError::Directory("leaf directories are nested too deeply"));
            }
            self.check_leaf(&entry)?;
            let packed = read_exactly(&self.source, entry.bytes()).await?;
            open.push(self.header.unpack(&packed, &mut self.budget)?.into_iter());
        }
        Ok(())
    }

    fn add_tiles(&mut self, entry: DirectoryEntry) -> Result<(), ArchiveError> {
        // A run takes a few bytes however long it is, but whoever lists all tiles must come to an end.
        self.tiles += u64::from(entry.run);
        if self.tiles > MAX_TILES {
            return Err(ArchiveError::TooMany(MAX_TILES));
        }
        self.entries.try_reserve(1).map_err(|_| ArchiveError::Memory(self.tiles))?;
        self.entries.push(entry);
        Ok(())
    }

    fn check_leaf(&mut self, leaf: &DirectoryEntry) -> Result<(), ArchiveError> {
        let bad = |what| Err(ArchiveError::Directory(what));
        if !self.visited.insert(leaf.offset) {
            return bad("a leaf directory is listed twice");
        }
        let Some(packed_bytes) = self.packed_bytes.checked_sub(u64::from(leaf.length)) else {
            return bad("leaf directories overlap");
        };
        self.packed_bytes = packed_bytes;
        if self.deadline.is_some_and(|deadline| Instant::now() >= deadline) {
            return Err(ArchiveError::TooSlow);
        }
        Ok(())
    }
}
