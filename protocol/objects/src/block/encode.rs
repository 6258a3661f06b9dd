//! Encoding of a block.

use super::numbers::{self, History};
use super::rows::{RowSet, RowSets};
use super::text_list::{self, Context, TextList};
use super::{
    BLOCK_OBJECTS, HEADER_BYTES, MAGIC, MAX_PAYLOAD_BYTES, ObjectBlock, ObjectBounds, ObjectRecord, VERSION, columns,
};
use crate::kind::FeatureKind;
use crate::schema::Schema;
use crate::value::{MAX_TEXT_BYTES, ValueRef};
use insula_protocol::codec::varint::push64;
use insula_protocol::codec::{checksum, zstd};
use insula_protocol::error::{DecodeError, check_limit, invalid_if};
use std::collections::BTreeMap;

/// Encodes the objects of ids from `block * BLOCK_OBJECTS`, `None` where an id is not in use. Equal input gives equal bytes.
///
/// Fails on more than [`BLOCK_OBJECTS`] records, texts over 4096 bytes, attributes that are not ascending or have another type
/// than in the schema, numbers that are not finite, inverted bounds, and more than 16 MiB of different texts. In builds for
/// WebAssembly it always fails.
pub fn encode(block: u32, records: &[Option<ObjectRecord>], schema: &Schema) -> Result<Vec<u8>, DecodeError> {
    let payload = encode_payload(block, records, schema)?;
    // The limit of the texts of a block depends on their codings.
    ObjectBlock::decode_payload(block, &payload, schema)?;
    let mut checked = block.to_le_bytes().to_vec();
    checked.extend_from_slice(&(payload.len() as u32).to_le_bytes());
    checked.extend_from_slice(&zstd::compress(&payload)?);
    let mut out = Vec::with_capacity(HEADER_BYTES + checked.len());
    out.extend_from_slice(&MAGIC);
    out.extend_from_slice(&VERSION.to_le_bytes());
    out.extend_from_slice(&checksum(&checked).to_le_bytes());
    out.extend_from_slice(&checked);
    Ok(out)
}

fn encode_payload(block: u32, records: &[Option<ObjectRecord>], schema: &Schema) -> Result<Vec<u8>, DecodeError> {
    check_limit("the number of objects of a block", records.len(), BLOCK_OBJECTS)?;
    invalid_if(first_id(block).is_none(), "the ids of a block have more than 32 bits")?;
    let in_use = || records.iter().enumerate().filter_map(|(slot, record)| Some((slot, record.as_ref()?)));
    let rows: Vec<&ObjectRecord> = in_use().map(|(_, record)| record).collect();
    check(&rows, schema)?;
    let mut out = Vec::new();
    push64(&mut out, records.len() as u64);
    RowSets::new(records.len()).encode(&mut out, in_use().map(|(slot, _)| slot).collect());

    let mut history = History::new(rows.len());
    let mut row_sets = RowSets::new(rows.len());
    let identifiers = TextList::from_texts(rows.iter().map(|record| record.identifier.as_str()));
    encode_fields(&mut out, &rows, in_use().map(|(slot, _)| slot as i64).collect(), block, &mut row_sets, &mut history);

    let mut attributes: BTreeMap<u32, (Vec<u16>, Vec<ValueRef<'_>>)> = BTreeMap::new();
    for (row, record) in rows.iter().enumerate() {
        for (attribute, value) in &record.attributes {
            let (rows, values) = attributes.entry(*attribute).or_default();
            rows.push(row as u16);
            values.push(value.borrowed());
        }
    }
    push64(&mut out, attributes.len() as u64);
    let mut next = 0;
    for (attribute, (rows, values)) in &attributes {
        let info = schema.attributes.get(*attribute as usize).ok_or(UNKNOWN_ATTRIBUTE)?;
        push64(&mut out, u64::from(attribute - next));
        next = attribute + 1;
        out.push(info.value_type as u8);
        row_sets.encode(&mut out, rows.iter().map(|row| usize::from(*row)).collect());
        columns::encode(&mut out, info.value_type, rows, values, &identifiers, &mut history)?;
    }
    check_limit("the size of a block's payload", out.len(), MAX_PAYLOAD_BYTES)?;
    Ok(out)
}

/// Kinds, identifiers, parents and bounds.
fn encode_fields(
    out: &mut Vec<u8>,
    rows: &[&ObjectRecord],
    slots: Vec<i64>,
    block: u32,
    row_sets: &mut RowSets,
    history: &mut History,
) {
    let kind = |record: &&ObjectRecord| kind_index(record.kind);
    out.extend_from_slice(&numbers::encode(&rows.iter().map(kind).collect::<Vec<_>>(), None, history).bytes);
    let all: Vec<u16> = (0..rows.len() as u16).collect();
    let identifiers: Vec<&str> = rows.iter().map(|record| record.identifier.as_str()).collect();
    let context = Context { history, rows: Some(&all), identifiers: None };
    let (coded, runs) = text_list::encode(&identifiers, context);
    out.extend_from_slice(&coded.bytes);
    runs.iter().for_each(|(rows, values)| history.push(rows, values));

    let first = i64::from(block) * BLOCK_OBJECTS as i64;
    let parents: Vec<(usize, i64)> = rows
        .iter()
        .zip(&slots)
        .enumerate()
        .filter_map(|(row, (record, slot))| Some((row, i64::from(record.parent?) - first - slot)))
        .collect();
    let set: RowSet = parents.iter().map(|(row, _)| *row).collect();
    row_sets.encode(out, set);
    let differences: Vec<i64> = parents.iter().map(|(_, difference)| *difference).collect();
    out.extend_from_slice(&numbers::encode(&differences, None, history).bytes);

    let bounds: Vec<(usize, ObjectBounds)> =
        rows.iter().enumerate().filter_map(|(row, record)| Some((row, record.bounds?))).collect();
    let set: RowSet = bounds.iter().map(|(row, _)| *row).collect();
    row_sets.encode(out, set);
    let set = set.rows();
    for axis in 0..3 {
        let lower = |(_, bounds): &(usize, ObjectBounds)| i64::from(bounds.min[axis]);
        let extent = |(_, bounds): &(usize, ObjectBounds)| i64::from(bounds.max[axis]) - i64::from(bounds.min[axis]);
        for values in [bounds.iter().map(lower).collect::<Vec<_>>(), bounds.iter().map(extent).collect()] {
            out.extend_from_slice(&numbers::encode(&values, Some(&set), history).bytes);
            history.push(&set, &values);
        }
    }
}

const UNKNOWN_ATTRIBUTE: DecodeError = DecodeError::Invalid("an object has an attribute that the schema does not have");

/// Checks what the columns do not.
fn check(rows: &[&ObjectRecord], schema: &Schema) -> Result<(), DecodeError> {
    for record in rows {
        let ObjectRecord { identifier, bounds, attributes, .. } = record;
        check_limit("the bytes of an identifier", identifier.len(), MAX_TEXT_BYTES)?;
        if bounds.is_some_and(|bounds| bounds.min.iter().zip(&bounds.max).any(|(min, max)| min > max)) {
            return Err(DecodeError::Invalid("the bounds of an object are inverted"));
        }
        if !attributes.is_sorted_by(|(before, _), (after, _)| before < after) {
            return Err(DecodeError::Invalid("the attributes of an object are not ascending"));
        }
        if attributes.last().is_some_and(|(attribute, _)| *attribute as usize >= schema.attributes.len()) {
            return Err(UNKNOWN_ATTRIBUTE);
        }
    }
    Ok(())
}

/// The id of a block's first slot. `None` if the ids of the block have more than 32 bits.
pub(super) fn first_id(block: u32) -> Option<u32> {
    let first = block.checked_mul(BLOCK_OBJECTS as u32)?;
    first.checked_add(BLOCK_OBJECTS as u32 - 1).map(|_| first)
}

fn kind_index(kind: FeatureKind) -> i64 {
    FeatureKind::NAMES.iter().position(|(_, known)| *known == kind).unwrap_or_default() as i64
}
