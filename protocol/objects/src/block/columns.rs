//! Columns of a block: the values of one attribute, in the order of the rows that have it.

use super::floats;
use super::numbers::{self, History};
use super::rows::RowSet;
use super::text_list::{self, Context, TextBudget, TextList};
use crate::value::{ValueRef, ValueType};
use insula_protocol::DecodeError;
use insula_protocol::codec::byte_reader::ByteReader;
use insula_protocol::codec::varint::push64;
use std::collections::BTreeMap;

/// Codings of texts: a text for each row, or distinct texts and the index of each row's.
const TEXT_PER_ROW: u8 = 0;
const DISTINCT_TEXTS: u8 = 1;

#[derive(Debug, Clone)]
pub(super) struct AttributeColumn {
    /// Index in the schema.
    pub(super) attribute: u32,
    pub(super) rows: RowSet,
    pub(super) values: Values,
}

#[derive(Debug, Clone)]
pub(super) enum Values {
    Text { list: TextList, indices: Vec<u16> },
    Integer(Vec<i64>),
    Float(Vec<f64>),
    Bool(Vec<bool>),
    Date(Vec<i32>),
}

impl AttributeColumn {
    pub(super) fn value(&self, row: usize) -> Option<ValueRef<'_>> {
        let at = self.rows.rank(row)?;
        match &self.values {
            Values::Text { list, indices } => list.get(usize::from(*indices.get(at)?)).map(ValueRef::Text),
            Values::Integer(values) => values.get(at).copied().map(ValueRef::Integer),
            Values::Float(values) => values.get(at).copied().map(ValueRef::Float),
            Values::Bool(values) => values.get(at).copied().map(ValueRef::Bool),
            Values::Date(values) => values.get(at).copied().map(ValueRef::Date),
        }
    }
}

const WRONG_TYPE: DecodeError = DecodeError::Invalid("a value has another type than its attribute");

/// Appends a column of values, one for each of `rows`. Fails if a value has another type than `value_type`, and on floats that are
/// not finite.
pub(super) fn encode(
    out: &mut Vec<u8>,
    value_type: ValueType,
    rows: &[u16],
    values: &[ValueRef<'_>],
    identifiers: &TextList,
    history: &mut History,
) -> Result<(), DecodeError> {
    if values.iter().any(|value| value.type_of() != value_type) {
        return Err(WRONG_TYPE);
    }
    let (mut texts, mut floats, mut integers) = (Vec::new(), Vec::new(), Vec::new());
    for value in values {
        match *value {
            ValueRef::Text(text) => texts.push(text),
            ValueRef::Float(value) if value.is_finite() => floats.push(value),
            ValueRef::Float(_) => return Err(DecodeError::Invalid("a number is not finite")),
            ValueRef::Integer(value) => integers.push(value),
            ValueRef::Bool(value) => integers.push(i64::from(value)),
            ValueRef::Date(days) => integers.push(i64::from(days)),
        }
    }
    match value_type {
        ValueType::Text => encode_texts(out, rows, &texts, identifiers, history),
        ValueType::Float => floats::encode(out, rows, &floats, history),
        ValueType::Integer | ValueType::Bool | ValueType::Date => {
            out.extend_from_slice(&numbers::encode(&integers, Some(rows), history).bytes);
            history.push(rows, &integers);
        }
    }
    Ok(())
}

/// Decodes the values of a column. The inverse of [`encode`].
pub(super) fn decode(
    reader: &mut ByteReader<'_>,
    value_type: ValueType,
    rows: &[u16],
    identifiers: &TextList,
    history: &mut History,
    budget: &mut TextBudget,
) -> Result<Values, DecodeError> {
    if value_type == ValueType::Text {
        return decode_texts(reader, rows, identifiers, history, budget);
    }
    if value_type == ValueType::Float {
        return floats::decode(reader, rows, history).map(Values::Float);
    }
    let integers = numbers::decode(reader, rows.len(), Some(rows), history)?;
    history.push(rows, &integers);
    let values = match value_type {
        ValueType::Bool => {
            let bool = |value| if (0..=1).contains(&value) { Some(value == 1) } else { None };
            integers.into_iter().map(bool).collect::<Option<_>>().map(Values::Bool)
        }
        ValueType::Date => {
            integers.into_iter().map(|value| i32::try_from(value).ok()).collect::<Option<_>>().map(Values::Date)
        }
        ValueType::Integer | ValueType::Float | ValueType::Text => Some(Values::Integer(integers)),
    };
    values.ok_or(DecodeError::Invalid("a value is not one of its attribute's type"))
}

fn encode_texts(out: &mut Vec<u8>, rows: &[u16], texts: &[&str], identifiers: &TextList, history: &mut History) {
    let context = Context { history, rows: Some(rows), identifiers: Some(identifiers) };
    let (per_row, runs) = text_list::encode(texts, context);
    // Indices by first use. A first use is 0, another one is the index + 1: the decoder knows the index of a first use.
    let mut known = BTreeMap::new();
    let mut distinct = Vec::new();
    let mut indices = Vec::with_capacity(texts.len());
    for text in texts {
        let index = known.get(text).map_or(0, |index| index + 1);
        if index == 0 {
            known.insert(*text, distinct.len() as i64);
            distinct.push(*text);
        }
        indices.push(index);
    }
    let (list, _) = text_list::encode(&distinct, Context { rows: None, ..context });
    let coded = numbers::encode(&indices, Some(rows), history);
    if distinct.len() < texts.len() && list.cost + coded.cost < per_row.cost {
        out.push(DISTINCT_TEXTS);
        push64(out, distinct.len() as u64);
        out.extend_from_slice(&list.bytes);
        out.extend_from_slice(&coded.bytes);
        history.push(rows, &indices);
    } else {
        out.push(TEXT_PER_ROW);
        out.extend_from_slice(&per_row.bytes);
        runs.iter().for_each(|(rows, values)| history.push(rows, values));
    }
}

fn decode_texts(
    reader: &mut ByteReader<'_>,
    rows: &[u16],
    identifiers: &TextList,
    history: &mut History,
    budget: &mut TextBudget,
) -> Result<Values, DecodeError> {
    let context = Context { history, rows: Some(rows), identifiers: Some(identifiers) };
    match reader.u8()? {
        TEXT_PER_ROW => {
            let (list, runs) = text_list::decode(reader, rows.len(), context, budget)?;
            runs.iter().for_each(|(rows, values)| history.push(rows, values));
            Ok(Values::Text { list, indices: (0..rows.len() as u16).collect() })
        }
        DISTINCT_TEXTS => {
            let count = reader.count("the number of distinct texts", rows.len())?;
            let (list, _) = text_list::decode(reader, count, Context { rows: None, ..context }, budget)?;
            let coded = numbers::decode(reader, rows.len(), Some(rows), history)?;
            let mut used = 0;
            let index = |value: &i64| {
                used += i64::from(*value == 0);
                let index = if *value == 0 { used - 1 } else { value - 1 };
                (0..used).contains(&index).then_some(index as u16)
            };
            let indices = coded.iter().map(index).collect::<Option<_>>();
            let indices =
                indices.filter(|_| used == count as i64).ok_or(DecodeError::Invalid("a value has no text"))?;
            history.push(rows, &coded);
            Ok(Values::Text { list, indices })
        }
        _ => Err(DecodeError::Invalid("a column of texts has an unknown coding")),
    }
}
