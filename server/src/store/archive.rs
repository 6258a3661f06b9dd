//! One tile archive.
//!
//! In: a PMTiles file, wherever it is. Out: [`Archive`]: its tiles' places, and their bytes. Next: `city`.

use super::{
    ArchiveError, StoreError,
    directory::{self, Entry, Header},
    source::{FileSource, Read, ReadError, Source, at_once},
};
use bytes::Bytes;
use insula_protocol::TileId;
use std::{fs::File, ops::Range, path::Path, sync::Arc};

/// An archive whose directories have been read and checked.
#[derive(Debug)]
pub struct Archive {
    source: Arc<dyn Source>,
    entries: Vec<Entry>,
}

impl Archive {
    /// Opens a file and reads its directories.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        let unreadable = |source| StoreError::Io { path: path.to_owned(), source };
        let source = File::open(path).and_then(FileSource::new).map_err(unreadable)?;
        let read = at_once(Self::load(Arc::new(source))).unwrap_or(Err(ArchiveError::Unreadable("it waits".into())));
        read.map_err(|source| StoreError::Archive { place: path.display().to_string(), source })
    }

    /// Reads the directories of an archive anywhere.
    pub(super) async fn load(source: Arc<dyn Source>) -> Result<Self, ArchiveError> {
        let file_bytes = source.file_bytes();
        let first = source.read(0..file_bytes.min(directory::HEADER_BYTES as u64)).bytes().await?;
        let header = Header::read(&first, file_bytes)?;
        let root = source.read(header.root.clone()).bytes().await?;
        let leaves = source.read(header.leaves.clone()).bytes().await?;
        let entries = directory::read(&header, &root, &leaves)?;
        Ok(Self { source, entries })
    }

    /// Where a tile's bytes are. `None` if there is no such tile.
    pub fn find(&self, id: TileId) -> Option<Range<u64>> {
        let coord = pmtiles::TileCoord::new(id.level(), id.x(), id.y()).ok()?;
        let place = pmtiles::TileId::from(coord).value();
        let after = self.entries.partition_point(|entry| entry.id <= place);
        let entry = self.entries.get(after.checked_sub(1)?)?;
        (place < entry.end()).then(|| entry.bytes())
    }

    /// What lies at a place that [`Self::find`] gave.
    pub fn read(&self, place: Range<u64>) -> Read {
        self.source.read(place)
    }

    /// See [`Source::forget`].
    pub(super) async fn forget(&self, place: Range<u64>) {
        self.source.forget(place).await;
    }

    /// A tile's bytes as the archive holds them, from a file. `None` if there is no such tile.
    pub fn tile(&self, id: TileId) -> Result<Option<Bytes>, ReadError> {
        self.find(id).map(|place| self.now(place)).transpose()
    }

    /// Every tile of a file, by level and then along the Hilbert curve.
    pub fn tiles(&self) -> impl Iterator<Item = (TileId, Result<Bytes, ReadError>)> {
        self.places().map(|(id, entry)| (id, self.now(entry.bytes())))
    }

    fn now(&self, place: Range<u64>) -> Result<Bytes, ReadError> {
        match self.read(place) {
            Read::Now(bytes) => bytes,
            Read::Later(_) => Err(ReadError::Failed("it is not a file of this machine".into())),
        }
    }

    /// Every tile's id and length in bytes, without touching it.
    pub fn lengths(&self) -> impl Iterator<Item = (TileId, u32)> {
        self.places().map(|(id, entry)| (id, entry.length))
    }

    fn places(&self) -> impl Iterator<Item = (TileId, &Entry)> {
        self.entries.iter().flat_map(|entry| (entry.id..entry.end()).filter_map(move |at| Some((tile_id(at)?, entry))))
    }

    /// The deepest level that has a tile.
    pub(super) fn deepest(&self) -> u8 {
        self.entries.last().and_then(|last| tile_id(last.end() - 1)).map_or(0, |id| id.level())
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
        self.source.file_bytes()
    }
}

/// `None` cannot happen: `directory::read` refuses places below the deepest level.
fn tile_id(place: u64) -> Option<TileId> {
    let coord = pmtiles::TileCoord::from(pmtiles::TileId::new(place).ok()?);
    TileId::new(coord.z(), coord.x(), coord.y())
}
