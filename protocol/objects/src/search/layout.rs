//! The bytes of an index.
//!
//! All numbers are little-endian. The sections follow the header of 24 bytes in this order, without gaps:
//!
//! | Part | Bytes | What |
//! |---|---|---|
//! | magic | 4 | `INSX` |
//! | version | 2 | 1 |
//! | object bits | 1 | bits of an object's number, 0 to 32 |
//! | reserved | 1 | 0 |
//! | entries | 4 | pairs of a text and an object |
//! | lengths | 3 x 4 | bytes of the texts, the dictionary and the lists |
//! | blocks | 4 per 64 entries | start of each block in the texts |
//! | objects | bits x entries | numbers of the objects, low bits first, rounded up to bytes |
//! | texts | | see `table` |
//! | dictionary | | see `words` |
//! | lists | | see `postings` |
//! | checksum | 4 | CRC-32 of everything before it |

use super::table::BLOCK;
use super::{MAX_ENTRIES, SearchError, SearchWriteError};
use crate::block::numbers::pack;
use insula_protocol::codec::{checksum, extend_checksum};
use std::io::{self, Read, Write};
use std::ops::Range;

const MAGIC: [u8; 4] = *b"INSX";
const VERSION: u16 = 1;
const HEADER: usize = 24;

/// The contents of an index, before they are bytes.
pub(super) struct Sections<'a> {
    /// Pairs of a text and an object.
    pub(super) entries: u32,
    /// The largest number of an object; 0 without any.
    pub(super) max_object: u32,
    /// The number of the object of each entry, 4 bytes.
    pub(super) objects: &'a mut dyn Read,
    /// Start of each block in `texts`.
    pub(super) blocks: &'a [u64],
    pub(super) texts: Section<'a>,
    pub(super) dictionary: Section<'a>,
    pub(super) lists: Section<'a>,
}

pub(super) struct Section<'a> {
    pub(super) bytes: &'a mut dyn Read,
    pub(super) length: u64,
}

impl Section<'_> {
    fn checked_length(&self) -> Result<u32, SearchError> {
        let too_long =
            SearchError::Limit { what: "bytes of a section", found: self.length, limit: u64::from(u32::MAX) };
        u32::try_from(self.length).map_err(|_| too_long)
    }

    fn write(self, out: &mut ChecksumWriter<'_>) -> io::Result<()> {
        let copied = io::copy(&mut self.bytes.take(self.length), out)?;
        if copied == self.length { Ok(()) } else { Err(io::ErrorKind::UnexpectedEof.into()) }
    }
}

impl Sections<'_> {
    fn object_bits(&self) -> u32 {
        if self.entries == 0 { 0 } else { u32::BITS - self.max_object.leading_zeros() }
    }

    pub(super) fn size_bytes(&self) -> u64 {
        let objects = (u64::from(self.entries) * u64::from(self.object_bits())).div_ceil(8);
        let sections = self.texts.length + self.dictionary.length + self.lists.length;
        HEADER as u64 + 4 * self.blocks.len() as u64 + objects + sections + 4
    }

    /// Writes the index. Fails if a section has 4 GiB or more, or as reading or writing does.
    pub(super) fn write(self, out: &mut dyn Write) -> Result<(), SearchWriteError> {
        let lengths = [&self.texts, &self.dictionary, &self.lists].map(Section::checked_length);
        let bits = self.object_bits();
        let mut out = ChecksumWriter { out, checksum: 0 };
        out.write_all(&MAGIC)?;
        out.write_all(&VERSION.to_le_bytes())?;
        out.write_all(&[bits as u8, 0])?;
        out.write_all(&self.entries.to_le_bytes())?;
        for length in lengths {
            out.write_all(&length?.to_le_bytes())?;
        }
        for start in self.blocks {
            out.write_all(&(*start as u32).to_le_bytes())?;
        }
        write_packed(&mut out, self.objects, self.entries, bits)?;
        self.texts.write(&mut out)?;
        self.dictionary.write(&mut out)?;
        self.lists.write(&mut out)?;
        let checksum = out.checksum;
        Ok(out.write_all(&checksum.to_le_bytes())?)
    }
}

/// Passes bytes on, and has their checksum.
struct ChecksumWriter<'a> {
    out: &'a mut dyn Write,
    checksum: u32,
}

impl Write for ChecksumWriter<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.checksum = extend_checksum(self.checksum, bytes.get(..written).unwrap_or(bytes));
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// Writes `count` numbers, of 4 bytes each in `numbers`, with `bits` bits each.
fn write_packed(out: &mut impl Write, numbers: &mut dyn Read, count: u32, bits: u32) -> io::Result<()> {
    /// Numbers that are packed at once: their bits are whole bytes.
    const BATCH: usize = 1 << 13;
    let (mut left, mut packed) = (count as usize, Vec::new());
    while left > 0 {
        let mut batch = vec![0; 4 * left.min(BATCH)];
        numbers.read_exact(&mut batch)?;
        let values = batch.as_chunks::<4>().0.iter().map(|number| u64::from(u32::from_le_bytes(*number)));
        pack(&mut packed, values, bits);
        out.write_all(&packed)?;
        packed.clear();
        left -= batch.len() / 4;
    }
    Ok(())
}

/// Where the sections of an index are.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    pub(super) entries: u32,
    object_bits: u8,
    pub(super) blocks: Range<usize>,
    objects: Range<usize>,
    pub(super) texts: Range<usize>,
    pub(super) dictionary: Range<usize>,
    pub(super) lists: Range<usize>,
}

impl Layout {
    /// Checks the header, the lengths and the checksum. All ranges of the result are in `bytes`.
    pub(super) fn decode(bytes: &[u8]) -> Result<Self, SearchError> {
        let truncated = |wanted: u64| SearchError::Length { wanted, found: bytes.len() as u64 };
        let header: &[u8; HEADER] = bytes.first_chunk().ok_or(truncated(HEADER as u64))?;
        if !header.starts_with(&MAGIC) {
            return Err(SearchError::Magic);
        }
        let version = u16::from_le_bytes([header[4], header[5]]);
        if version != VERSION {
            return Err(SearchError::Version { found: version, known: VERSION });
        }
        let number = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
        let (object_bits, entries) = (header[6], number(8));
        if object_bits > 32 || header[7] != 0 {
            return Err(SearchError::Invalid("the header is damaged"));
        }
        if entries > MAX_ENTRIES {
            return Err(SearchError::Limit { what: "entries", found: entries.into(), limit: MAX_ENTRIES.into() });
        }
        let lengths = [
            u64::from(entries.div_ceil(BLOCK)) * 4,
            (u64::from(entries) * u64::from(object_bits)).div_ceil(8),
            number(12).into(),
            number(16).into(),
            number(20).into(),
        ];
        let wanted = HEADER as u64 + lengths.iter().sum::<u64>() + 4;
        if wanted != bytes.len() as u64 {
            return Err(truncated(wanted));
        }
        let mut at = HEADER;
        // The lengths sum to that of a slice, so each fits.
        let [blocks, objects, texts, dictionary, lists] = lengths.map(|length| {
            at += length as usize;
            at - length as usize..at
        });
        if bytes[at..] != checksum(&bytes[..at]).to_le_bytes() {
            return Err(SearchError::Checksum);
        }
        Ok(Self { entries, object_bits, blocks, objects, texts, dictionary, lists })
    }

    /// The object of an entry. 0 if there is no such entry.
    pub(super) fn object(&self, bytes: &[u8], entry: u32) -> u32 {
        let bits = usize::from(self.object_bits);
        let first = entry as usize * bits;
        let packed = bytes.get(self.objects.clone()).and_then(|objects| objects.get(first / 8..)).unwrap_or_default();
        let number = packed.iter().take(5).rev().fold(0u64, |number, byte| number << 8 | u64::from(*byte));
        (number >> (first % 8) & ((1u64 << bits) - 1)) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_objects_round_trip() {
        for max in [0, 1, 100, 1_700_000, u32::MAX] {
            let objects: Vec<u32> =
                (0..20_000u32).map(|i| i.wrapping_mul(0x9e37_79b9).checked_rem(max).unwrap_or(0)).collect();
            let objects = [&objects[..], &[max]].concat();
            let numbers: Vec<u8> = objects.iter().flat_map(|object| object.to_le_bytes()).collect();
            let sections = Sections {
                entries: objects.len() as u32,
                max_object: objects.iter().copied().max().unwrap_or(0),
                objects: &mut &numbers[..],
                blocks: &[0; 313],
                texts: Section { bytes: &mut io::empty(), length: 0 },
                dictionary: Section { bytes: &mut io::empty(), length: 0 },
                lists: Section { bytes: &mut io::empty(), length: 0 },
            };
            let (mut bytes, size) = (Vec::new(), sections.size_bytes());
            sections.write(&mut bytes).unwrap();
            assert_eq!(bytes.len() as u64, size);
            let layout = Layout::decode(&bytes).unwrap();
            for (entry, object) in objects.iter().enumerate() {
                assert_eq!(layout.object(&bytes, entry as u32), *object);
            }
        }
    }
}
