//! Columns of batch tables: lists, or parts of the binary.

use crate::bytes::{Number, NumberType, part};
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::json::attributes::flatten_value;
use serde_json::Value;

/// The values of one attribute.
#[derive(Debug)]
pub(super) enum Column<'a> {
    Json(Vec<Value>),
    Binary { bytes: &'a [u8], component: NumberType, components: usize },
}

/// The type of a number in binary columns.
pub(super) fn component_by_name(name: &str) -> Option<NumberType> {
    NumberType::by_name("BYTE UNSIGNED_BYTE SHORT UNSIGNED_SHORT INT UNSIGNED_INT - - FLOAT DOUBLE", name)
}

impl<'a> Column<'a> {
    /// The column that a member of a table describes, with `length` values. Fails if it is malformed or cut short.
    pub(super) fn new(json: &Value, binary: &'a [u8], length: u32) -> Result<Self, &'static str> {
        if let Some(values) = json.as_array() {
            return Ok(Self::Json(values.clone()));
        }
        let text = |name: &str| json.get(name).and_then(Value::as_str);
        let offset = json.get("byteOffset").and_then(Value::as_u64).ok_or("neither a list nor a part of the binary")?;
        let component = text("componentType").and_then(component_by_name).ok_or("unknown component type")?;
        let components = match text("type") {
            Some("SCALAR") | None => 1,
            Some("VEC2") => 2,
            Some("VEC3") => 3,
            Some("VEC4") => 4,
            Some(_) => return Err("unknown type"),
        };
        let size = u64::from(length) * (component.bytes() * components) as u64;
        let bytes = part(binary, offset, size).ok_or("it lies outside of the binary")?;
        Ok(Self::Binary { bytes, component, components })
    }

    /// Adds the value of a row.
    pub(super) fn add_to(&self, name: &str, row: usize, into: &mut Attributes) {
        match self {
            Self::Json(values) => match values.get(row) {
                None | Some(Value::Null) => {}
                Some(Value::String(text)) => into.push(name, AttributeValue::Text(text.clone())),
                Some(value) => flatten_value(name, &value.clone().into(), into),
            },
            Self::Binary { bytes, component, components } => {
                for i in 0..*components {
                    let at = row.saturating_mul(*components).saturating_add(i).saturating_mul(component.bytes());
                    let Some(value) = component.read(bytes, at).map(Number::to_attribute) else { return };
                    if *components == 1 { into.push(name, value) } else { into.push(&format!("{name}.{i}"), value) }
                }
            }
        }
    }

    /// The whole number of a row.
    pub(super) fn index_at(&self, row: usize) -> Option<u32> {
        match self {
            Self::Json(values) => values.get(row)?.as_u64().and_then(|value| u32::try_from(value).ok()),
            Self::Binary { bytes, component, components } => {
                component.read(bytes, row.checked_mul(component.bytes() * components)?)?.to_u32()
            }
        }
    }

    pub(super) fn rows(&self) -> usize {
        match self {
            Self::Json(values) => values.len(),
            Self::Binary { bytes, component, components } => bytes.len() / (component.bytes() * components),
        }
    }
}
