//! A PMTiles v3 header and its directories, flattened into one sorted index.
//!
//! In: an archive's first bytes and its directories, which anyone may have made. Out: [`Entry`]s, each proven to lie inside
//! the file.
//! Next: `archive` looks tiles up in them.
//!
//! The `pmtiles` crate keeps an entry's offset to itself and decodes a leaf directory at each look-up (118 us a tile), so
//! the format's few lines are read here once: <https://github.com/protomaps/PMTiles/blob/main/spec/v3/spec.md>.

use super::ArchiveError;
use insula_protocol::tile_id::MAX_LEVEL;
use std::{io::Read, ops::Range};

pub(super) const HEADER_BYTES: usize = 127;
/// Most entries in one archive: 24 bytes each, 1.6 GB of index. Equal tiles in a row are one entry.
const MAX_ENTRIES: usize = 1 << 26;
/// Most bytes of packed directories: what is read of them into memory.
const MAX_PACKED_BYTES: u64 = 512 << 20;
/// Largest unpacked directory.
const MAX_DIRECTORY_BYTES: u64 = 256 << 20;
/// Leaf directories below leaf directories; writers make one level.
const MAX_DEPTH: u8 = 3;

const COMPRESSION_NONE: u8 = 1;
const COMPRESSION_GZIP: u8 = 2;

/// One tile: `id` is its place on the pyramid of Hilbert curves, and it stands for the `run - 1` places after it as well.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) id: u64,
    pub(super) offset: u64,
    pub(super) length: u32,
    pub(super) run: u32,
}

impl Entry {
    /// The place after its last one; `read` has checked that there is one.
    pub(super) fn end(&self) -> u64 {
        self.id + u64::from(self.run)
    }

    /// Its place in the file.
    pub(super) fn bytes(&self) -> Range<u64> {
        self.offset..self.offset + u64::from(self.length)
    }
}

/// Where an archive's sections lie; all of them inside the file.
pub(super) struct Header {
    pub(super) root: Range<u64>,
    pub(super) leaves: Range<u64>,
    data: Range<u64>,
    gzip: bool,
}

/// All tiles of an archive, by ascending id. `root` and `leaves` are the sections that the header names.
pub(super) fn read(header: &Header, root: &[u8], leaves: &[u8]) -> Result<Vec<Entry>, ArchiveError> {
    let mut entries = Vec::new();
    flatten(header, root, leaves, 0, &mut entries)?;
    // A run is a few bytes however long it is: what goes through all tiles must end.
    let tiles: u64 = entries.iter().map(|entry| u64::from(entry.run)).sum();
    if tiles > MAX_ENTRIES as u64 { Err(ArchiveError::TooMany(MAX_ENTRIES)) } else { Ok(entries) }
}

impl Header {
    /// From the first [`HEADER_BYTES`] of a file of `found` bytes, or all of a shorter one.
    pub(super) fn read(first: &[u8], found: u64) -> Result<Self, ArchiveError> {
        let magic = &b"PMTiles\x03"[..];
        if !first.starts_with(&magic[..magic.len().min(first.len())]) || first.is_empty() {
            return Err(ArchiveError::Magic);
        }
        let header: &[u8; HEADER_BYTES] = first.first_chunk().ok_or(ArchiveError::Truncated {
            what: "the header",
            wanted: HEADER_BYTES as u64,
            found,
        })?;
        if header[98] != COMPRESSION_NONE {
            return Err(ArchiveError::Compression("tiles"));
        }
        if ![COMPRESSION_NONE, COMPRESSION_GZIP].contains(&header[97]) {
            return Err(ArchiveError::Compression("directories"));
        }
        let section = |at: usize, what| -> Result<Range<u64>, ArchiveError> {
            let number = |at: usize| header[at..at + 8].iter().rev().fold(0, |n, b| n << 8 | u64::from(*b));
            let (start, length) = (number(at), number(at + 8));
            let wanted = start.saturating_add(length);
            if wanted > found { Err(ArchiveError::Truncated { what, wanted, found }) } else { Ok(start..wanted) }
        };
        let directory = |at, what| match section(at, what)? {
            range if range.end - range.start > MAX_PACKED_BYTES => Err(ArchiveError::TooMany(MAX_ENTRIES)),
            range => Ok(range),
        };
        Ok(Self {
            root: directory(8, "the root directory")?,
            leaves: directory(40, "the leaf directories")?,
            data: section(56, "the tile data")?,
            gzip: header[97] == COMPRESSION_GZIP,
        })
    }
}

/// Appends what a packed directory lists; leaf directories in their order, so that ids keep ascending.
fn flatten(header: &Header, packed: &[u8], leaves: &[u8], depth: u8, out: &mut Vec<Entry>) -> Result<(), ArchiveError> {
    for raw in Directory::unpack(packed, header.gzip)?.entries {
        if raw.run_length == 0 {
            if depth >= MAX_DEPTH {
                return Err(ArchiveError::Directory("leaf directories are nested too deeply"));
            }
            let outside = "a leaf directory lies outside its section";
            let section = 0..leaves.len() as u64;
            let leaf = inside(&section, raw.offset, raw.length, outside)?;
            flatten(header, &leaves[leaf.start as usize..leaf.end as usize], leaves, depth + 1, out)?;
            continue;
        }
        let data = inside(&header.data, raw.offset, raw.length, "a tile lies outside the tile data")?;
        if out.last().is_some_and(|last| last.end() > raw.id) {
            return Err(ArchiveError::Directory("its tiles are not in order"));
        }
        let end = raw.id.checked_add(u64::from(raw.run_length));
        if end.is_none_or(|end| end > pmtiles::PYRAMID_SIZE_BY_ZOOM[usize::from(MAX_LEVEL) + 1]) {
            return Err(ArchiveError::Directory("a tile lies below the deepest level"));
        }
        if out.len() >= MAX_ENTRIES {
            return Err(ArchiveError::TooMany(MAX_ENTRIES));
        }
        out.push(Entry { id: raw.id, offset: data.start, length: raw.length, run: raw.run_length });
    }
    Ok(())
}

fn inside(section: &Range<u64>, offset: u64, length: u32, what: &'static str) -> Result<Range<u64>, ArchiveError> {
    let start = section.start.checked_add(offset);
    let end = start.and_then(|start| start.checked_add(u64::from(length)));
    match (start, end) {
        (Some(start), Some(end)) if end <= section.end => Ok(start..end),
        _ => Err(ArchiveError::Directory(what)),
    }
}

#[derive(Clone, Copy, Default)]
struct RawEntry {
    id: u64,
    offset: u64,
    length: u32,
    run_length: u32,
}

struct Directory {
    entries: Vec<RawEntry>,
}

impl Directory {
    fn unpack(packed: &[u8], gzip: bool) -> Result<Self, ArchiveError> {
        if !gzip {
            return Self::read(packed);
        }
        let mut raw = Vec::new();
        let limit = MAX_DIRECTORY_BYTES + 1;
        let read = flate2::read::GzDecoder::new(packed).take(limit).read_to_end(&mut raw);
        if read.is_err() || raw.len() as u64 == limit {
            return Err(ArchiveError::Directory("it cannot be unpacked"));
        }
        Self::read(&raw)
    }

    fn read(mut bytes: &[u8]) -> Result<Self, ArchiveError> {
        let bad = ArchiveError::Directory;
        let count = varint(&mut bytes)?;
        // Four fields of at least a byte each: what is allocated is bounded by what is there.
        if count > bytes.len() as u64 / 4 {
            return Err(bad("it announces more entries than it has"));
        }
        let mut entries = vec![RawEntry::default(); count as usize];
        let mut id = 0u64;
        for entry in &mut entries {
            id = id.checked_add(varint(&mut bytes)?).ok_or(bad("a number is too large"))?;
            entry.id = id;
        }
        for entry in &mut entries {
            entry.run_length = varint32(&mut bytes)?;
        }
        for entry in &mut entries {
            entry.length = varint32(&mut bytes)?;
            if entry.length == 0 {
                return Err(bad("a tile is empty"));
            }
        }
        let mut follows = None;
        for entry in &mut entries {
            entry.offset = match varint(&mut bytes)?.checked_sub(1) {
                Some(offset) => offset,
                None => follows.ok_or(bad("the first tile has no offset"))?,
            };
            follows = entry.offset.checked_add(u64::from(entry.length));
        }
        if bytes.is_empty() { Ok(Self { entries }) } else { Err(bad("it goes on after its last entry")) }
    }
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
