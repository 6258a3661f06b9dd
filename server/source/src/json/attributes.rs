//! JSON members as attributes.

use super::members::{MemberValue, Members};
use crate::attributes::{AttributeValue, Attributes};

/// Members that are nested deeper are left out.
const MAX_DEPTH: usize = 8;
/// Further members of a list are left out.
const MAX_LIST: usize = 64;

/// Adds the members of an object in their order: lists become `name.0`, `name.1`, nested members `outer.inner`.
pub fn flatten(members: &Members, into: &mut Attributes) {
    members.iter().for_each(|(name, value)| add(name, value, 0, into));
}

/// Adds a value of any type: as [`flatten`] a member of this name.
pub fn flatten_value(name: &str, value: &MemberValue, into: &mut Attributes) {
    add(name, value, 0, into);
}

fn add(name: &str, value: &MemberValue, depth: usize, into: &mut Attributes) {
    if depth > MAX_DEPTH {
        return;
    }
    match value {
        MemberValue::Null => {}
        MemberValue::Bool(value) => into.push(name, AttributeValue::Bool(*value)),
        MemberValue::Number(number) => {
            let whole = number.as_i64().map(AttributeValue::Integer);
            let whole = whole.or_else(|| number.as_u64().map(AttributeValue::unsigned));
            if let Some(value) = whole.or_else(|| number.as_f64().map(AttributeValue::Float)) {
                into.push(name, value);
            }
        }
        MemberValue::Text(text) => into.push(name, AttributeValue::Text(text.clone())),
        MemberValue::List(values) => {
            let members = values.iter().take(MAX_LIST).enumerate();
            members.for_each(|(i, value)| add(&format!("{name}.{i}"), value, depth + 1, into));
        }
        MemberValue::Members(members) => {
            members.iter().for_each(|(inner, value)| add(&format!("{name}.{inner}"), value, depth + 1, into));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn members_keep_their_order_and_types_and_lists_are_flat() {
        let text = r#"{
            "levels": 4, "height": 12.5, "use": "church", "code": "007", "listed": true, "none": null,
            "names": {"primary": "Kerk", "others": ["a", 2]}
        }"#;
        let members: Members = serde_json::from_str(text).unwrap();
        let mut attributes = Attributes::default();
        flatten(&members, &mut attributes);
        let found: Vec<String> = attributes.iter().map(|(name, value)| format!("{name}={value:?}")).collect();
        let expected = [
            "levels=Integer(4)", "height=Float(12.5)", "use=Text(\"church\")", "code=Text(\"007\")",
            "listed=Bool(true)", "names.primary=Text(\"Kerk\")", "names.others.0=Text(\"a\")",
            "names.others.1=Integer(2)",
        ];
        assert_eq!(found, expected);
    }
}
