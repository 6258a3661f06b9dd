//! `extras` as attributes.

use super::schema::Raw;
use insula_source::attributes::{AttributeValue, Attributes};
use serde_json::Value;

/// Deeper members are left out.
const MAX_DEPTH: usize = 8;

/// The attributes of `extras`; empty if there are none.
pub(super) fn attributes(extras: &Raw) -> Attributes {
    let mut attributes = Attributes::default();
    push(extras, &mut attributes);
    attributes
}

pub(super) fn push(extras: &Raw, attributes: &mut Attributes) {
    let Some(value) = extras.as_ref().and_then(|raw| serde_json::from_str::<Value>(raw.get()).ok()) else { return };
    match &value {
        Value::Object(members) => {
            members.iter().for_each(|(name, value)| push_value(name, value, MAX_DEPTH, attributes))
        }
        value => push_value("extras", value, MAX_DEPTH, attributes),
    }
}

/// Adds a value of JSON, flattened.
pub(super) fn push_value(name: &str, value: &Value, depth: usize, attributes: &mut Attributes) {
    let member = |inner: &str| format!("{name}.{inner}");
    match value {
        Value::Null => {}
        Value::Bool(value) => attributes.push(name, AttributeValue::Bool(*value)),
        Value::Number(number) => match (number.as_i64(), number.as_f64()) {
            (Some(value), _) => attributes.push(name, AttributeValue::Integer(value)),
            (None, Some(value)) => attributes.push(name, AttributeValue::Float(value)),
            (None, None) => {}
        },
        Value::String(text) => attributes.push(name, AttributeValue::Text(text.clone())),
        _ if depth == 0 => {}
        Value::Array(items) => {
            for (index, item) in items.iter().enumerate().take(insula_source::attributes::MAX_ATTRIBUTES) {
                push_value(&member(&index.to_string()), item, depth - 1, attributes);
            }
        }
        Value::Object(members) => {
            members.iter().for_each(|(inner, value)| push_value(&member(inner), value, depth - 1, attributes));
        }
    }
}
