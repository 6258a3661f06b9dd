//! Coding of a column of integers: differences to something known, then as few bits or bytes as possible.
//!
//! Every column becomes integers in the end, see `columns`. A coded column has a header byte, the smallest difference, the width
//! of the others above it, and these as bits, or as byte planes (all low bytes, then all second bytes, ...), which zstd compresses
//! better if values repeat.

use super::BLOCK_OBJECTS;
use super::cost::{self, Cost, bits};
use insula_protocol::codec::byte_reader::ByteReader;
use insula_protocol::codec::varint::{push64, unzigzag64, zigzag64};
use insula_protocol::error::{DecodeError, invalid_if};
use std::collections::{BTreeSet, VecDeque};

/// Number of earlier columns to which a column can refer.
const MAX_HISTORY: usize = 64;
const HEADER: Cost = bits(24);
/// Cost of each byte before compression, because zstd comes close to the entropy of columns only. Measured with 3DBAG.
const RAW_BYTE: Cost = bits(1) / 2;

/// What differences are to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Transform {
    /// Zero.
    Plain = 0,
    Previous = 1,
    /// The same row of an earlier column.
    Earlier = 2,
    /// The values are indices of a sorted list of distinct values.
    Dictionary = 3,
}

/// Bit of a header byte: byte planes instead of packed bits.
const PLANES: u8 = 4;

/// Coded bytes with their estimated cost after compression.
#[derive(Debug, Clone)]
pub(super) struct Coded {
    pub(super) bytes: Vec<u8>,
    pub(super) cost: Cost,
}

/// The latest columns of a block, for columns that repeat or almost repeat another one. Encoder and decoder keep the same.
#[derive(Debug)]
pub(super) struct History {
    /// One value for each row of the block, latest first.
    columns: VecDeque<Vec<i64>>,
    rows: usize,
}

impl History {
    /// The history of a block of `rows` objects.
    pub(super) fn new(rows: usize) -> Self {
        Self { columns: VecDeque::new(), rows }
    }

    /// Adds a column of the values of some rows, in ascending order. Other rows repeat the row before.
    pub(super) fn push(&mut self, rows: &[u16], values: &[i64]) {
        let mut dense = Vec::with_capacity(self.rows);
        let mut known = 0;
        for (row, value) in rows.iter().zip(values) {
            dense.resize(usize::from(*row).min(self.rows), known);
            known = *value;
        }
        dense.resize(self.rows, known);
        self.columns.push_front(dense);
        self.columns.truncate(MAX_HISTORY);
    }

    /// The values at `rows` of the column that was added `distance` columns ago, 1 for the latest.
    fn values(&self, distance: usize, rows: &[u16]) -> Option<Vec<i64>> {
        let column = self.columns.get(distance.checked_sub(1)?)?;
        rows.iter().map(|row| column.get(usize::from(*row)).copied()).collect()
    }
}

/// Encodes at most [`BLOCK_OBJECTS`] values. `rows` are those of the values, if they belong to rows.
pub(super) fn encode(values: &[i64], rows: Option<&[u16]>, history: &History) -> Coded {
    let mut best = encode_differences(Transform::Plain, &[], values);
    let mut consider = |candidate: Coded| {
        if candidate.cost < best.cost {
            best = candidate;
        }
    };
    consider(encode_differences(Transform::Previous, &[], &differences_to_previous(values)));
    for distance in 1..=history.columns.len() {
        if let Some(earlier) = rows.and_then(|rows| history.values(distance, rows)) {
            let differences: Vec<i64> = values.iter().zip(&earlier).map(|(a, b)| a.wrapping_sub(*b)).collect();
            consider(encode_differences(Transform::Earlier, &[distance as u8], &differences));
        }
    }
    let distinct: Vec<i64> = values.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
    if distinct.len() > 1 && distinct.len() <= values.len() / 2 {
        let mut head = Vec::new();
        push64(&mut head, distinct.len() as u64);
        let list = encode_differences(Transform::Previous, &[], &differences_to_previous(&distinct));
        head.extend_from_slice(&list.bytes);
        let index = |value: &i64| distinct.binary_search(value).unwrap_or_default() as i64;
        let indices: Vec<i64> = values.iter().map(index).collect();
        let coded = encode_differences(Transform::Dictionary, &head, &indices);
        consider(Coded { cost: coded.cost + list.cost, ..coded });
    }
    best
}

fn differences_to_previous(values: &[i64]) -> Vec<i64> {
    let mut previous = 0;
    values.iter().map(|value| value.wrapping_sub(std::mem::replace(&mut previous, *value))).collect()
}

/// Encodes differences behind a header byte and `head`.
fn encode_differences(transform: Transform, head: &[u8], differences: &[i64]) -> Coded {
    // The first value of a sequence is far from zero, others are not: it is kept apart.
    let is_sequence = transform == Transform::Previous;
    let (first, rest) =
        if is_sequence { differences.split_at(differences.len().min(1)) } else { (&[][..], differences) };
    let base = rest.iter().copied().min().unwrap_or(0);
    let offset = |value: &i64| value.wrapping_sub(base) as u64;
    let max = rest.iter().map(offset).max().unwrap_or(0);
    let width = 64 - max.leading_zeros();
    let planes = width.div_ceil(8);
    let plane = |plane: u32| rest.iter().map(move |value| (offset(value) >> (8 * plane)) as u8);
    let raw = |bytes: usize| bytes as u64 * RAW_BYTE;
    let mut best_cost = (0..planes).map(|i| cost::of_plane(plane(i))).sum::<Cost>() + raw(planes as usize * rest.len());
    let mut best = None;
    // Packed bits that fill bytes evenly can still be compressed; those of the exact width are shorter.
    let even_width = width.next_power_of_two();
    for width in if even_width < 8 { [width, even_width] } else { [width; 2] } {
        let mut packed = Vec::new();
        pack(&mut packed, rest.iter().map(offset), width);
        let cost =
            bits(8 * packed.len() as u64).min(if width == even_width { cost::of_text(&packed) } else { Cost::MAX })
                + raw(packed.len());
        if cost <= best_cost {
            (best_cost, best) = (cost, Some((width, packed)));
        }
    }
    let mut bytes = vec![transform as u8 | if best.is_some() { 0 } else { PLANES }];
    bytes.extend_from_slice(head);
    first.iter().for_each(|value| push64(&mut bytes, zigzag64(*value)));
    push64(&mut bytes, zigzag64(base));
    match best {
        Some((width, packed)) => {
            bytes.push(width as u8);
            bytes.extend(packed);
        }
        None => {
            bytes.push(planes as u8);
            (0..planes).for_each(|i| bytes.extend(plane(i)));
        }
    }
    Coded { bytes, cost: HEADER + best_cost }
}

/// Appends the low `width` bits of each value, low bits first.
pub(crate) fn pack(out: &mut Vec<u8>, values: impl Iterator<Item = u64>, width: u32) {
    let (mut held, mut held_bits) = (0u128, 0);
    for value in values {
        held |= u128::from(value) << held_bits;
        held_bits += width;
        while held_bits >= 8 {
            out.push(held as u8);
            held >>= 8;
            held_bits -= 8;
        }
    }
    if held_bits > 0 {
        out.push(held as u8);
    }
}

/// Decodes `count` values, at most [`BLOCK_OBJECTS`]. The inverse of [`encode`] with the same rows and history.
pub(super) fn decode(
    reader: &mut ByteReader<'_>,
    count: usize,
    rows: Option<&[u16]>,
    history: &History,
) -> Result<Vec<i64>, DecodeError> {
    let header = reader.u8()?;
    let is_packed = header & PLANES == 0;
    match header & !PLANES {
        0 => decode_offsets(reader, count, is_packed),
        1 => decode_sequence(reader, count, is_packed),
        2 => {
            let distance = usize::from(reader.u8()?);
            let earlier = rows.and_then(|rows| history.values(distance, rows));
            let earlier = earlier.ok_or(DecodeError::Invalid("a column refers to one that does not exist"))?;
            let mut values = decode_offsets(reader, count, is_packed)?;
            values.iter_mut().zip(&earlier).for_each(|(value, earlier)| *value = value.wrapping_add(*earlier));
            Ok(values)
        }
        3 => {
            let distinct = reader.count("the number of distinct numbers", BLOCK_OBJECTS)?;
            let list = match reader.u8()? {
                kind if kind & !PLANES == 1 => decode_sequence(reader, distinct, kind & PLANES == 0)?,
                _ => return Err(DecodeError::Invalid("the distinct numbers of a column are not a sequence")),
            };
            let lookup = |index: i64| usize::try_from(index).ok().and_then(|index| list.get(index)).copied();
            let values = decode_offsets(reader, count, is_packed)?.into_iter().map(lookup).collect::<Option<_>>();
            values.ok_or(DecodeError::Invalid("an index is outside of a column's distinct numbers"))
        }
        _ => Err(DecodeError::Invalid("a column of numbers has an unknown coding")),
    }
}

fn decode_sequence(reader: &mut ByteReader<'_>, count: usize, is_packed: bool) -> Result<Vec<i64>, DecodeError> {
    if count == 0 {
        return decode_offsets(reader, 0, is_packed);
    }
    let mut value = unzigzag64(reader.varint64()?);
    let mut values = vec![value];
    for difference in decode_offsets(reader, count - 1, is_packed)? {
        value = value.wrapping_add(difference);
        values.push(value);
    }
    Ok(values)
}

/// Decodes the smallest value, the width and `count` offsets above the smallest value.
fn decode_offsets(reader: &mut ByteReader<'_>, count: usize, is_packed: bool) -> Result<Vec<i64>, DecodeError> {
    let base = unzigzag64(reader.varint64()?);
    let width = usize::from(reader.u8()?);
    invalid_if(width > if is_packed { 64 } else { 8 }, "a number is wider than 64 bits")?;
    let mut values = vec![base; count];
    if is_packed {
        let packed = reader.take((width * count).div_ceil(8))?;
        let mut bytes = packed.iter();
        let (mut held, mut held_bits) = (0u128, 0);
        let mask = if width == 64 { u64::MAX } else { (1 << width) - 1 };
        for value in &mut values {
            while held_bits < width {
                held |= u128::from(bytes.next().copied().unwrap_or(0)) << held_bits;
                held_bits += 8;
            }
            *value = value.wrapping_add((held as u64 & mask) as i64);
            held >>= width;
            held_bits -= width;
        }
    } else {
        for plane in 0..width {
            for (value, byte) in values.iter_mut().zip(reader.take(count)?) {
                *value = value.wrapping_add((u64::from(*byte) << (8 * plane)) as i64);
            }
        }
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round_trip(values: &[i64], rows: Option<&[u16]>, history: &History) -> usize {
        let coded = encode(values, rows, history);
        let mut reader = ByteReader::new(&coded.bytes);
        assert_eq!(decode(&mut reader, values.len(), rows, history).unwrap(), values);
        reader.finish().unwrap();
        for length in 0..coded.bytes.len() {
            assert!(decode(&mut ByteReader::new(&coded.bytes[..length]), values.len(), rows, history).is_err());
        }
        coded.bytes.len()
    }

    #[test]
    fn columns_round_trip_in_few_bytes() {
        let history = History::new(0);
        let length = |values: &[i64]| round_trip(values, None, &history);
        assert!(length(&[]) <= 3);
        assert!(length(&[i64::MIN; 500]) <= 16);
        assert!(length(&(0..512).map(|i| 1_000_000 + 3 * i).collect::<Vec<_>>()) <= 12);
        assert!(length(&(0..512).map(|i| 1_000_000 + i * i % 8).collect::<Vec<_>>()) <= 520);
        assert!(length(&(0..512).map(|i| [1, 1 << 40][i % 2]).collect::<Vec<_>>()) <= 520);
        length(&[i64::MIN, i64::MAX, 0, -1, i64::MAX, i64::MIN]);
        length(&(0..512).map(|i: i64| i.wrapping_mul(0x9e37_79b9_7f4a_7c15_u64 as i64)).collect::<Vec<_>>());
    }

    #[test]
    fn a_column_that_repeats_an_earlier_one_costs_nothing() {
        let mut history = History::new(300);
        let rows: Vec<u16> = (0..300).filter(|row| row % 3 != 1).collect();
        let noise = |row: &u16| i64::from(*row).wrapping_mul(0x9e37_79b9_7f4a_7c15_u64 as i64);
        let values: Vec<i64> = rows.iter().map(noise).collect();
        assert!(round_trip(&values, Some(&rows), &history) > 1600);
        history.push(&rows, &values);
        history.push(&[0], &[5]);
        assert!(round_trip(&values, Some(&rows), &history) < 8);
        assert_eq!(history.values(1, &[299]), Some(vec![5]));
        assert_eq!(history.values(2, &[1]), Some(vec![values[0]]));
        assert_eq!((history.values(0, &[1]), history.values(3, &[1]), history.values(1, &[300])), (None, None, None));
    }

    #[test]
    fn damaged_columns_are_refused() {
        let history = History::new(4);
        let refused = |bytes: &[u8]| decode(&mut ByteReader::new(bytes), 4, Some(&[0, 1, 2, 3]), &history).is_err();
        // Unknown coding, missing earlier column, widths of 65 bits and 9 bytes, too many distinct numbers, index 3 of 1.
        let damaged: [&[u8]; 6] =
            [&[8, 0, 0], &[2, 1, 0, 0], &[0, 0, 65], &[4, 0, 9], &[3, 0x81, 4, 1, 0], &[3, 1, 1, 0, 0, 0, 6, 0]];
        assert!(damaged.into_iter().all(refused));
        assert!(!refused(&[0, 0, 0]));
    }
}
