//! JSON objects whose members keep the order of the source, which `serde_json::Map` sorts by name.

use serde::de::{MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::{Number, Value};
use std::fmt;
use std::marker::PhantomData;

/// The members of an object in the order of the text. Equal names stay.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Members(Vec<(String, MemberValue)>);

/// The value of a member.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum MemberValue {
    #[default]
    Null,
    Bool(bool),
    Number(Number),
    Text(String),
    List(Vec<Self>),
    Members(Members),
}

impl Members {
    /// Names and values in their order.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &MemberValue)> {
        self.0.iter().map(|(name, value)| (name.as_str(), value))
    }

    /// The first value of a name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&MemberValue> {
        self.iter().find(|(known, _)| *known == name).map(|(_, value)| value)
    }
}

/// The members of an object are in the order of their names.
impl From<Value> for MemberValue {
    fn from(value: Value) -> Self {
        match value {
            Value::Null => Self::Null,
            Value::Bool(value) => Self::Bool(value),
            Value::Number(number) => Self::Number(number),
            Value::String(text) => Self::Text(text),
            Value::Array(values) => Self::List(values.into_iter().map(Self::from).collect()),
            Value::Object(members) => {
                Self::Members(Members(members.into_iter().map(|(name, value)| (name, value.into())).collect()))
            }
        }
    }
}

impl<'de> Deserialize<'de> for Members {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        entries(deserializer, "an object").map(Self)
    }
}

impl<'de> Deserialize<'de> for MemberValue {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ValueVisitor)
    }
}

/// Names and values of the members of an object, in their order. `expected` is what a fault says that there should be.
pub fn entries<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
    expected: &'static str,
) -> Result<Vec<(String, T)>, D::Error> {
    deserializer.deserialize_map(EntriesVisitor { expected, values: PhantomData })
}

struct EntriesVisitor<T> {
    expected: &'static str,
    values: PhantomData<T>,
}

impl<'de, T: Deserialize<'de>> Visitor<'de> for EntriesVisitor<T> {
    type Value = Vec<(String, T)>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.expected)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
        let mut entries = Vec::new();
        while let Some(entry) = map.next_entry()? {
            entries.push(entry);
        }
        Ok(entries)
    }
}

struct ValueVisitor;

impl<'de> Visitor<'de> for ValueVisitor {
    type Value = MemberValue;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a JSON value")
    }

    fn visit_unit<E>(self) -> Result<MemberValue, E> {
        Ok(MemberValue::Null)
    }

    fn visit_bool<E>(self, value: bool) -> Result<MemberValue, E> {
        Ok(MemberValue::Bool(value))
    }

    fn visit_i64<E>(self, value: i64) -> Result<MemberValue, E> {
        Ok(MemberValue::Number(value.into()))
    }

    fn visit_u64<E>(self, value: u64) -> Result<MemberValue, E> {
        Ok(MemberValue::Number(value.into()))
    }

    fn visit_f64<E>(self, value: f64) -> Result<MemberValue, E> {
        Ok(Number::from_f64(value).map_or(MemberValue::Null, MemberValue::Number))
    }

    fn visit_str<E>(self, value: &str) -> Result<MemberValue, E> {
        Ok(MemberValue::Text(value.to_owned()))
    }

    fn visit_string<E>(self, value: String) -> Result<MemberValue, E> {
        Ok(MemberValue::Text(value))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut values: A) -> Result<MemberValue, A::Error> {
        let mut list = Vec::new();
        while let Some(value) = values.next_element()? {
            list.push(value);
        }
        Ok(MemberValue::List(list))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<MemberValue, A::Error> {
        let entries = EntriesVisitor { expected: "an object", values: PhantomData }.visit_map(map)?;
        Ok(MemberValue::Members(Members(entries)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn members_keep_their_order_and_their_types() {
        let text = r#"{"z": 1, "a": [null, -2, 1.5, 18446744073709551615], "m": {"y": "x", "b": false}}"#;
        let members: Members = serde_json::from_str(text).unwrap();
        assert_eq!(members.iter().map(|(name, _)| name).collect::<Vec<_>>(), ["z", "a", "m"]);
        let Some(MemberValue::List(list)) = members.get("a") else { panic!("{members:?}") };
        let numbers: Vec<String> = list
            .iter()
            .filter_map(|value| if let MemberValue::Number(number) = value { Some(number.to_string()) } else { None })
            .collect();
        assert_eq!((list[0].clone(), numbers.join(" ")), (MemberValue::Null, "-2 1.5 18446744073709551615".into()));
        let Some(MemberValue::Members(inner)) = members.get("m") else { panic!("{members:?}") };
        assert_eq!(inner.iter().map(|(name, _)| name).collect::<Vec<_>>(), ["y", "b"]);
        assert!(serde_json::from_str::<Members>("[1]").is_err());
        // As deep as serde_json reads, and no stack overflow beyond.
        assert!(serde_json::from_str::<MemberValue>(&"[".repeat(100_000)).is_err());
    }
}
