//! Directories of an archive that shares tiles with another one ([`crate::joined`]).

use crate::directory::{DirectoryEntry, tile_number};
use flate2::Compression;
use flate2::write::GzEncoder;
use insula_protocol::TileId;
use insula_protocol::codec::varint;
use std::io::{self, Write};

/// Where the bytes of tiles begin, behind the header and the root directory of up to some million tiles.
pub const DATA_AT: u64 = 4 << 10;
const HEADER_BYTES: usize = crate::directory::HEADER_BYTES as usize;
/// Entries of a leaf directory.
const LEAF_ENTRIES: usize = 4096;
const GZIP: u8 = 2;
const NO_COMPRESSION: u8 = 1;

/// The directories of an archive in the making.
#[derive(Debug, Default)]
pub struct DirectoryWriter {
    /// The last entries, with offsets from [`DATA_AT`].
    entries: Vec<DirectoryEntry>,
    root: Vec<DirectoryEntry>,
    /// Packed leaf directories.
    leaves: Vec<u8>,
    tiles: u64,
    listed: u64,
    max_level: u8,
}

/// What an archive has before and after the bytes of its own tiles.
#[derive(Debug)]
pub struct WrittenFrame {
    /// [`DATA_AT`] bytes.
    pub head: Vec<u8>,
    pub tail: Vec<u8>,
}

impl DirectoryWriter {
    /// Adds the next tile in the order of the numbers: its bytes are at a position from [`DATA_AT`] on. Fails if a directory cannot be
    /// packed.
    pub fn add(&mut self, id: TileId, at: u64, length: u32) -> io::Result<()> {
        let (number, offset) = (tile_number(id), at.saturating_sub(DATA_AT));
        (self.tiles, self.max_level) = (self.tiles + 1, self.max_level.max(id.level()));
        if let Some(last) = self.entries.last_mut()
            && (last.end(), last.offset, last.length) == (number, offset, length)
        {
            last.run += 1;
            return Ok(());
        }
        if self.entries.len() == LEAF_ENTRIES {
            self.end_leaf()?;
        }
        self.entries.push(DirectoryEntry { number, offset, length, run: 1 });
        self.listed += 1;
        Ok(())
    }

    fn end_leaf(&mut self) -> io::Result<()> {
        let Some(first) = self.entries.first() else { return Ok(()) };
        let packed = pack(&self.entries)?;
        let (offset, length) = (self.leaves.len() as u64, packed.len() as u32);
        self.root.push(DirectoryEntry { number: first.number, offset, length, run: 0 });
        self.leaves.extend_from_slice(&packed);
        self.entries.clear();
        Ok(())
    }

    /// The rest of the file, whose own tiles end at `own_end`. `end` is that of all bytes, with those of the shared archive. Fails if a
    /// directory cannot be packed.
    pub fn finish(mut self, own_end: u64, end: u64) -> io::Result<WrittenFrame> {
        if !self.root.is_empty() {
            self.end_leaf()?;
        }
        let root = pack(if self.root.is_empty() { &self.entries } else { &self.root })?;
        let (mut head, mut tail) = (vec![0; DATA_AT as usize], self.leaves);
        let leaves_bytes = tail.len() as u64;
        let space = &mut head[HEADER_BYTES..];
        let root_at = match space.get_mut(..root.len()) {
            Some(space) => {
                space.copy_from_slice(&root);
                HEADER_BYTES as u64
            }
            None => {
                tail.extend_from_slice(&root);
                own_end + leaves_bytes
            }
        };
        head[..8].copy_from_slice(b"PMTiles\x03");
        let numbers = [
            (8, root_at),
            (16, root.len() as u64),
            (40, own_end),
            (48, leaves_bytes),
            (56, DATA_AT),
            (64, end.saturating_sub(DATA_AT)),
            (72, self.tiles),
            (80, self.listed),
        ];
        for (at, number) in numbers {
            head[at..at + 8].copy_from_slice(&number.to_le_bytes());
        }
        (head[97], head[98], head[101]) = (GZIP, NO_COMPRESSION, self.max_level);
        Ok(WrittenFrame { head, tail })
    }
}

/// A directory, packed.
fn pack(entries: &[DirectoryEntry]) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    varint::push64(&mut bytes, entries.len() as u64);
    let mut before = 0;
    for entry in entries {
        varint::push64(&mut bytes, entry.number - before);
        before = entry.number;
    }
    entries.iter().for_each(|entry| varint::push64(&mut bytes, entry.run.into()));
    entries.iter().for_each(|entry| varint::push64(&mut bytes, entry.length.into()));
    let mut follows = None;
    for entry in entries {
        varint::push64(&mut bytes, if follows == Some(entry.offset) { 0 } else { entry.offset + 1 });
        follows = Some(entry.offset + u64::from(entry.length));
    }
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(&bytes)?;
    encoder.finish()
}
