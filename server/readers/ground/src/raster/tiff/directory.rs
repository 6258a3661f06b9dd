//! The directories of a TIFF file: which tags an image has, and where their values are. Values are read when they are
//! asked for.

use super::super::error::RasterError;
use super::super::source::Source;
use std::ops::Range;

/// Directories with more entries are damaged.
const MAX_ENTRIES: u64 = 4096;
/// Values of a tag that is read whole, in bytes.
const MAX_VALUE_BYTES: u64 = 1 << 20;

/// A TIFF file: little-endian or big-endian, with offsets of 32 or 64 bits (BigTIFF).
pub(super) struct TiffFile {
    pub(super) source: Source,
    pub(super) is_big_endian: bool,
    has_wide_offsets: bool,
}

/// The tags of one image.
#[derive(Debug, Clone)]
pub(super) struct Directory {
    entries: Vec<Entry>,
    /// Offset of the next directory; 0 after the last.
    pub(super) next: u64,
}

/// Where the values of a tag are.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    tag: u16,
    kind: u16,
    pub(super) count: u64,
    offset: u64,
}

impl TiffFile {
    /// Reads the header. Returns the offset of the first directory too.
    pub(super) fn open(mut source: Source) -> Result<(Self, u64), RasterError> {
        let start = source.start(16)?;
        if !super::is_tiff(&start) {
            return Err(RasterError::NotThisFormat);
        }
        let is_big_endian = start[0] == b'M';
        let has_wide_offsets = start[2..4].contains(&43);
        let mut file = Self { source, is_big_endian, has_wide_offsets };
        let first = if has_wide_offsets { file.unsigned_at(8, 8)? } else { file.unsigned_at(4, 4)? };
        Ok((file, first))
    }

    /// Reads which tags a directory has.
    pub(super) fn directory(&mut self, offset: u64) -> Result<Directory, RasterError> {
        let (count_size, entry_size, field_size) = if self.has_wide_offsets { (8, 20, 8) } else { (2, 12, 4) };
        let count = self.unsigned_at(offset, count_size)?;
        if count == 0 || count > MAX_ENTRIES {
            return Err(RasterError::damaged(format!("a directory has {count} entries")));
        }
        let first = offset + count_size;
        let bytes = self.source.read_at(first, count * entry_size + field_size)?;
        let mut entries = Vec::new();
        for (index, entry) in bytes.chunks_exact(entry_size as usize).take(count as usize).enumerate() {
            let tag = self.unsigned(&entry[..2]) as u16;
            let kind = self.unsigned(&entry[2..4]) as u16;
            let (count, field) = entry[4..].split_at(field_size as usize);
            let count = self.unsigned(count);
            // Short values are in the entry itself.
            let is_short = count.checked_mul(size_of_kind(kind)).is_some_and(|size| size <= field_size);
            let field_offset = first + index as u64 * entry_size + 4 + field_size;
            let offset = if is_short { field_offset } else { self.unsigned(field) };
            entries.push(Entry { tag, kind, count, offset });
        }
        let next = self.unsigned(&bytes[(count * entry_size) as usize..]);
        Ok(Directory { entries, next })
    }

    /// The first value of a tag; `None` without the tag.
    pub(super) fn integer(&mut self, directory: &Directory, tag: u16) -> Result<Option<u64>, RasterError> {
        directory.entry(tag).map(|entry| self.integer_of(entry, 0)).transpose()
    }

    /// One value of an entry, without reading the others.
    pub(super) fn integer_of(&mut self, entry: Entry, index: u64) -> Result<u64, RasterError> {
        let values = self.integers_of(entry, index..index.saturating_add(1))?;
        Ok(values.first().copied().unwrap_or_default())
    }

    /// Some values of an entry, one after the other.
    pub(super) fn integers_of(&mut self, entry: Entry, places: Range<u64>) -> Result<Vec<u64>, RasterError> {
        let size = size_of_kind(entry.kind);
        let skipped = places.start.checked_mul(size).and_then(|skipped| skipped.checked_add(entry.offset));
        let bytes = places.end.saturating_sub(places.start).checked_mul(size);
        let (Some(offset), Some(bytes), true) = (skipped, bytes, places.end <= entry.count && entry.is_integer())
        else {
            return Err(RasterError::damaged(format!("tag {} has a wrong type or too few values", entry.tag)));
        };
        let bytes = self.source.read_at(offset, bytes)?;
        Ok(bytes.chunks_exact(size as usize).map(|value| self.unsigned(value)).collect())
    }

    /// All values of a tag; none without the tag.
    pub(super) fn integers(&mut self, directory: &Directory, tag: u16) -> Result<Vec<u64>, RasterError> {
        let Some(entry) = directory.entry(tag) else { return Ok(Vec::new()) };
        if !entry.is_integer() {
            return Err(RasterError::damaged(format!("tag {tag} has a wrong type")));
        }
        let bytes = self.values(entry)?;
        Ok(bytes.chunks_exact(size_of_kind(entry.kind) as usize).map(|value| self.unsigned(value)).collect())
    }

    /// All values of a tag of 64-bit numbers; none without the tag.
    pub(super) fn reals(&mut self, directory: &Directory, tag: u16) -> Result<Vec<f64>, RasterError> {
        let Some(entry) = directory.entry(tag).filter(|entry| entry.kind == 12) else { return Ok(Vec::new()) };
        let bytes = self.values(entry)?;
        Ok(bytes.chunks_exact(8).map(|value| f64::from_bits(self.unsigned(value))).collect())
    }

    /// The bytes of a tag; none without the tag.
    pub(super) fn bytes(&mut self, directory: &Directory, tag: u16) -> Result<Vec<u8>, RasterError> {
        directory.entry(tag).map_or(Ok(Vec::new()), |entry| self.values(entry))
    }

    /// The text of a tag up to its end mark.
    pub(super) fn text(&mut self, directory: &Directory, tag: u16) -> Result<Option<String>, RasterError> {
        let Some(entry) = directory.entry(tag) else { return Ok(None) };
        let bytes = self.values(entry)?;
        let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
        Ok(Some(String::from_utf8_lossy(&bytes[..end]).into_owned()))
    }

    fn values(&mut self, entry: Entry) -> Result<Vec<u8>, RasterError> {
        let size = entry.count.checked_mul(size_of_kind(entry.kind)).filter(|size| *size <= MAX_VALUE_BYTES);
        let size = size.ok_or_else(|| RasterError::damaged(format!("tag {} has too many values", entry.tag)))?;
        self.source.read_at(entry.offset, size)
    }

    fn unsigned_at(&mut self, offset: u64, size: u64) -> Result<u64, RasterError> {
        let bytes = self.source.read_at(offset, size)?;
        Ok(self.unsigned(&bytes))
    }

    /// A number of up to 8 bytes.
    fn unsigned(&self, bytes: &[u8]) -> u64 {
        let append = |number, byte: &u8| number << 8 | u64::from(*byte);
        if self.is_big_endian { bytes.iter().fold(0, append) } else { bytes.iter().rev().fold(0, append) }
    }
}

impl Directory {
    pub(super) fn entry(&self, tag: u16) -> Option<Entry> {
        self.entries.iter().find(|entry| entry.tag == tag).copied()
    }
}

impl Entry {
    /// Unsigned integers of 8, 16, 32 or 64 bits; offsets of directories are such too.
    fn is_integer(self) -> bool {
        matches!(self.kind, 1 | 3 | 4 | 13 | 16 | 18)
    }
}

/// Bytes of a value of a type.
fn size_of_kind(kind: u16) -> u64 {
    match kind {
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 | 16 | 17 | 18 => 8,
        _ => 1,
    }
}
