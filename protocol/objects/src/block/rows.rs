//! Sets of rows of a block.

use super::BLOCK_OBJECTS;
use insula_protocol::DecodeError;
use insula_protocol::codec::byte_reader::ByteReader;

const WORDS: usize = BLOCK_OBJECTS / 64;

/// Which rows of a block have a value.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct RowSet([u64; WORDS]);

impl RowSet {
    pub(super) fn insert(&mut self, row: usize) {
        if let Some(word) = self.0.get_mut(row / 64) {
            *word |= 1 << (row % 64);
        }
    }

    pub(super) fn contains(&self, row: usize) -> bool {
        self.0.get(row / 64).is_some_and(|word| word >> (row % 64) & 1 == 1)
    }

    /// Number of rows of the set below `row`, if the set has it: the index of its value.
    pub(super) fn rank(&self, row: usize) -> Option<usize> {
        let word = *self.0.get(row / 64)?;
        let before: u32 = self.0.iter().take(row / 64).map(|word| word.count_ones()).sum();
        let below = word & ((1 << (row % 64)) - 1);
        self.contains(row).then_some((before + below.count_ones()) as usize)
    }

    pub(super) fn rows(&self) -> Vec<u16> {
        (0..BLOCK_OBJECTS as u16).filter(|row| self.contains(usize::from(*row))).collect()
    }

    /// Whether the set has all of `count` rows and no others.
    fn is_all(&self, count: usize) -> bool {
        *self == (0..count).collect()
    }
}

impl FromIterator<usize> for RowSet {
    fn from_iter<I: IntoIterator<Item = usize>>(rows: I) -> Self {
        let mut set = Self::default();
        rows.into_iter().for_each(|row| set.insert(row));
        set
    }
}

/// The row sets of a block so far: most columns have the same as an earlier one.
#[derive(Debug)]
pub(super) struct RowSets {
    known: Vec<RowSet>,
    count: usize,
}

/// Codes of a row set: all rows, a new set as bits, or from here on an earlier new set.
const ALL: u8 = 0;
const NEW: u8 = 1;
const KNOWN: u8 = 2;
/// Maximum number of sets to which a code can refer.
const MAX_KNOWN: usize = (u8::MAX - KNOWN) as usize;

impl RowSets {
    pub(super) fn new(count: usize) -> Self {
        Self { known: Vec::new(), count }
    }

    pub(super) fn encode(&mut self, out: &mut Vec<u8>, set: RowSet) {
        if set.is_all(self.count) {
            out.push(ALL);
        } else if let Some(at) = self.known.iter().position(|known| *known == set) {
            out.push(KNOWN + at as u8);
        } else {
            out.push(NEW);
            let bytes = set.0.iter().flat_map(|word| word.to_le_bytes());
            out.extend(bytes.take(self.count.div_ceil(8)));
            self.add(set);
        }
    }

    pub(super) fn decode(&mut self, reader: &mut ByteReader<'_>) -> Result<RowSet, DecodeError> {
        match reader.u8()? {
            ALL => Ok((0..self.count).collect()),
            NEW => {
                let bytes = reader.take(self.count.div_ceil(8))?;
                let is_set = |bit: &usize| bytes.get(bit / 8).is_some_and(|byte| byte >> (bit % 8) & 1 == 1);
                if (self.count..8 * bytes.len()).any(|bit| is_set(&bit)) {
                    return Err(DecodeError::Invalid("a column has values beyond the last object"));
                }
                let set = (0..self.count).filter(is_set).collect();
                self.add(set);
                Ok(set)
            }
            code => {
                let known = self.known.get(usize::from(code - KNOWN));
                known.copied().ok_or(DecodeError::Invalid("a column refers to the rows of one that does not exist"))
            }
        }
    }

    fn add(&mut self, set: RowSet) {
        if self.known.len() < MAX_KNOWN {
            self.known.push(set);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_round_trip_and_repetitions_take_one_byte() {
        let sets: [RowSet; 5] = [
            (0..100).collect(),
            [3, 64, 99].into_iter().collect(),
            RowSet::default(),
            [99].into_iter().collect(),
            (0..99).collect(),
        ];
        let mut bytes = Vec::new();
        let mut encoder = RowSets::new(100);
        sets.iter().chain(&sets).for_each(|set| encoder.encode(&mut bytes, *set));
        assert_eq!(bytes.len(), 1 + 4 * 14 + 5);
        let mut reader = ByteReader::new(&bytes);
        let mut decoder = RowSets::new(100);
        for set in sets.iter().chain(&sets) {
            assert_eq!(decoder.decode(&mut reader).unwrap(), *set);
        }
        reader.finish().unwrap();
        assert_eq!([3, 64, 99, 4, 5000].map(|row| sets[1].rank(row)), [Some(0), Some(1), Some(2), None, None]);
        assert_eq!(sets[1].rows(), [3, 64, 99]);
    }

    #[test]
    fn sets_beyond_the_last_row_and_unknown_sets_are_refused() {
        assert!(RowSets::new(3).decode(&mut ByteReader::new(&[NEW, 0b1000])).is_err());
        assert!(RowSets::new(3).decode(&mut ByteReader::new(&[NEW, 0b0100])).is_ok());
        assert!(RowSets::new(3).decode(&mut ByteReader::new(&[KNOWN])).is_err());
    }
}
