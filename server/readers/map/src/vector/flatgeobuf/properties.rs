//! Attributes: pairs of a column's number and a value of the column's type.

use ::flatgeobuf::{Column as ColumnTable, ColumnType};
use flatbuffers::{ForwardsUOffset, Vector};
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::object::ObjectSink;
use insula_source::text::expected_in_utf8;

/// Name and type of an attribute.
pub(super) struct Column {
    pub(super) name: String,
    kind: ColumnType,
}

/// The columns of a header or a feature.
pub(super) fn columns<'a>(tables: Option<Vector<'a, ForwardsUOffset<ColumnTable<'a>>>>) -> Vec<Column> {
    let column = |table: ColumnTable<'_>| Column { name: table.name().to_owned(), kind: table.type_() };
    tables.into_iter().flatten().map(column).collect()
}

/// Reads all attributes. Returns false if the bytes do not fit the columns; those read before are kept.
pub(crate) fn read(
    mut bytes: &[u8],
    columns: &[Column],
    attributes: &mut Attributes,
    sink: &mut dyn ObjectSink,
) -> bool {
    // Some writers leave one byte at the end.
    while bytes.len() > 1 {
        let Some(number) = take::<2>(&mut bytes).map(u16::from_le_bytes) else { return false };
        let Some(column) = columns.get(usize::from(number)) else { return false };
        match value(column.kind, &mut bytes, sink) {
            Some(Some(value)) => attributes.push(&column.name, value),
            Some(None) => {}
            None => return false,
        }
    }
    true
}

/// Takes a value; the inner `None` is a value that is no attribute, the outer one a damaged value.
fn value(kind: ColumnType, bytes: &mut &[u8], sink: &mut dyn ObjectSink) -> Option<Option<AttributeValue>> {
    use AttributeValue::{Bool, Float, Integer};
    Some(Some(match kind {
        ColumnType::Byte => Integer(i8::from_le_bytes(take(bytes)?).into()),
        ColumnType::UByte => Integer(u8::from_le_bytes(take(bytes)?).into()),
        ColumnType::Bool => Bool(take::<1>(bytes)? != [0]),
        ColumnType::Short => Integer(i16::from_le_bytes(take(bytes)?).into()),
        ColumnType::UShort => Integer(u16::from_le_bytes(take(bytes)?).into()),
        ColumnType::Int => Integer(i32::from_le_bytes(take(bytes)?).into()),
        ColumnType::UInt => Integer(u32::from_le_bytes(take(bytes)?).into()),
        ColumnType::Long => Integer(i64::from_le_bytes(take(bytes)?)),
        ColumnType::ULong => AttributeValue::unsigned(u64::from_le_bytes(take(bytes)?)),
        ColumnType::Float => AttributeValue::single(f32::from_le_bytes(take(bytes)?)),
        ColumnType::Double => Float(f64::from_le_bytes(take(bytes)?)),
        ColumnType::String | ColumnType::Json | ColumnType::DateTime => {
            let text = expected_in_utf8(text_bytes(bytes)?, sink);
            let date = if kind == ColumnType::DateTime { AttributeValue::date(&text) } else { None };
            return Some(date.or_else(|| (!text.is_empty()).then(|| AttributeValue::Text(text.into_owned()))));
        }
        ColumnType::Binary => {
            text_bytes(bytes)?;
            return Some(None);
        }
        _ => return None,
    }))
}

fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (taken, rest) = bytes.split_first_chunk::<N>()?;
    *bytes = rest;
    Some(*taken)
}

fn text_bytes<'a>(bytes: &mut &'a [u8]) -> Option<&'a [u8]> {
    let length = u32::from_le_bytes(take(bytes)?) as usize;
    let (text, rest) = bytes.split_at_checked(length)?;
    *bytes = rest;
    Some(text)
}
