//! CityJSON's nested arrays of indices, whose depth depends on the geometry's type.

use serde::de::{Deserialize, Deserializer, SeqAccess, Visitor};
use serde_json::value::RawValue;
use std::fmt;

/// An index, an array of nested indices, or nothing. A number that is not an index becomes -1, which is always out of
/// range.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) enum Nested {
    #[default]
    Null,
    Index(i64),
    List(Vec<Nested>),
}

/// A missing value.
pub(crate) static NULL: Nested = Nested::Null;

impl Nested {
    /// The entries; empty if this is not a list.
    pub(crate) fn list(&self) -> &[Nested] {
        match self {
            Self::List(list) => list,
            _ => &[],
        }
    }

    /// The value for the i-th child. A single value (`"value": 3`, or one semantic for a shell) applies to each child;
    /// a list that is too short has no value.
    pub(crate) fn child(&self, i: usize) -> &Nested {
        match self {
            Self::List(list) => list.get(i).unwrap_or(&NULL),
            whole => whole,
        }
    }

    pub(crate) fn index(&self) -> Option<i64> {
        match self {
            Self::Index(index) => Some(*index),
            _ => None,
        }
    }
}

impl<'de> Deserialize<'de> for Nested {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(NestedVisitor)
    }
}

struct NestedVisitor;

impl<'de> Visitor<'de> for NestedVisitor {
    type Value = Nested;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an index, null or an array of them")
    }

    fn visit_u64<E>(self, index: u64) -> Result<Nested, E> {
        Ok(Nested::Index(i64::try_from(index).unwrap_or(-1)))
    }

    fn visit_i64<E>(self, index: i64) -> Result<Nested, E> {
        Ok(Nested::Index(index))
    }

    fn visit_f64<E>(self, index: f64) -> Result<Nested, E> {
        Ok(Nested::Index(if index.fract() == 0.0 && index.abs() < 1e15 { index as i64 } else { -1 }))
    }

    fn visit_unit<E>(self) -> Result<Nested, E> {
        Ok(Nested::Null)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Nested, A::Error> {
        let mut list = Vec::new();
        while let Some(entry) = seq.next_element()? {
            list.push(entry);
        }
        Ok(Nested::List(list))
    }
}

/// Whether nested arrays have a value that is no array. What cannot be [`Nested`] counts as one, so that its reader reports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Filled(pub(crate) bool);

impl<'de> Deserialize<'de> for Filled {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = <&RawValue>::deserialize(deserializer)?.get();
        let is_value = |c: char| !matches!(c, '[' | ']' | ',') && !c.is_ascii_whitespace();
        Ok(Self(text.split("null").any(|part| part.contains(is_value))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_depth_null_and_non_indices_are_parsed() {
        let nested: Nested = serde_json::from_str("[[1, 2.0, 2.5, -3], null, [[4]]]").unwrap();
        let first: Vec<_> = nested.child(0).list().iter().map(Nested::index).collect();
        assert_eq!(first, [Some(1), Some(2), Some(-1), Some(-3)]);
        assert_eq!(nested.child(1), &Nested::Null);
        assert_eq!(nested.child(2).child(0).child(0).index(), Some(4));
        assert_eq!(nested.child(9), &Nested::Null);
        assert_eq!(Nested::Index(7).child(3).child(1).index(), Some(7));
        assert!(serde_json::from_str::<Nested>("[\"a\"]").is_err());
    }

    #[test]
    fn empty_arrays_of_any_depth_are_not_filled() {
        let filled = |text: &str| serde_json::from_str::<Filled>(text).unwrap().0;
        assert!(filled("[[], [[0]]]") && filled("7") && filled("[\"a\"]") && filled("{\"a\": []}"));
        assert!(!filled("[]") && !filled("[[[]], [], null]") && !filled("null"));
    }

    #[test]
    fn excessive_depth_is_an_error_and_not_a_crash() {
        let deep = "[".repeat(100_000);
        assert!(serde_json::from_str::<Nested>(&deep).is_err());
    }
}
