//! The bytes of a raster: read at any place, never beyond the file's end.

use super::error::RasterError;
use std::io::{self, Read, Seek, SeekFrom};

/// A file, or anything else that is read at any place.
pub(crate) trait ReadSeek: Read + Seek + Send {}

impl<T: Read + Seek + Send> ReadSeek for T {}

/// A file with its size.
pub(super) struct Source {
    reader: Box<dyn ReadSeek>,
    len: u64,
}

impl Source {
    pub(super) fn new(mut reader: Box<dyn ReadSeek>) -> Result<Self, RasterError> {
        let len = reader.seek(SeekFrom::End(0)).map_err(RasterError::Io)?;
        Ok(Self { reader, len })
    }

    /// Size in bytes.
    pub(super) fn len(&self) -> u64 {
        self.len
    }

    /// Fails before memory is taken if the file has fewer bytes.
    pub(super) fn read_at(&mut self, offset: u64, count: u64) -> Result<Vec<u8>, RasterError> {
        let is_inside = offset.checked_add(count).is_some_and(|end| end <= self.len);
        let size = usize::try_from(count).ok().filter(|_| is_inside);
        let size = size.ok_or_else(|| RasterError::damaged("it refers to bytes after its end"))?;
        let mut bytes = vec![0; size];
        self.reader.seek(SeekFrom::Start(offset))?;
        self.reader.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    /// The first bytes, at most `count`.
    pub(super) fn start(&mut self, count: u64) -> Result<Vec<u8>, RasterError> {
        self.read_at(0, count.min(self.len))
    }
}

impl Read for Source {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.reader.read(buffer)
    }
}

impl Seek for Source {
    fn seek(&mut self, place: SeekFrom) -> io::Result<u64> {
        self.reader.seek(place)
    }
}
