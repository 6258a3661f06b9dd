//! Values of columns as attributes: members of structs as `outer.inner`, items of lists as `name.0`.

use super::metadata::GeoColumn;
use arrow_array::cast::AsArray;
use arrow_array::types::{
    ArrowPrimitiveType, Date32Type, Decimal32Type, Decimal64Type, Decimal128Type, Float16Type, Float32Type,
    Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, TimestampMicrosecondType, TimestampMillisecondType,
    TimestampNanosecondType, TimestampSecondType, UInt8Type, UInt16Type, UInt32Type, UInt64Type,
};
use arrow_array::{
    Array, ArrayRef, BinaryArray, BooleanArray, ListArray, MapArray, PrimitiveArray, StringArray, StructArray,
};
use arrow_schema::{DataType, Field, Schema, TimeUnit};
use insula_source::attributes::{AttributeValue, Attributes, MAX_ATTRIBUTES};

/// Values nested deeper are left out.
const MAX_DEPTH: u32 = 8;
const SECONDS_OF_DAY: i64 = 86_400;
/// Beginning of the names of columns that pandas adds for itself.
const PANDAS_INDEX: &str = "__index_level_";

/// Numbers of the top-level columns that are read: all but boxes of the features, the index of pandas, and columns that are not read.
pub(super) fn wanted(schema: &Schema, geo: &GeoColumn) -> Vec<usize> {
    let fields = schema.fields().iter().enumerate();
    let is_wanted = |field: &Field| *field.name() == geo.name || has_values(field, geo) && is_read(field.data_type());
    fields.filter(|(_, field)| is_wanted(field)).map(|(index, _)| index).collect()
}

/// Names of the columns that tell something of the features, but are of types that are not read.
pub(super) fn unread(schema: &Schema, geo: &GeoColumn) -> Vec<String> {
    let is_lost = |field: &Field| *field.name() != geo.name && has_values(field, geo) && !is_read(field.data_type());
    schema.fields().iter().filter(|field| is_lost(field)).map(|field| field.name().clone()).collect()
}

/// Whether a column is neither of boxes nor an index.
fn has_values(field: &Field, geo: &GeoColumn) -> bool {
    let boxes = geo.covering.as_ref().and_then(|paths| paths[0].split('.').next());
    Some(field.name().as_str()) != boxes && !field.name().starts_with(PANDAS_INDEX)
}

/// Whether [`ColumnValues`] reads values of a type.
fn is_read(kind: &DataType) -> bool {
    match kind {
        DataType::Boolean | DataType::Utf8 | DataType::Binary | DataType::Date32 | DataType::Timestamp(..) => true,
        // All are missing.
        DataType::Null => true,
        DataType::Struct(members) => members.iter().any(|member| is_read(member.data_type())),
        DataType::List(item) => is_read(item.data_type()),
        DataType::Map(entries, _) => match entries.data_type() {
            DataType::Struct(pair) => {
                let kinds: Vec<&DataType> = pair.iter().map(|member| member.data_type()).collect();
                matches!(kinds[..], [DataType::Utf8, value] if is_read(value))
            }
            _ => false,
        },
        DataType::Decimal256(..) => false,
        kind => kind.is_numeric(),
    }
}

/// A column of a batch of rows.
pub(super) struct ColumnValues<'a> {
    array: &'a ArrayRef,
    values: Values<'a>,
}

enum Values<'a> {
    Bool(&'a BooleanArray),
    Text(&'a StringArray),
    /// Texts of writers that do not say so, or other bytes.
    Bytes(&'a BinaryArray),
    /// Numbers and dates, by their own type.
    Primitive(Box<dyn Fn(usize) -> Option<AttributeValue> + 'a>),
    Struct(Vec<(&'a str, ColumnValues<'a>)>),
    List(&'a ListArray, Box<ColumnValues<'a>>),
    /// Keys that are texts, and values.
    Map(&'a MapArray, &'a StringArray, Box<ColumnValues<'a>>),
    /// Times of day and the like.
    Unused,
}

impl<'a> ColumnValues<'a> {
    pub(super) fn of(array: &'a ArrayRef) -> Self {
        let values = match array.data_type() {
            DataType::Boolean => Values::Bool(array.as_boolean()),
            DataType::Utf8 => Values::Text(array.as_string()),
            DataType::Binary => Values::Bytes(array.as_binary()),
            DataType::Struct(_) => Values::Struct(members(array.as_struct())),
            DataType::List(_) => {
                let list = array.as_list::<i32>();
                Values::List(list, Box::new(Self::of(list.values())))
            }
            DataType::Map(..) => {
                let map = array.as_map();
                match map.keys().as_string_opt::<i32>() {
                    Some(keys) => Values::Map(map, keys, Box::new(Self::of(map.values()))),
                    None => Values::Unused,
                }
            }
            kind => primitive(kind, array).map_or(Values::Unused, Values::Primitive),
        };
        Self { array, values }
    }

    pub(super) fn push(&self, row: usize, name: &str, attributes: &mut Attributes, depth: u32) {
        if depth > MAX_DEPTH || attributes.len() >= MAX_ATTRIBUTES || row >= self.array.len() || self.array.is_null(row)
        {
            return;
        }
        match &self.values {
            Values::Bool(array) => attributes.push(name, AttributeValue::Bool(array.value(row))),
            Values::Text(array) if array.value(row).is_empty() => {}
            Values::Text(array) => attributes.push(name, AttributeValue::Text(array.value(row).to_owned())),
            Values::Bytes(array) => {
                let text = std::str::from_utf8(array.value(row)).ok();
                // Geometries and images have zeros and ones.
                let is_text = |text: &&str| !text.is_empty() && !text.contains(|c: char| c < ' ' && !c.is_whitespace());
                if let Some(text) = text.filter(is_text) {
                    attributes.push(name, AttributeValue::Text(text.to_owned()));
                }
            }
            Values::Primitive(value) => {
                if let Some(value) = value(row) {
                    attributes.push(name, value);
                }
            }
            Values::Struct(members) => {
                for (member, values) in members {
                    values.push(row, &format!("{name}.{member}"), attributes, depth + 1);
                }
            }
            Values::List(list, items) => {
                for (number, item) in range(list.value_offsets(), row).take(MAX_ATTRIBUTES).enumerate() {
                    items.push(item, &format!("{name}.{number}"), attributes, depth + 1);
                }
            }
            Values::Map(map, keys, values) => {
                for item in range(map.value_offsets(), row).take(MAX_ATTRIBUTES).filter(|item| *item < keys.len()) {
                    values.push(item, &format!("{name}.{}", keys.value(item)), attributes, depth + 1);
                }
            }
            Values::Unused => {}
        }
    }
}

fn members(array: &StructArray) -> Vec<(&str, ColumnValues<'_>)> {
    let names = array.fields().iter().map(|field| field.name().as_str());
    names.zip(array.columns().iter().map(ColumnValues::of)).collect()
}

/// The items of a row of a list.
fn range(offsets: &[i32], row: usize) -> std::ops::Range<usize> {
    let at = |index: usize| offsets.get(index).and_then(|offset| usize::try_from(*offset).ok()).unwrap_or(0);
    at(row)..at(row + 1)
}

type PrimitiveValue<'a> = Box<dyn Fn(usize) -> Option<AttributeValue> + 'a>;

/// Values of a number or date; `None` for other types.
fn primitive<'a>(kind: &DataType, array: &'a ArrayRef) -> Option<PrimitiveValue<'a>> {
    use AttributeValue::{Float, Integer};
    Some(match kind {
        DataType::Int8 => by::<Int8Type>(array, |value| Some(Integer(value.into()))),
        DataType::Int16 => by::<Int16Type>(array, |value| Some(Integer(value.into()))),
        DataType::Int32 => by::<Int32Type>(array, |value| Some(Integer(value.into()))),
        DataType::Int64 => by::<Int64Type>(array, |value| Some(Integer(value))),
        DataType::UInt8 => by::<UInt8Type>(array, |value| Some(Integer(value.into()))),
        DataType::UInt16 => by::<UInt16Type>(array, |value| Some(Integer(value.into()))),
        DataType::UInt32 => by::<UInt32Type>(array, |value| Some(Integer(value.into()))),
        DataType::UInt64 => by::<UInt64Type>(array, |value| Some(AttributeValue::unsigned(value))),
        DataType::Float16 => by::<Float16Type>(array, |value| Some(Float(value.to_f64()))),
        DataType::Float32 => by::<Float32Type>(array, |value| Some(AttributeValue::single(value))),
        DataType::Float64 => by::<Float64Type>(array, |value| Some(Float(value))),
        DataType::Date32 => by::<Date32Type>(array, |value| AttributeValue::date_of_days(value.into())),
        DataType::Timestamp(unit, _) => timestamp(*unit, array),
        DataType::Decimal32(_, scale) => decimal::<Decimal32Type>(array, *scale, f64::from),
        DataType::Decimal64(_, scale) => decimal::<Decimal64Type>(array, *scale, |value| value as f64),
        DataType::Decimal128(_, scale) => decimal::<Decimal128Type>(array, *scale, |value| value as f64),
        _ => return None,
    })
}

fn by<'a, T: ArrowPrimitiveType>(
    array: &'a ArrayRef,
    value: impl Fn(T::Native) -> Option<AttributeValue> + 'a,
) -> PrimitiveValue<'a> {
    let array: Option<&PrimitiveArray<T>> = array.as_primitive_opt();
    Box::new(move |row| array.filter(|array| row < array.len()).and_then(|array| value(array.value(row))))
}

fn timestamp(unit: TimeUnit, array: &ArrayRef) -> PrimitiveValue<'_> {
    let date = |units: i64| move |value: i64| AttributeValue::date_of_days(value.div_euclid(units * SECONDS_OF_DAY));
    match unit {
        TimeUnit::Second => by::<TimestampSecondType>(array, date(1)),
        TimeUnit::Millisecond => by::<TimestampMillisecondType>(array, date(1_000)),
        TimeUnit::Microsecond => by::<TimestampMicrosecondType>(array, date(1_000_000)),
        TimeUnit::Nanosecond => by::<TimestampNanosecondType>(array, date(1_000_000_000)),
    }
}

fn decimal<T: ArrowPrimitiveType>(array: &ArrayRef, scale: i8, number: fn(T::Native) -> f64) -> PrimitiveValue<'_> {
    let unit = 10_f64.powi(scale.into());
    by::<T>(array, move |value| Some(AttributeValue::Float(number(value) / unit)))
}
