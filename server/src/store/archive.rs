//! One tile archive, mapped into memory.
//!
//! In: a PMTiles file. Out: [`Archive`]: a tile's bytes by id, as slices of the map. Next: `city`.
//!
//! **The file must not be changed in place while it is open.** A page of the map that no longer has a file behind it
//! raises SIGBUS when touched, which no check made earlier can prevent. `bake` never does that: it writes a new folder and
//! renames it, and an open map keeps the old file alive. Replace a served city the same way; do not copy over it.

use super::{
    ArchiveError, StoreError,
    directory::{self, Entry},
};
use bytes::Bytes;
use insula_protocol::TileId;
use std::{fs::File, path::Path};

/// An archive whose directories have been read and checked.
#[derive(Debug)]
pub struct Archive {
    bytes: Bytes,
    entries: Vec<Entry>,
}

impl Archive {
    /// Maps the file and reads its directories.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        let unreadable = |source| StoreError::Io { path: path.to_owned(), source };
        let file = File::open(path).map_err(unreadable)?;
        // SAFETY: a shared read-only map of a file that, by the contract in the module's doc, nobody changes in place. All
        // accesses stay inside the length that it had when mapped: `directory::read` proves each entry, `Bytes` checks.
        let map = unsafe { memmap2::Mmap::map(&file) }.map_err(unreadable)?;
        Self::new(Bytes::from_owner(map)).map_err(|source| StoreError::Archive { path: path.to_owned(), source })
    }

    fn new(bytes: Bytes) -> Result<Self, ArchiveError> {
        let entries = directory::read(&bytes)?;
        Ok(Self { bytes, entries })
    }

    /// A tile's bytes, without a copy. `None` if there is no such tile.
    pub fn tile(&self, id: TileId) -> Option<Bytes> {
        let coord = pmtiles::TileCoord::new(id.level(), id.x(), id.y()).ok()?;
        let place = pmtiles::TileId::from(coord).value();
        let after = self.entries.partition_point(|entry| entry.id <= place);
        let entry = self.entries.get(after.checked_sub(1)?)?;
        (place < entry.end()).then(|| self.slice(entry))
    }

    /// Every tile, by level and then along the Hilbert curve.
    pub fn tiles(&self) -> impl Iterator<Item = (TileId, Bytes)> {
        self.places().map(|(id, entry)| (id, self.slice(entry)))
    }

    /// Every tile's id and length in bytes, without touching it.
    pub fn lengths(&self) -> impl Iterator<Item = (TileId, u32)> {
        self.places().map(|(id, entry)| (id, entry.length))
    }

    fn places(&self) -> impl Iterator<Item = (TileId, &Entry)> {
        self.entries.iter().flat_map(|entry| (entry.id..entry.end()).filter_map(move |at| Some((tile_id(at)?, entry))))
    }

    /// How many tiles there are.
    pub fn len(&self) -> u64 {
        self.entries.iter().map(|entry| u64::from(entry.run)).sum()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Size of the file.
    pub fn file_bytes(&self) -> u64 {
        self.bytes.len() as u64
    }

    fn slice(&self, entry: &Entry) -> Bytes {
        let start = entry.offset as usize;
        self.bytes.slice(start..start + entry.length as usize)
    }
}

/// `None` cannot happen: `directory::read` refuses places below the deepest level.
fn tile_id(place: u64) -> Option<TileId> {
    let coord = pmtiles::TileCoord::from(pmtiles::TileId::new(place).ok()?);
    TileId::new(coord.z(), coord.x(), coord.y())
}
