//! Lists of the entries that contain a token, as runs of consecutive entries.
//!
//! Entries are in order of their texts, so a street of 100 houses is one run. A list is the number of its entries, and per
//! run the distance from the end of the run before it, doubled, plus one if a second number follows: the length minus two.

use insula_protocol::codec::varint;

/// A list of runs that grows in order of entries.
#[derive(Debug, Default)]
pub(super) struct ListBuilder {
    bytes: Vec<u8>,
    entries: u32,
    /// End of the last run in `bytes`.
    written: u32,
    start: u32,
    length: u32,
}

impl ListBuilder {
    /// Adds a run of entries, which must begin at or behind the end of the one before.
    pub(super) fn push(&mut self, start: u32, length: u32) {
        if self.length > 0 && start == self.start + self.length {
            self.length += length;
            return;
        }
        self.write_run();
        (self.start, self.length) = (start, length);
    }

    fn write_run(&mut self) {
        if self.length == 0 {
            return;
        }
        let distance = self.start - self.written;
        varint::push(&mut self.bytes, distance << 1 | u32::from(self.length > 1));
        if self.length > 1 {
            varint::push(&mut self.bytes, self.length - 2);
        }
        self.entries += self.length;
        self.written = self.start + self.length;
    }

    /// Appends the list to `out`.
    pub(super) fn finish(mut self, out: &mut Vec<u8>) {
        self.write_run();
        varint::push(out, self.entries);
        out.extend_from_slice(&self.bytes);
    }
}

/// Reads a varint of at most 32 bits from the start of `bytes`. `None` if there is none.
pub(super) fn read_varint(bytes: &mut &[u8]) -> Option<u32> {
    let mut value = 0;
    for shift in [0, 7, 14, 21, 28] {
        let (byte, rest) = bytes.split_first()?;
        *bytes = rest;
        value |= u32::from(byte & 0x7f) << shift;
        if *byte < 0x80 {
            return Some(value);
        }
    }
    None
}

/// A set of entries, one bit each.
#[derive(Debug, Clone)]
pub(super) struct EntrySet {
    words: Vec<u64>,
    entries: u32,
}

impl EntrySet {
    /// An empty set of numbers below `entries`.
    pub(super) fn new(entries: u32) -> Self {
        Self { words: vec![0; entries.div_ceil(64) as usize], entries }
    }

    /// Adds the entries of all lists in `bytes`. Stops without an error where the bytes are not lists.
    pub(super) fn insert_lists(&mut self, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            if self.insert_list(&mut bytes).is_none() {
                return;
            }
        }
    }

    fn insert_list(&mut self, bytes: &mut &[u8]) -> Option<()> {
        let mut end = 0u32;
        let mut left = read_varint(bytes)?;
        // Each run takes a byte at least, so a false number of entries ends with the bytes.
        while left > 0 {
            let code = read_varint(bytes)?;
            let start = end.checked_add(code >> 1)?;
            let length = if code & 1 == 1 { read_varint(bytes)?.checked_add(2)? } else { 1 };
            end = start.checked_add(length)?;
            if end > self.entries {
                return None;
            }
            left = left.checked_sub(length)?;
            self.insert_run(start, end);
        }
        Some(())
    }

    /// Adds `start..end`. Requires `start < end <= entries`.
    fn insert_run(&mut self, start: u32, end: u32) {
        let (first, last) = ((start / 64) as usize, ((end - 1) / 64) as usize);
        let (head, tail) = (u64::MAX << (start % 64), u64::MAX >> (63 - (end - 1) % 64));
        if first == last {
            self.words[first] |= head & tail;
        } else {
            self.words[first] |= head;
            self.words[first + 1..last].fill(u64::MAX);
            self.words[last] |= tail;
        }
    }

    pub(super) fn len(&self) -> usize {
        self.words.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// Keeps what `other` has as well.
    pub(super) fn intersect(&mut self, other: &Self) {
        for (word, other) in self.words.iter_mut().zip(&other.words) {
            *word &= other;
        }
    }

    /// Adds what `a` and `b` both have.
    pub(super) fn unite_both(&mut self, a: &Self, b: &Self) {
        for (word, (a, b)) in self.words.iter_mut().zip(a.words.iter().zip(&b.words)) {
            *word |= a & b;
        }
    }

    /// The entries of `range` in ascending order. The ends of the range must be multiples of 64, or the last entry.
    pub(super) fn iter(&self, range: std::ops::Range<u32>) -> impl Iterator<Item = u32> + '_ {
        let first = range.start / 64;
        let words = self.words.get(first as usize..range.end.div_ceil(64) as usize).unwrap_or_default();
        words.iter().zip(first..).filter(|(word, _)| **word != 0).flat_map(|(word, at)| {
            let mut rest = *word;
            std::iter::from_fn(move || {
                let bit = rest.trailing_zeros();
                rest &= rest.wrapping_sub(1);
                (bit < 64).then_some(at * 64 + bit)
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_round_trip() {
        let lists: [&[u32]; 4] = [&[0], &[0, 1, 2, 3, 4, 63, 64, 65, 200], &[7, 9], &[100, 101, 102, 319]];
        let (mut bytes, mut wanted) = (Vec::new(), Vec::new());
        for list in lists {
            let mut builder = ListBuilder::default();
            list.iter().for_each(|entry| builder.push(*entry, 1));
            builder.finish(&mut bytes);
            wanted.extend_from_slice(list);
        }
        wanted.sort_unstable();
        wanted.dedup();
        let mut runs = ListBuilder::default();
        [(0, 3), (3, 2), (63, 3), (200, 1)].into_iter().for_each(|(start, length)| runs.push(start, length));
        let (mut whole, mut single) = (Vec::new(), ListBuilder::default());
        runs.finish(&mut whole);
        lists[1].iter().for_each(|entry| single.push(*entry, 1));
        let mut entries = Vec::new();
        single.finish(&mut entries);
        assert_eq!(whole, entries);
        let mut set = EntrySet::new(320);
        set.insert_lists(&bytes);
        assert_eq!(set.iter(0..320).collect::<Vec<_>>(), wanted);
        assert_eq!(set.iter(64..128).collect::<Vec<_>>(), [64, 65, 100, 101, 102]);
        // A list ends before a run that goes beyond the last entry.
        let mut set = EntrySet::new(64);
        set.insert_lists(&bytes);
        assert_eq!(set.iter(0..64).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
    }

    #[test]
    fn false_lists_end() {
        for bytes in [&[0xff; 9][..], &[0xff, 0xff, 0xff, 0xff, 0x0f, 1], &[2, 1], &[0x80]] {
            EntrySet::new(1000).insert_lists(bytes);
        }
    }
}
