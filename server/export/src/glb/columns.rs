//! Columns of property tables: their types, their values as bytes, and what stands for a missing value.

use insula_objects::{AttributeInfo, Value};
use serde_json::{Value as Json, json};

/// The enumeration of booleans that may be missing, because `BOOLEAN` has no value for that.
const TRUTH: &str = "truth";
/// Values of [`TRUTH`].
const UNKNOWN: u8 = 2;

/// A value for each row.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Column {
    Number(Vec<u32>),
    Int32(Vec<Option<i32>>),
    Float(Vec<Option<f64>>),
    Bool(Vec<bool>),
    Truth(Vec<Option<bool>>),
    Text(Vec<Option<String>>),
}

/// The bytes of a column.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Packed {
    pub(super) values: Vec<u8>,
    /// Where each text starts, and the type of these numbers.
    pub(super) offsets: Option<(Vec<u8>, &'static str)>,
}

impl Packed {
    pub(super) fn bytes(&self) -> usize {
        self.values.len() + self.offsets.as_ref().map_or(0, |(offsets, _)| offsets.len())
    }
}

impl Column {
    /// Integers in the smallest type for all values of the schema: 32 bits; floats, which are exact up to 2^53; or texts.
    pub(super) fn integers(values: &[Option<&Value>], info: &AttributeInfo) -> Self {
        const EXACT: f64 = 9_007_199_254_740_992.0;
        let numbers = || values.iter().map(|value| value.and_then(Value::as_f64));
        let range = info.min.zip(info.max);
        let is_within = |low: f64, high: f64| {
            let is_inside = |value: f64| low <= value && value <= high;
            range.is_some_and(|(min, max)| is_inside(min) && is_inside(max)) && numbers().flatten().all(is_inside)
        };
        if is_within(f64::from(i32::MIN) + 1.0, f64::from(i32::MAX)) {
            Self::Int32(numbers().map(|value| value.map(|value| value as i32)).collect())
        } else if is_within(-EXACT, EXACT) {
            Self::Float(numbers().collect())
        } else {
            Self::Text(values.iter().map(|value| value.map(Value::to_string)).collect())
        }
    }

    /// Booleans. `is_complete`: whether all objects of the city have one.
    pub(super) fn bools(values: &[Option<&Value>], is_complete: bool) -> Self {
        let bools = values.iter().map(|value| if let Some(Value::Bool(value)) = value { Some(*value) } else { None });
        if is_complete {
            Self::Bool(bools.map(Option::unwrap_or_default).collect())
        } else {
            Self::Truth(bools.collect())
        }
    }

    /// Whether no row has a value.
    pub(super) fn is_empty(&self) -> bool {
        match self {
            Self::Number(values) => values.is_empty(),
            Self::Bool(values) => values.is_empty(),
            Self::Int32(values) => values.iter().all(Option::is_none),
            Self::Float(values) => values.iter().all(Option::is_none),
            Self::Truth(values) => values.iter().all(Option::is_none),
            Self::Text(values) => values.iter().all(Option::is_none),
        }
    }

    /// Type and `noData` of the property.
    pub(super) fn class_property(&self) -> Json {
        let scalar = |component_type: &str, no_data: Json| json!({ "type": "SCALAR", "componentType": component_type, "noData": no_data });
        match self {
            Self::Number(_) => json!({ "type": "SCALAR", "componentType": "UINT32", "required": true }),
            Self::Int32(_) => scalar("INT32", json!(i32::MIN)),
            Self::Float(_) => scalar("FLOAT64", json!(f64::MIN)),
            Self::Bool(_) => json!({ "type": "BOOLEAN" }),
            Self::Truth(_) => json!({ "type": "ENUM", "enumType": TRUTH, "noData": "unknown" }),
            Self::Text(_) => json!({ "type": "STRING", "noData": "" }),
        }
    }

    /// The enumeration that the type refers to.
    pub(super) fn enumeration(&self) -> Option<(&'static str, Json)> {
        let member = |name: &str, value: u8| json!({ "name": name, "value": value });
        let members = || [member("false", 0), member("true", 1), member("unknown", UNKNOWN)];
        matches!(self, Self::Truth(_)).then(|| (TRUTH, json!({ "valueType": "UINT8", "values": members() })))
    }

    pub(super) fn pack(&self) -> Packed {
        let values = match self {
            Self::Number(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Self::Int32(values) => values.iter().flat_map(|value| value.unwrap_or(i32::MIN).to_le_bytes()).collect(),
            Self::Float(values) => values.iter().flat_map(|value| value.unwrap_or(f64::MIN).to_le_bytes()).collect(),
            Self::Truth(values) => values.iter().map(|value| value.map_or(UNKNOWN, u8::from)).collect(),
            Self::Bool(values) => bits(values),
            Self::Text(values) => return pack_texts(values),
        };
        Packed { values, offsets: None }
    }
}

/// One bit for each value, the lowest bit of a byte first.
pub(crate) fn bits(values: &[bool]) -> Vec<u8> {
    let byte = |bits: &[bool]| bits.iter().rev().fold(0, |byte, bit| byte << 1 | u8::from(*bit));
    values.chunks(8).map(byte).collect()
}

fn pack_texts(texts: &[Option<String>]) -> Packed {
    let (mut values, mut ends) = (Vec::new(), vec![0usize]);
    for text in texts {
        values.extend_from_slice(text.as_deref().unwrap_or_default().as_bytes());
        ends.push(values.len());
    }
    let narrow = |end: &usize| u16::try_from(*end).map(u16::to_le_bytes);
    let offsets = match ends.iter().map(narrow).collect::<Result<Vec<_>, _>>() {
        Ok(short) => (short.concat(), "UINT16"),
        // The whole GLB is below 4 GiB.
        Err(_) => (ends.iter().flat_map(|end| (*end as u32).to_le_bytes()).collect(), "UINT32"),
    };
    // A buffer view cannot be empty.
    if values.is_empty() {
        values.push(0);
    }
    Packed { values, offsets: Some(offsets) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_objects::ValueType;

    fn info(min: f64, max: f64) -> AttributeInfo {
        AttributeInfo {
            name: "storeys".into(),
            value_type: ValueType::Integer,
            unit: None,
            count: 2,
            min: Some(min),
            max: Some(max),
            distinct: None,
            top: Vec::new(),
        }
    }

    #[test]
    fn integers_take_the_smallest_type_for_the_whole_city() {
        let value = Value::Integer(7);
        let values = [Some(&value), None];
        assert_eq!(Column::integers(&values, &info(0.0, 9.0)), Column::Int32(vec![Some(7), None]));
        assert_eq!(Column::integers(&values, &info(0.0, 3e9)), Column::Float(vec![Some(7.0), None]));
        assert_eq!(Column::integers(&values, &info(0.0, 1e17)), Column::Text(vec![Some("7".into()), None]));
        // A value outside of the stated range.
        assert_eq!(
            Column::integers(&[Some(&Value::Integer(i64::MAX))], &info(0.0, 1.0)),
            Column::Text(vec![Some(i64::MAX.to_string())])
        );
    }

    #[test]
    fn texts_have_one_more_offset_than_rows() {
        let texts = Column::Text(vec![Some("ab".into()), None, Some("c".into())]);
        let packed = texts.pack();
        assert_eq!(packed.values, b"abc");
        assert_eq!(packed.offsets, Some((vec![0, 0, 2, 0, 2, 0, 3, 0], "UINT16")));
        let long = Column::Text(vec![Some("x".repeat(70_000))]).pack();
        assert_eq!(long.offsets.map(|(bytes, kind)| (bytes.len(), kind)), Some((8, "UINT32")));
    }

    #[test]
    fn bits_fill_bytes_from_the_lowest() {
        assert_eq!(bits(&[true, false, false, true, false, false, false, false, true]), [0b1001, 1]);
    }
}
