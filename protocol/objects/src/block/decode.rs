//! Decoding of a block. Every count and length is checked before memory is taken for it.

use super::columns::{self, AttributeColumn};
use super::encode::first_id;
use super::numbers::{self, History};
use super::rows::{RowSet, RowSets};
use super::text_list::{self, Context, TextBudget};
use super::{BLOCK_OBJECTS, MAGIC, MAX_PAYLOAD_BYTES, ObjectBlock, ObjectBounds, VERSION};
use crate::kind::FeatureKind;
use crate::schema::Schema;
use insula_protocol::codec::byte_reader::ByteReader;
use insula_protocol::codec::{checksum, zstd};
use insula_protocol::error::{DecodeError, check_limit, invalid_if};

impl ObjectBlock {
    /// Decodes block `block` of a city with this schema. Fails on any bytes that are not that block.
    pub fn decode(block: u32, bytes: &[u8], schema: &Schema) -> Result<Self, DecodeError> {
        let mut reader = ByteReader::new(bytes);
        invalid_if(reader.array()? != MAGIC, "not a block of objects: the magic bytes are missing")?;
        let version = u16::from_le_bytes(reader.array()?);
        if version != VERSION {
            return Err(DecodeError::Version { found: version, known: VERSION });
        }
        let crc32 = u32::from_le_bytes(reader.array()?);
        let checked = bytes.get(10..).unwrap_or_default();
        if checksum(checked) != crc32 {
            return Err(DecodeError::Checksum("a block of objects"));
        }
        if u32::from_le_bytes(reader.array()?) != block {
            return Err(DecodeError::Invalid("a block of objects has another number than was asked for"));
        }
        let payload_bytes = u32::from_le_bytes(reader.array()?) as usize;
        check_limit("the size of a block's payload", payload_bytes, MAX_PAYLOAD_BYTES)?;
        let payload = zstd::decompress(checked.get(8..).unwrap_or_default(), payload_bytes)?;
        Self::decode_payload(block, &payload, schema)
    }

    pub(super) fn decode_payload(block: u32, payload: &[u8], schema: &Schema) -> Result<Self, DecodeError> {
        let mut reader = ByteReader::new(payload);
        let slots = reader.count("the number of objects of a block", BLOCK_OBJECTS)?;
        let first = first_id(block).ok_or(DecodeError::Invalid("the ids of a block have more than 32 bits"))?;
        let slots = RowSets::new(slots).decode(&mut reader)?.rows();
        let ids: Vec<u32> = slots.into_iter().map(|slot| first + u32::from(slot)).collect();

        let mut history = History::new(ids.len());
        let mut row_sets = RowSets::new(ids.len());
        let mut budget = TextBudget::new();
        let kinds = decode_kinds(&mut reader, ids.len(), &history)?;
        let all: Vec<u16> = (0..ids.len() as u16).collect();
        let context = Context { history: &history, rows: Some(&all), identifiers: None };
        let (identifiers, runs) = text_list::decode(&mut reader, ids.len(), context, &mut budget)?;
        runs.iter().for_each(|(rows, values)| history.push(rows, values));
        let parents = decode_parents(&mut reader, &ids, &mut row_sets, &history)?;
        let bounds = decode_bounds(&mut reader, ids.len(), &mut row_sets, &mut history)?;

        let count = reader.count("the number of columns", schema.attributes.len())?;
        let mut columns = Vec::with_capacity(count);
        let mut next = 0usize;
        for _ in 0..count {
            let attribute = next.saturating_add(reader.count("the index of an attribute", schema.attributes.len())?);
            let info = schema.attributes.get(attribute);
            let value_type =
                info.ok_or(DecodeError::Invalid("a block has an attribute that the schema does not have"))?.value_type;
            if reader.u8()? != value_type as u8 {
                return Err(DecodeError::Invalid("an attribute has another type in a block than in the schema"));
            }
            let rows = row_sets.decode(&mut reader)?;
            let values =
                columns::decode(&mut reader, value_type, &rows.rows(), &identifiers, &mut history, &mut budget)?;
            columns.push(AttributeColumn { attribute: attribute as u32, rows, values });
            next = attribute + 1;
        }
        reader.finish()?;
        Ok(Self { ids, kinds, identifiers, parents, bounds, columns })
    }
}

fn decode_kinds(reader: &mut ByteReader<'_>, count: usize, history: &History) -> Result<Vec<FeatureKind>, DecodeError> {
    let kind =
        |index: i64| usize::try_from(index).ok().and_then(|index| FeatureKind::NAMES.get(index)).map(|(_, kind)| *kind);
    let kinds = numbers::decode(reader, count, None, history)?.into_iter().map(kind).collect::<Option<_>>();
    kinds.ok_or(DecodeError::Invalid("an object has an unknown kind"))
}

fn decode_parents(
    reader: &mut ByteReader<'_>,
    ids: &[u32],
    row_sets: &mut RowSets,
    history: &History,
) -> Result<Vec<Option<u32>>, DecodeError> {
    let set = row_sets.decode(reader)?;
    let rows = set.rows();
    let differences = numbers::decode(reader, rows.len(), None, history)?;
    let mut parents = vec![None; ids.len()];
    for (row, difference) in rows.into_iter().zip(differences) {
        let slot = parents.get_mut(usize::from(row)).zip(ids.get(usize::from(row)));
        if let Some((slot, id)) = slot {
            let parent = i64::from(*id).checked_add(difference).and_then(|parent| u32::try_from(parent).ok());
            *slot = Some(parent.ok_or(DecodeError::Invalid("the id of a parent has more than 32 bits"))?);
        }
    }
    Ok(parents)
}

fn decode_bounds(
    reader: &mut ByteReader<'_>,
    count: usize,
    row_sets: &mut RowSets,
    history: &mut History,
) -> Result<Vec<Option<ObjectBounds>>, DecodeError> {
    let set: RowSet = row_sets.decode(reader)?;
    let rows = set.rows();
    let mut boxes = vec![ObjectBounds { min: [0; 3], max: [0; 3] }; rows.len()];
    for axis in 0..3 {
        let lower = numbers::decode(reader, rows.len(), Some(&rows), history)?;
        history.push(&rows, &lower);
        let extent = numbers::decode(reader, rows.len(), Some(&rows), history)?;
        history.push(&rows, &extent);
        for ((bounds, lower), extent) in boxes.iter_mut().zip(lower).zip(extent) {
            let upper = lower.checked_add(extent).filter(|upper| *upper >= lower);
            let range = i32::try_from(lower).ok().zip(upper.and_then(|upper| i32::try_from(upper).ok()));
            let (min, max) = range.ok_or(DecodeError::Invalid("the bounds of an object are inverted or too large"))?;
            (bounds.min[axis], bounds.max[axis]) = (min, max);
        }
    }
    let mut bounds = vec![None; count];
    for (row, found) in rows.into_iter().zip(boxes) {
        if let Some(bounds) = bounds.get_mut(usize::from(row)) {
            *bounds = Some(found);
        }
    }
    Ok(bounds)
}
