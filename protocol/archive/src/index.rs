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
use std::{collections::HashSet, ops::Range};

/// An archive whose directories have been read and checked: every tile lies inside the file.
#[derive(Debug)]
pub struct Archive {
    source: SharedSource,
    length: u64,
    entries: Vec<DirectoryEntry>,
}

impl Archive {
    /// Opens a file and reads its directories.
    #[cfg(feature = "fs")]
    pub fn open(path: &std::path::Path) -> Result<Self, crate::CityError> {
        use crate::{CityError, file::FileSource};
        use futures_util::FutureExt as _;
        let source = FileSource::open(path).map_err(|source| CityError::Io { path: path.to_owned(), source })?;
        let loaded = Self::load(std::sync::Arc::new(source)).now_or_never();
        let waits = || Err(ReadError::Failed("a file does not answer at once".into()).into());
        let location = || path.display().to_string();
        loaded.unwrap_or_else(waits).map_err(|source| CityError::Archive { location: location(), source })
    }

    /// Reads the directories of an archive. The length of the source must be known.
    pub async fn load(source: SharedSource) -> Result<Self, ArchiveError> {
        let length = source.length().ok_or_else(|| ReadError::Failed("the length is unknown".into()))?;
        let first = read_exactly(&source, 0..length.min(HEADER_BYTES)).await?;
        let header = ArchiveHeader::read(&first, Some(length))?;
        let root = read_exactly(&source, header.root.clone()).await?;
        let leaves = read_exactly(&source, header.leaves.clone()).await?;
        let budget = DirectoryBudget::of_archive(length);
        let mut loader =
            DirectoryLoader { header, leaves, budget, visited: HashSet::new(), tiles: 0, entries: Vec::new() };
        loader.add(&root, 0)?;
        Ok(Self { source, length, entries: loader.entries })
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
    header: ArchiveHeader,
    leaves: Bytes,
    budget: DirectoryBudget,
    /// Offsets of leaf directories. Each is listed once in a valid archive, so a repetition is a cycle or a bomb.
    visited: HashSet<u64>,
    tiles: u64,
    entries: Vec<DirectoryEntry>,
}

impl DirectoryLoader {
    fn add(&mut self, packed: &[u8], depth: u8) -> Result<(), ArchiveError> {
        let bad = |what| Err(ArchiveError::Directory(what));
        for entry in self.header.unpack(packed, &mut self.budget)? {
            if self.entries.last().is_some_and(|last| last.end() > entry.number) {
                return bad("its tiles are not in order");
            }
            if !entry.is_leaf() {
                // A run takes a few bytes however long it is, but whoever lists all tiles must come to an end.
                self.tiles += u64::from(entry.run);
                if self.tiles > MAX_TILES {
                    return Err(ArchiveError::TooMany(MAX_TILES));
                }
                self.entries.push(entry);
                continue;
            }
            if depth >= MAX_LEAF_DEPTH {
                return bad("leaf directories are nested too deeply");
            }
            if !self.visited.insert(entry.offset) {
                return bad("a leaf directory is listed twice");
            }
            let start = (entry.offset - self.header.leaves.start) as usize;
            let packed = self.leaves.slice(start..start + entry.length as usize);
            self.add(&packed, depth + 1)?;
        }
        Ok(())
    }
}
