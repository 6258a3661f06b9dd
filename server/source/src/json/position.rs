//! Positions as JSON arrays of numbers.

use serde::Deserialize;
use serde::de::{Deserializer, IgnoredAny, SeqAccess, Visitor};
use std::fmt;

/// A position. A coordinate that is missing or null is NaN, so that it affects only the objects that use it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JsonPosition(pub [f64; 3]);

impl<'de> Deserialize<'de> for JsonPosition {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(PositionVisitor)
    }
}

struct PositionVisitor;

impl<'de> Visitor<'de> for PositionVisitor {
    type Value = JsonPosition;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a vertex of three numbers")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<JsonPosition, A::Error> {
        let mut position = [f64::NAN; 3];
        for value in &mut position {
            match seq.next_element::<Option<f64>>()? {
                Some(number) => *value = number.unwrap_or(f64::NAN),
                None => return Ok(JsonPosition(position)),
            }
        }
        while seq.next_element::<IgnoredAny>()?.is_some() {}
        Ok(JsonPosition(position))
    }
}
