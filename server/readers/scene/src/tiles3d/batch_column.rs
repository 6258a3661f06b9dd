//! Columns of batch tables: lists, or parts of the binary.

use serde_json::Value;

use super::bytes::{array_at, part};
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::json::attributes::flatten_value;

/// The values of one attribute.
#[derive(Debug)]
pub(super) enum Column<'a> {
    Json(Vec<Value>),
    Binary { bytes: &'a [u8], component: Component, components: usize },
}

/// Type of a number in binary columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Component {
    pub(super) fn new(name: &str) -> Option<Self> {
        Some(match name {
            "BYTE" => Self::I8,
            "UNSIGNED_BYTE" => Self::U8,
            "SHORT" => Self::I16,
            "UNSIGNED_SHORT" => Self::U16,
            "INT" => Self::I32,
            "UNSIGNED_INT" => Self::U32,
            "FLOAT" => Self::F32,
            "DOUBLE" => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number at a byte.
    pub(super) fn value_at(self, bytes: &[u8], at: usize) -> Option<AttributeValue> {
        Some(match self {
            Self::I8 => AttributeValue::Integer(i8::from_le_bytes(array_at(bytes, at)?).into()),
            Self::U8 => AttributeValue::Integer(u8::from_le_bytes(array_at(bytes, at)?).into()),
            Self::I16 => AttributeValue::Integer(i16::from_le_bytes(array_at(bytes, at)?).into()),
            Self::U16 => AttributeValue::Integer(u16::from_le_bytes(array_at(bytes, at)?).into()),
            Self::I32 => AttributeValue::Integer(i32::from_le_bytes(array_at(bytes, at)?).into()),
            Self::U32 => AttributeValue::Integer(u32::from_le_bytes(array_at(bytes, at)?).into()),
            Self::F32 => AttributeValue::single(f32::from_le_bytes(array_at(bytes, at)?)),
            Self::F64 => AttributeValue::Float(f64::from_le_bytes(array_at(bytes, at)?)),
        })
    }
}

impl<'a> Column<'a> {
    /// The column that a member of a table describes, with `length` values. Fails if it is malformed or cut short.
    pub(super) fn new(json: &Value, binary: &'a [u8], length: u32) -> Result<Self, &'static str> {
        if let Some(values) = json.as_array() {
            return Ok(Self::Json(values.clone()));
        }
        let text = |name: &str| json.get(name).and_then(Value::as_str);
        let offset = json.get("byteOffset").and_then(Value::as_u64).ok_or("neither a list nor a part of the binary")?;
        let component = text("componentType").and_then(Component::new).ok_or("unknown component type")?;
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
                    let Some(value) = component.value_at(bytes, at) else { return };
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
                match component.value_at(bytes, row.checked_mul(component.bytes() * components)?)? {
                    AttributeValue::Integer(value) => u32::try_from(value).ok(),
                    _ => None,
                }
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
