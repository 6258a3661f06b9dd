//! The texts of the entries as they were added, in order of their folded form.
//!
//! Entries are in blocks of [`BLOCK`]. An entry replaces bytes in the middle of the text before it: in a street the house
//! numbers differ, and the town behind them does not. It is a byte, numbers as varints, and the new bytes. The byte has the
//! number of removed bytes in its upper four bits and that of new bytes in its lower three. If they are all ones, the number
//! is more, and what exceeds it follows. If the bit between is set, the number of bytes at the end that stay follows; else as
//! many stay as in the entry before. The order is: removed, new, end. Blocks start with an empty text, of which nothing stays.

use super::MAX_TEXT_BYTES;
use super::postings::read_varint;
use insula_protocol::codec::varint;

/// Entries of a block. A multiple of 64, so that a set of entries can be read by blocks.
pub(super) const BLOCK: u32 = 64;

/// The largest number of removed bytes in the first byte.
const REMOVED_MAX: usize = 15;

/// The largest number of new bytes in the first byte.
const ADDED_MAX: usize = 7;

/// The end that stays has another length.
const NEW_END: u8 = 8;

/// So many more bytes of the end must be the same before its length changes, which takes a byte or two.
const MIN_GAIN: usize = 3;

/// Writes the texts in order.
#[derive(Debug, Default)]
pub(super) struct TableBuilder {
    /// Start of each block in all bytes.
    pub(super) blocks: Vec<u64>,
    pub(super) bytes: Vec<u8>,
    /// Bytes that were before these, see [`Self::write_to`].
    written: u64,
    entries: u32,
    /// Bytes at the end that stay.
    end: usize,
}

impl TableBuilder {
    /// Moves the bytes so far to `out`. Fails as writing does.
    pub(super) fn write_to(&mut self, out: &mut impl std::io::Write) -> std::io::Result<()> {
        out.write_all(&self.bytes)?;
        self.written += self.bytes.len() as u64;
        self.bytes.clear();
        Ok(())
    }

    /// Number of all bytes so far.
    pub(super) fn length(&self) -> u64 {
        self.written + self.bytes.len() as u64
    }

    /// Appends `text`; `before` is the one added before it.
    pub(super) fn push(&mut self, before: &str, text: &str) {
        let mut before = before.as_bytes();
        if self.entries.is_multiple_of(BLOCK) {
            self.blocks.push(self.length());
            (before, self.end) = (&[], 0);
        }
        self.entries += 1;
        let text = text.as_bytes();
        let start = before.iter().zip(text).take_while(|(a, b)| a == b).count();
        let (before, text) = (&before[start..], &text[start..]);
        let same_end = before.iter().rev().zip(text.iter().rev()).take_while(|(a, b)| a == b).count();
        let is_new = same_end < self.end || same_end >= self.end + MIN_GAIN;
        if is_new {
            self.end = same_end;
        }
        let (removed, added) = (before.len() - self.end, &text[..text.len() - self.end]);
        let (removed_low, added_low) = (removed.min(REMOVED_MAX), added.len().min(ADDED_MAX));
        self.bytes.push((removed_low << 4 | added_low) as u8 | if is_new { NEW_END } else { 0 });
        if removed_low == REMOVED_MAX {
            varint::push(&mut self.bytes, (removed - REMOVED_MAX) as u32);
        }
        if added_low == ADDED_MAX {
            varint::push(&mut self.bytes, (added.len() - ADDED_MAX) as u32);
        }
        if is_new {
            varint::push(&mut self.bytes, self.end as u32);
        }
        self.bytes.extend_from_slice(added);
    }
}

/// Reads texts by entry. Reading entries in ascending order is cheaper, because a block is then decoded once.
#[derive(Debug)]
pub(super) struct TableReader<'a> {
    blocks: &'a [u8],
    bytes: &'a [u8],
    /// The entry after the one in `text`.
    next: u32,
    /// Bytes of the block from `next` on.
    rest: &'a [u8],
    /// Bytes at the end that stay.
    end: usize,
    text: Vec<u8>,
}

impl<'a> TableReader<'a> {
    /// `blocks` are the starts of blocks in `bytes`, as u32.
    pub(super) fn new(blocks: &'a [u8], bytes: &'a [u8]) -> Self {
        Self { blocks, bytes, next: 0, rest: &[], end: 0, text: Vec::new() }
    }

    /// The text of an entry. `None` if the bytes are no table, or the text is not UTF-8.
    pub(super) fn text(&mut self, entry: u32) -> Option<&str> {
        let same_block = self.next > 0 && (self.next - 1) / BLOCK == entry / BLOCK;
        if !same_block || entry < self.next - 1 {
            let at = (entry / BLOCK) as usize * 4;
            let start = u32::from_le_bytes(self.blocks.get(at..at + 4)?.try_into().ok()?);
            self.rest = self.bytes.get(start as usize..)?;
            self.text.clear();
            self.end = 0;
            self.next = entry / BLOCK * BLOCK;
        }
        while self.next <= entry {
            if self.step().is_none() {
                // Nothing after it can be read either, until another block is started.
                self.next = 0;
                return None;
            }
        }
        std::str::from_utf8(&self.text).ok()
    }

    fn step(&mut self) -> Option<()> {
        let (lead, rest) = self.rest.split_first()?;
        self.rest = rest;
        let mut more = |low: usize, max: usize| {
            if low == max { low.checked_add(read_varint(&mut self.rest)? as usize) } else { Some(low) }
        };
        let removed = more(usize::from(lead >> 4), REMOVED_MAX)?;
        let added = more(usize::from(lead & 7), ADDED_MAX)?;
        if lead & NEW_END != 0 {
            self.end = read_varint(&mut self.rest)? as usize;
        }
        let end = self.text.len().checked_sub(self.end)?;
        let start = end.checked_sub(removed)?;
        let (added, rest) = self.rest.split_at_checked(added)?;
        if self.text.len() - removed + added.len() > MAX_TEXT_BYTES {
            return None;
        }
        self.rest = rest;
        self.text.splice(start..end, added.iter().copied());
        self.next += 1;
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_round_trip_in_any_order() {
        let mut texts: Vec<String> = (0..500).map(|i| format!("Straße {i}")).collect();
        texts.extend((0..300).map(|i| format!("Straße {}, {} Köln", i % 7 * 30, i / 90)));
        texts.extend(["x".repeat(256), "x".repeat(256), "é".to_owned(), String::new()]);
        let mut builder = TableBuilder::default();
        let mut before = "";
        for text in &texts {
            builder.push(before, text);
            before = text;
        }
        let blocks: Vec<u8> = builder.blocks.iter().flat_map(|at| (*at as u32).to_le_bytes()).collect();
        let mut reader = TableReader::new(&blocks, &builder.bytes);
        for step in [1, 3, 77, 803] {
            for i in 0..texts.len() {
                let entry = i * step % texts.len();
                assert_eq!(reader.text(entry as u32), Some(texts[entry].as_str()));
            }
        }
        assert_eq!(reader.text(8192), None);
        assert_eq!(reader.text(0), Some("Straße 0"));
    }
}
