//! An archive whose directories are checked when it is opened.

use crate::directory::{
    ArchiveHeader, DirectoryBudget, DirectoryEntry, HEADER_BYTES, MAX_LEAF_DEPTH, MAX_TILES, find, tile_id, tile_number,
};
use crate::mark::ExpectedMark;
use crate::resident_directories::ResidentDirectories;
use crate::source::{SharedSource, read_exactly};
use crate::{ArchiveError, RangeRead, ReadError};
use bytes::Bytes;
use futures_util::FutureExt as _;
use insula_protocol::{Manifest, TileId};
use std::collections::HashSet;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;
use std::vec;

/// An archive whose directories have been checked: every tile lies inside the file.
///
/// The root directory stays in memory, and the most recently used leaf directories of all archives, so memory does not follow the number
/// of tiles. What is read again is checked again.
#[derive(Debug)]
pub struct Archive {
    source: SharedSource,
    /// Of the file, without an archive that follows it ([`crate::joined`]).
    length: u64,
    header: ArchiveHeader,
    root: Arc<Vec<DirectoryEntry>>,
    /// Callers do not share fetches as in `LazyArchive`: one that reads a file must not depend on another that waits.
    leaves: ResidentDirectories,
    facts: ArchiveFacts,
}

/// What the directories of an archive say of all its tiles.
#[derive(Debug, Clone, Copy, Default)]
struct ArchiveFacts {
    tiles: u64,
    /// Number after the last tile.
    end: u64,
    longest_tile_bytes: u32,
    has_runs: bool,
}

impl Archive {
    /// Opens a file and checks its directories. Fails if that takes until `deadline`.
    #[cfg(feature = "fs")]
    pub fn open(path: &std::path::Path, deadline: Instant) -> Result<Self, crate::CityError> {
        Self::open_joined(path, &[], deadline)
    }

    /// The same of a file that shares tiles with others: their paths, and the versions of their cities, the nearest first. Those from the
    /// first on that does not exist have no such tiles. Fails if a file is of another version.
    #[cfg(feature = "fs")]
    pub fn open_joined(
        path: &std::path::Path,
        shared: &[(std::path::PathBuf, &str)],
        deadline: Instant,
    ) -> Result<Self, crate::CityError> {
        use crate::CityError;
        use crate::file_source::FileSource;
        use crate::joined::{check_mark, joined};
        use crate::mark::mark_of;
        let open = |path: &std::path::Path| -> Result<SharedSource, CityError> {
            let opened = FileSource::open(path).map_err(|source| CityError::Io { path: path.to_owned(), source })?;
            Ok(Arc::new(opened))
        };
        let failed = |path: &std::path::Path| {
            let location = path.display().to_string();
            move |source| CityError::Archive { location, source }
        };
        let mut others = Vec::new();
        for (path, version) in shared {
            let source = match open(path) {
                Err(CityError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => break,
                source => source?,
            };
            let mark = mark_of(version);
            check_mark(source.read(0..HEADER_BYTES).ready(), mark)
                .map_err(|_| failed(path)(ArchiveError::OtherVersion))?;
            others.push((source, mark));
        }
        let source = joined(open(path)?, &mut others.into_iter());
        let loaded = Self::load(source, Some(deadline)).now_or_never();
        loaded.unwrap_or_else(|| Err(not_local().into())).map_err(failed(path))
    }

    /// Checks the directories of an archive. The length of the source must be known. Fails if that takes until `deadline`.
    pub async fn load(source: SharedSource, deadline: Option<Instant>) -> Result<Self, ArchiveError> {
        let unknown = || ReadError::Failed("the length is unknown".into());
        let (length, end) = source.own_bytes().zip(source.length()).ok_or_else(unknown)?;
        let first = read_exactly(&source, 0..length.min(HEADER_BYTES)).await?;
        let header = ArchiveHeader::read(&first, Some(end))?;
        let packed = read_exactly(&source, header.root.clone()).await?;
        let mut check = DirectoryCheck::new(source.clone(), &header, DirectoryBudget::of_archive(end), deadline);
        let root = Arc::new(header.unpack(&packed, &mut check.budget)?);
        check.run(Vec::clone(&root)).await?;
        let (facts, leaves) = (check.facts, ResidentDirectories::with_root(root.len()));
        Ok(Self { source, length, header, root, leaves, facts })
    }

    /// Where the bytes of a tile are. `None` if there is no such tile. Fails if a directory cannot be read.
    pub async fn find(&self, id: TileId) -> Result<Option<Range<u64>>, ReadError> {
        let number = tile_number(id);
        let mut directory = Arc::clone(&self.root);
        for _ in 0..=MAX_LEAF_DEPTH {
            match find(&directory, number) {
                None => return Ok(None),
                Some(tile) if !tile.is_leaf() => return Ok(Some(tile.bytes())),
                Some(leaf) => directory = self.leaf(leaf.bytes()).await?,
            }
        }
        Err(ArchiveError::Directory("leaf directories are nested too deeply").into())
    }

    async fn leaf(&self, bytes: Range<u64>) -> Result<Arc<Vec<DirectoryEntry>>, ReadError> {
        if let Some(directory) = self.leaves.get(bytes.start) {
            return Ok(directory);
        }
        let packed = read_exactly(&self.source, bytes.clone()).await?;
        let directory = Arc::new(self.header.unpack(&packed, &mut DirectoryBudget::of_one())?);
        self.leaves.put(bytes.start, Arc::clone(&directory), directory.len());
        Ok(directory)
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
        self.place(id)?.map(|range| self.read(range).ready()).transpose()
    }

    /// All tiles of a local file, by level and then along the Hilbert curve. Where a directory cannot be read, its first tile has the
    /// error, and the others are missing.
    pub fn tiles(&self) -> impl Iterator<Item = (TileId, Result<Bytes, ReadError>)> {
        self.ids().map(|(id, entry)| (id, entry.and_then(|entry| self.read(entry.bytes()).ready())))
    }

    /// Id and length in bytes of every tile of a local file. Fails as [`Self::tiles`] does.
    pub fn lengths(&self) -> impl Iterator<Item = (TileId, Result<u32, ReadError>)> {
        self.ids().map(|(id, entry)| (id, entry.map(|entry| entry.length)))
    }

    fn ids(&self) -> impl Iterator<Item = (TileId, Result<DirectoryEntry, ReadError>)> {
        self.entries().flat_map(|(number, entry)| {
            let end = entry.as_ref().map_or(number + 1, DirectoryEntry::end);
            (number..end).filter_map(move |number| Some((tile_id(number)?, entry.clone())))
        })
    }

    /// All entries of tiles of a local file with the number of their first tile.
    fn entries(&self) -> impl Iterator<Item = (u64, Result<DirectoryEntry, ReadError>)> {
        let mut open: Vec<vec::IntoIter<DirectoryEntry>> = vec![Vec::clone(&self.root).into_iter()];
        std::iter::from_fn(move || {
            while let Some(directory) = open.last_mut() {
                let Some(entry) = directory.next() else {
                    open.pop();
                    continue;
                };
                if !entry.is_leaf() {
                    return Some((entry.number, Ok(entry)));
                }
                let is_deep = open.len() > usize::from(MAX_LEAF_DEPTH);
                let nested = || Err(ArchiveError::Directory("leaf directories are nested too deeply").into());
                let leaf = if is_deep { nested() } else { self.unpack_leaf(&entry) };
                match leaf {
                    Ok(leaf) => open.push(leaf.into_iter()),
                    Err(error) => return Some((entry.number, Err(error))),
                }
            }
            None
        })
    }

    /// Does not displace directories in memory.
    fn unpack_leaf(&self, leaf: &DirectoryEntry) -> Result<Vec<DirectoryEntry>, ReadError> {
        let packed = read_exactly(&self.source, leaf.bytes()).now_or_never().unwrap_or_else(|| Err(not_local()))?;
        Ok(self.header.unpack(&packed, &mut DirectoryBudget::of_one())?)
    }

    /// Whether the archive can be of this bake of a city: it has its mark, or none, as archives of earlier bakes.
    pub fn is_of(&self, manifest: &Manifest) -> bool {
        ExpectedMark::of(manifest).accepts(self.header.mark)
    }

    /// The deepest level that has a tile.
    pub fn deepest_level(&self) -> u8 {
        self.facts.end.checked_sub(1).and_then(tile_id).map_or(0, TileId::level)
    }

    /// Where a tile of a local file is. `None` if there is no such tile. Fails if a directory cannot be read.
    pub fn place(&self, id: TileId) -> Result<Option<Range<u64>>, ReadError> {
        self.find(id).now_or_never().unwrap_or_else(|| Err(not_local()))
    }

    /// Position after the bytes of all tiles.
    pub fn end(&self) -> u64 {
        self.header.data.end
    }

    /// Where the bytes of the tiles are in the file itself.
    #[cfg(feature = "fs")]
    pub(crate) fn data(&self) -> Range<u64> {
        let Range { start, end } = self.header.data;
        // Behind its own tiles, a file that shares others has its directories.
        let own_end = if end <= self.length { end } else { self.header.leaves.start.min(self.length) };
        start..own_end.max(start)
    }

    /// Where the bytes of each tile in the file itself are in ascending order. Of tiles that lie behind a later one, as equal tiles do,
    /// only the first is listed.
    #[cfg(feature = "fs")]
    pub(crate) fn distinct_tiles(&self) -> impl Iterator<Item = Result<Range<u64>, ReadError>> {
        let (mut position, end) = (0, self.data().end);
        self.entries().filter_map(move |(_, entry)| match entry {
            Ok(entry) if entry.bytes().start < position || entry.bytes().start >= end => None,
            Ok(entry) => {
                position = entry.bytes().end;
                Some(Ok(entry.bytes()))
            }
            Err(error) => Some(Err(error)),
        })
    }

    /// Length of the longest tile in bytes.
    pub fn longest_tile_bytes(&self) -> u32 {
        self.facts.longest_tile_bytes
    }

    /// Whether tiles of consecutive nodes are equal and share an entry.
    pub fn has_runs(&self) -> bool {
        self.facts.has_runs
    }

    /// Number of tiles.
    pub fn len(&self) -> u64 {
        self.facts.tiles
    }

    /// Whether there is no tile.
    pub fn is_empty(&self) -> bool {
        self.facts.tiles == 0
    }

    /// Length of the file in bytes.
    pub fn file_bytes(&self) -> u64 {
        self.length
    }
}

fn not_local() -> ReadError {
    ReadError::Failed("the archive is not a local file".into())
}

/// Checks the tiles of nested directories.
struct DirectoryCheck<'a> {
    source: SharedSource,
    header: &'a ArchiveHeader,
    budget: DirectoryBudget,
    deadline: Option<Instant>,
    /// Offsets of leaf directories. Each is listed once in a valid archive, so a repetition is a cycle or a bomb.
    visited: HashSet<u64>,
    /// Bytes of the section of leaf directories that are left: in a valid archive, leaf directories do not overlap.
    packed_bytes: u64,
    facts: ArchiveFacts,
}

impl<'a> DirectoryCheck<'a> {
    fn new(
        source: SharedSource,
        header: &'a ArchiveHeader,
        budget: DirectoryBudget,
        deadline: Option<Instant>,
    ) -> Self {
        let packed_bytes = header.leaves.end - header.leaves.start;
        let (visited, facts) = (HashSet::new(), ArchiveFacts::default());
        Self { source, header, budget, deadline, visited, packed_bytes, facts }
    }

    /// Reads all directories, depth first. One directory of each depth is in memory.
    async fn run(&mut self, root: Vec<DirectoryEntry>) -> Result<(), ArchiveError> {
        let mut open = vec![root.into_iter()];
        while let Some(directory) = open.last_mut() {
            let Some(entry) = directory.next() else {
                open.pop();
                continue;
            };
            if self.facts.end > entry.number {
                return Err(ArchiveError::Directory("its tiles are not in order"));
            }
            if !entry.is_leaf() {
                self.add_tiles(&entry)?;
                continue;
            }
            if open.len() > usize::from(MAX_LEAF_DEPTH) {
                return Err(ArchiveError::Directory("leaf directories are nested too deeply"));
            }
            self.check_leaf(&entry)?;
            let packed = read_exactly(&self.source, entry.bytes()).await?;
            let leaf = self.header.unpack(&packed, &mut self.budget)?;
            // `find` searches the directory before for such tiles, and does not find them.
            if leaf.first().is_some_and(|first| first.number < entry.number) {
                return Err(ArchiveError::Directory("a leaf directory has tiles before its first one"));
            }
            open.push(leaf.into_iter());
        }
        Ok(())
    }

    fn add_tiles(&mut self, entry: &DirectoryEntry) -> Result<(), ArchiveError> {
        // A run takes a few bytes however long it is, but whoever lists all tiles must come to an end.
        self.facts.tiles += u64::from(entry.run);
        if self.facts.tiles > MAX_TILES {
            return Err(ArchiveError::TooMany(MAX_TILES));
        }
        self.facts.end = entry.end();
        self.facts.longest_tile_bytes = self.facts.longest_tile_bytes.max(entry.length);
        self.facts.has_runs |= entry.run > 1;
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
