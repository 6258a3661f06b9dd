//! The header and the directories of a PMTiles v3 archive, checked.
//!
//! <https://github.com/protomaps/PMTiles/blob/main/spec/v3/spec.md>. The `pmtiles` crate checks less, hides the offsets of
//! entries and needs an asynchronous runtime.

use crate::ArchiveError;
use crate::limits::{MAX_READ_BYTES, MAX_TILE_BYTES};
use crate::mark::MARK_AT;
use insula_protocol::TileId;
use insula_protocol::codec::checksum;
use insula_protocol::tile_id::MAX_LEVEL;
use std::io::Read;
use std::ops::Range;

pub(crate) const HEADER_BYTES: u64 = 127;
/// Most tiles in an archive, so that whoever lists them comes to an end. Equal tiles in a row share an entry.
pub(crate) const MAX_TILES: u64 = 1 << 28;
/// Largest section of packed leaf directories.
const MAX_LEAVES_BYTES: u64 = 2 << 30;
/// Largest packed directory.
const MAX_PACKED_BYTES: u64 = 4 << 20;
const _: () = assert!(MAX_PACKED_BYTES <= MAX_READ_BYTES);
const MAX_DIRECTORY_ENTRIES: u64 = 1 << 20;
/// Most bytes of an unpacked entry: two numbers of 10 bytes and two of 5.
const MAX_ENTRY_BYTES: u64 = 30;
/// Deepest nesting of leaf directories; writers make one level.
pub(crate) const MAX_LEAF_DEPTH: u8 = 3;

const COMPRESSION_NONE: u8 = 1;
const COMPRESSION_GZIP: u8 = 2;

/// A tile, or a leaf directory.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct DirectoryEntry {
    /// Number of the first tile, see [`tile_number`].
    pub(crate) number: u64,
    /// Position in the file.
    pub(crate) offset: u64,
    pub(crate) length: u32,
    /// How many tiles in a row have these bytes; 0 for a leaf directory.
    pub(crate) run: u32,
}

impl DirectoryEntry {
    pub(crate) fn is_leaf(&self) -> bool {
        self.run == 0
    }

    /// Number after the last tile of the run.
    pub(crate) fn end(&self) -> u64 {
        self.number + u64::from(self.run)
    }

    pub(crate) fn bytes(&self) -> Range<u64> {
        self.offset..self.offset + u64::from(self.length)
    }
}

/// The entry of a sorted list that has tile `number`: the tile itself, or the leaf directory to look in.
pub(crate) fn find(entries: &[DirectoryEntry], number: u64) -> Option<&DirectoryEntry> {
    let after = entries.partition_point(|entry| entry.number <= number);
    let entry = entries.get(after.checked_sub(1)?)?;
    (entry.is_leaf() || number < entry.end()).then_some(entry)
}

/// What the directories of one archive may still unpack to.
#[derive(Debug)]
pub(crate) struct DirectoryBudget {
    /// The limit that errors name.
    limit: u64,
    entries: u64,
}

impl DirectoryBudget {
    pub(crate) fn of_one() -> Self {
        Self { limit: MAX_DIRECTORY_ENTRIES, entries: MAX_DIRECTORY_ENTRIES }
    }

    /// For all directories of an archive of `length` bytes. Tiles have at least one byte, so more entries than bytes are
    /// an attempt to exhaust the memory.
    pub(crate) fn of_archive(length: u64) -> Self {
        let limit = MAX_TILES.min(length);
        Self { limit, entries: limit }
    }

    fn take(&mut self, entries: u64) -> Result<(), ArchiveError> {
        self.entries = self.entries.checked_sub(entries).ok_or(ArchiveError::TooMany(self.limit))?;
        Ok(())
    }
}

/// Where the sections of an archive are. All lie inside the file if its length is known.
#[derive(Debug, Clone)]
pub(crate) struct ArchiveHeader {
    pub(crate) root: Range<u64>,
    pub(crate) leaves: Range<u64>,
    pub(crate) data: Range<u64>,
    /// See [`crate::mark`].
    pub(crate) mark: [u8; 8],
    is_gzip: bool,
}

impl ArchiveHeader {
    /// Reads the header from the first [`HEADER_BYTES`] of a file of `length` bytes.
    pub(crate) fn read(first: &[u8], length: Option<u64>) -> Result<Self, ArchiveError> {
        let length = length.unwrap_or(u64::MAX);
        let magic = &b"PMTiles\x03"[..];
        if !first.starts_with(&magic[..magic.len().min(first.len())]) || first.is_empty() {
            return Err(ArchiveError::Magic);
        }
        let truncated = |section, end| ArchiveError::Truncated { section, end, length };
        let header: &[u8; HEADER_BYTES as usize] =
            first.first_chunk().ok_or_else(|| truncated("the header", HEADER_BYTES))?;
        if header[98] != COMPRESSION_NONE {
            return Err(ArchiveError::Compression("tiles"));
        }
        if ![COMPRESSION_NONE, COMPRESSION_GZIP].contains(&header[97]) {
            return Err(ArchiveError::Compression("directories"));
        }
        let section = |at: usize, name| {
            let number = |at: usize| header[at..at + 8].iter().rev().fold(0u64, |n, b| n << 8 | u64::from(*b));
            let start = number(at);
            match start.checked_add(number(at + 8)) {
                Some(end) if end <= length => Ok(start..end),
                end => Err(truncated(name, end.unwrap_or(u64::MAX))),
            }
        };
        let (root, leaves) = (section(8, "the root directory")?, section(40, "the section of leaf directories")?);
        if root.end - root.start > MAX_PACKED_BYTES || leaves.end - leaves.start > MAX_LEAVES_BYTES {
            return Err(ArchiveError::Directory("a directory is too long"));
        }
        let (data, is_gzip) = (section(56, "the tile data")?, header[97] == COMPRESSION_GZIP);
        let mut mark = [0; 8];
        mark.copy_from_slice(&header[MARK_AT]);
        Ok(Self { root, leaves, data, mark, is_gzip })
    }

    /// Unpacks a directory. Its entries are sorted, do not overlap, and lie inside their sections.
    pub(crate) fn unpack(
        &self,
        packed: &[u8],
        budget: &mut DirectoryBudget,
    ) -> Result<Vec<DirectoryEntry>, ArchiveError> {
        if !self.is_gzip {
            return self.parse(packed, budget);
        }
        let limit = (budget.entries.min(MAX_DIRECTORY_ENTRIES) + 1) * MAX_ENTRY_BYTES;
        let raw = unpack_gzip(packed, limit);
        self.parse(&raw.ok_or(ArchiveError::Directory("it cannot be unpacked, or is too long"))?, budget)
    }

    fn parse(&self, mut bytes: &[u8], budget: &mut DirectoryBudget) -> Result<Vec<DirectoryEntry>, ArchiveError> {
        let bad = ArchiveError::Directory;
        let count = varint(&mut bytes)?;
        // Each of the four fields of an entry has at least a byte.
        if count > bytes.len() as u64 / 4 {
            return Err(bad("it announces more entries than it has"));
        }
        if count > MAX_DIRECTORY_ENTRIES {
            return Err(ArchiveError::TooMany(MAX_DIRECTORY_ENTRIES));
        }
        budget.take(count)?;
        let mut entries = vec![DirectoryEntry::default(); count as usize];
        let mut number = 0u64;
        for entry in &mut entries {
            number = number.checked_add(varint(&mut bytes)?).ok_or(bad("a number is too large"))?;
            entry.number = number;
        }
        for entry in &mut entries {
            entry.run = varint32(&mut bytes)?;
        }
        for entry in &mut entries {
            entry.length = varint32(&mut bytes)?;
        }
        let mut follows = None;
        for entry in &mut entries {
            entry.offset = match varint(&mut bytes)?.checked_sub(1) {
                Some(offset) => offset,
                None => follows.ok_or(bad("the first tile has no offset"))?,
            };
            follows = entry.offset.checked_add(u64::from(entry.length));
        }
        if !bytes.is_empty() {
            return Err(bad("it goes on after its last entry"));
        }
        let mut after = 0;
        for entry in &mut entries {
            self.check(entry, after)?;
            after = entry.end().max(entry.number + 1);
        }
        Ok(entries)
    }

    /// Makes the offset of an entry absolute. `after` is the first number that the entries before it leave free.
    fn check(&self, entry: &mut DirectoryEntry, after: u64) -> Result<(), ArchiveError> {
        let bad = |what| Err(ArchiveError::Directory(what));
        if entry.length == 0 {
            return bad("a tile is empty");
        }
        if entry.number < after {
            return bad("its tiles are not in order");
        }
        let end = entry.number.checked_add(u64::from(entry.run.max(1)));
        if end.is_none_or(|end| end > first_number(MAX_LEVEL + 1)) {
            return bad("a tile lies below the deepest level");
        }
        let (section, most, too_long, outside) = if entry.is_leaf() {
            let outside = "a leaf directory lies outside its section";
            (&self.leaves, MAX_PACKED_BYTES, "a leaf directory is too long", outside)
        } else {
            let outside = "a tile lies outside the tile data";
            (&self.data, MAX_TILE_BYTES as u64, "a tile is longer than any tile may be", outside)
        };
        if u64::from(entry.length) > most {
            return bad(too_long);
        }
        let start = section.start.checked_add(entry.offset);
        let end = start.and_then(|start| start.checked_add(u64::from(entry.length)));
        match (start, end) {
            (Some(start), Some(end)) if end <= section.end => entry.offset = start,
            _ => return bad(outside),
        }
        Ok(())
    }
}

/// The content of a gzip file (RFC 1952) with less than `limit` bytes; `None` if it is none, or is longer. `flate2`'s own reader has tables
/// for the checksum that are a fortieth of what browsers download.
fn unpack_gzip(packed: &[u8], limit: u64) -> Option<Vec<u8>> {
    let (header, mut rest) = packed.split_first_chunk::<10>()?;
    let &[0x1f, 0x8b, 8, flags, ..] = header else { return None };
    // Flags of the parts of a header: other fields, the name of the file, a comment, a checksum.
    if flags & 4 != 0 {
        let (length, more) = rest.split_first_chunk()?;
        rest = more.get(usize::from(u16::from_le_bytes(*length))..)?;
    }
    for _ in [8, 16].into_iter().filter(|flag| flags & flag != 0) {
        rest = rest.get(rest.iter().position(|byte| *byte == 0)? + 1..)?;
    }
    if flags & 2 != 0 {
        rest = rest.get(2..)?;
    }
    let (mut raw, mut decoder) = (Vec::new(), flate2::bufread::DeflateDecoder::new(rest));
    decoder.by_ref().take(limit).read_to_end(&mut raw).ok()?;
    let (sum, rest) = decoder.into_inner().split_first_chunk()?;
    let is_whole = [*sum, *rest.first_chunk()?].map(u32::from_le_bytes) == [checksum(&raw), raw.len() as u32];
    ((raw.len() as u64) < limit && is_whole).then_some(raw)
}

fn varint(bytes: &mut &[u8]) -> Result<u64, ArchiveError> {
    let mut value = 0u64;
    for shift in (0..64).step_by(7) {
        let (&byte, rest) = bytes.split_first().ok_or(ArchiveError::Directory("it ends too early"))?;
        *bytes = rest;
        let bits = u64::from(byte & 0x7f);
        if bits << shift >> shift != bits {
            break;
        }
        value |= bits << shift;
        if byte < 0x80 {
            return Ok(value);
        }
    }
    Err(ArchiveError::Directory("a number is too large"))
}

fn varint32(bytes: &mut &[u8]) -> Result<u32, ArchiveError> {
    u32::try_from(varint(bytes)?).map_err(|_| ArchiveError::Directory("a number is too large"))
}

/// Position of a tile in PMTiles' order: level by level, each along a Hilbert curve.
pub(crate) fn tile_number(id: TileId) -> u64 {
    match id.level() {
        0 => 0,
        level => first_number(level) + fast_hilbert::xy2h(id.x(), id.y(), level),
    }
}

/// The inverse of [`tile_number`]. `None` below the deepest level, which directories never name.
pub(crate) fn tile_id(number: u64) -> Option<TileId> {
    let level = u8::try_from(number.checked_mul(3)?.checked_add(1)?.ilog2() / 2).ok()?;
    let (x, y) = if level == 0 { (0, 0) } else { fast_hilbert::h2xy(number - first_number(level), level) };
    TileId::new(level, x, y)
}

/// Number of the first tile of a level: how many tiles the levels above have.
const fn first_number(level: u8) -> u64 {
    ((1 << (2 * level)) - 1) / 3
}

#[cfg(test)]
mod tests;
