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

use std::ops::Range;

use insula_protocol::codec::checksum;

use super::table::BLOCK;
use super::{MAX_ENTRIES, SearchError};

const MAGIC: [u8; 4] = *b"INSX";
const VERSION: u16 = 1;
const HEADER: usize = 24;

/// The contents of an index, before they are bytes.
pub(super) struct Sections {
    pub(super) objects: Vec<u32>,
    /// Start of each block in `texts`.
    pub(super) blocks: Vec<u64>,
    pub(super) texts: Vec<u8>,
    pub(super) dictionary: Vec<u8>,
    pub(super) lists: Vec<u8>,
}

impl Sections {
    /// The index as bytes. Fails if a section has 4 GiB or more.
    pub(super) fn encode(&self) -> Result<Vec<u8>, SearchError> {
        let length = |section: &[u8]| {
            u32::try_from(section.len()).map_err(|_| SearchError::Limit {
                what: "bytes of a section",
                found: section.len() as u64,
                limit: u64::from(u32::MAX),
            })
        };
        let lengths = [length(&self.texts)?, length(&self.dictionary)?, length(&self.lists)?];
        let bits = u32::BITS - self.objects.iter().max().map_or(u32::BITS, |max| max.leading_zeros());
        let mut out = Vec::new();
        out.extend_from_slice(&MAGIC);
        out.extend_from_slice(&VERSION.to_le_bytes());
        out.extend_from_slice(&[bits as u8, 0]);
        out.extend_from_slice(&(self.objects.len() as u32).to_le_bytes());
        lengths.iter().for_each(|length| out.extend_from_slice(&length.to_le_bytes()));
        self.blocks.iter().for_each(|at| out.extend_from_slice(&(*at as u32).to_le_bytes()));
        push_packed(&mut out, &self.objects, bits);
        out.extend_from_slice(&self.texts);
        out.extend_from_slice(&self.dictionary);
        out.extend_from_slice(&self.lists);
        out.extend_from_slice(&checksum(&out).to_le_bytes());
        Ok(out)
    }
}

fn push_packed(out: &mut Vec<u8>, numbers: &[u32], bits: u32) {
    let (mut pending, mut filled) = (0u64, 0);
    for number in numbers {
        pending |= u64::from(*number) << filled;
        filled += bits;
        while filled >= 8 {
            out.push(pending as u8);
            pending >>= 8;
            filled -= 8;
        }
    }
    if filled > 0 {
        out.push(pending as u8);
    }
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
                (0..100u32).map(|i| i.wrapping_mul(0x9e37_79b9).checked_rem(max).unwrap_or(0)).collect();
            let objects = [&objects[..], &[max]].concat();
            let sections = Sections {
                objects: objects.clone(),
                blocks: vec![0, 0],
                texts: Vec::new(),
                dictionary: Vec::new(),
                lists: Vec::new(),
            };
            let bytes = sections.encode().unwrap();
            let layout = Layout::decode(&bytes).unwrap();
            for (entry, object) in objects.iter().enumerate() {
                assert_eq!(layout.object(&bytes, entry as u32), *object);
            }
        }
    }
}
