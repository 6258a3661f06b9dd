//! What wholes and their parts have of each other: parts have the values of their whole, and a whole has those of its parts, where they
//! have none of their own.

use crate::value::{MAX_TEXT_BYTES, Value};
use std::collections::BTreeMap;

/// Between texts of parts that differ.
const SEPARATOR: &str = "; ";

/// Gives an object the values that its parent has and it lacks. Attributes ascend, before and after.
pub fn inherit(own: &mut Vec<(u32, Value)>, parent: &[(u32, Value)]) {
    let missing = |attribute: &u32| own.binary_search_by_key(attribute, |(known, _)| *known).is_err();
    let inherited: Vec<_> = parent.iter().filter(|(attribute, _)| missing(attribute)).cloned().collect();
    own.extend(inherited);
    own.sort_by_key(|(attribute, _)| *attribute);
}

/// The values of the parts of one object.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PartValues(BTreeMap<u32, Value>);

impl PartValues {
    /// Adds those of a part. Of numbers and dates the largest counts, as a building is as high as its highest part; texts that differ are
    /// all kept, and of booleans one `true` is enough.
    pub fn add(&mut self, part: impl IntoIterator<Item = (u32, Value)>) {
        for (attribute, value) in part {
            match self.0.get_mut(&attribute) {
                Some(known) => merge(known, value),
                None => drop(self.0.insert(attribute, value)),
            }
        }
    }

    /// Adds those of other parts.
    pub fn merge(&mut self, other: Self) {
        self.add(other.0);
    }

    /// That of an attribute.
    pub fn get(&self, attribute: u32) -> Option<&Value> {
        self.0.get(&attribute)
    }

    /// Gives the whole the values that it lacks. Attributes ascend, before and after.
    pub fn complete(self, whole: &mut Vec<(u32, Value)>) {
        let parts: Vec<_> = self.0.into_iter().collect();
        inherit(whole, &parts);
    }
}

/// What comes with the largest number of the parts of each whole, by the whole: numbers count as in [`PartValues::add`]. Of each part
/// it takes the whole, the number, and what comes with that.
pub fn of_largest_numbers<T>(parts: impl IntoIterator<Item = (u32, f64, T)>) -> BTreeMap<u32, T> {
    let mut largest: BTreeMap<u32, (f64, T)> = BTreeMap::new();
    for (whole, number, with) in parts {
        if largest.get(&whole).is_none_or(|(known, _)| *known < number) {
            largest.insert(whole, (number, with));
        }
    }
    largest.into_iter().map(|(whole, (_, with))| (whole, with)).collect()
}

fn merge(known: &mut Value, other: Value) {
    match (known, other) {
        (Value::Integer(known), Value::Integer(other)) => *known = other.max(*known),
        (Value::Float(known), Value::Float(other)) => *known = other.max(*known),
        (Value::Date(known), Value::Date(other)) => *known = other.max(*known),
        (Value::Bool(known), Value::Bool(other)) => *known |= other,
        (Value::Text(known), Value::Text(other)) => {
            let is_known = known.split(SEPARATOR).any(|text| text == other);
            if !is_known && known.len() + SEPARATOR.len() + other.len() <= MAX_TEXT_BYTES {
                known.push_str(SEPARATOR);
                known.push_str(&other);
            }
        }
        // An attribute has one type.
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(text: &str) -> Value {
        Value::Text(text.to_owned())
    }

    #[test]
    fn parts_have_the_values_of_their_parent_and_keep_their_own() {
        let mut own = vec![(1, Value::Integer(3)), (4, text("flat"))];
        inherit(&mut own, &[(0, text("Kerk")), (1, Value::Integer(9)), (7, Value::Bool(true))]);
        let expected = vec![(0, text("Kerk")), (1, Value::Integer(3)), (4, text("flat")), (7, Value::Bool(true))];
        assert_eq!(own, expected);
    }

    #[test]
    fn a_whole_has_the_largest_numbers_and_all_texts_of_its_parts() {
        let mut parts = PartValues::default();
        parts.add([(0, Value::Float(8.63)), (2, text("flat")), (3, Value::Bool(false))]);
        parts.add([(0, Value::Float(21.5)), (2, text("gabled")), (3, Value::Bool(true)), (5, Value::Date(9))]);
        parts.add([(0, Value::Float(2.0)), (2, text("flat")), (5, Value::Date(4))]);
        let mut whole = vec![(1, Value::Integer(1650)), (5, Value::Date(1))];
        parts.complete(&mut whole);
        let expected = vec![
            (0, Value::Float(21.5)),
            (1, Value::Integer(1650)),
            (2, text("flat; gabled")),
            (3, Value::Bool(true)),
            (5, Value::Date(1)),
        ];
        assert_eq!(whole, expected);
    }

    #[test]
    fn the_largest_number_of_a_whole_decides() {
        let parts = [(7, 2.0, 'a'), (7, 5.0, 'b'), (3, -1.0, 'c'), (7, 5.0, 'd')];
        assert_eq!(of_largest_numbers(parts), BTreeMap::from([(3, 'c'), (7, 'b')]));
    }

    #[test]
    fn texts_of_many_parts_stay_within_the_limit() {
        let mut parts = PartValues::default();
        (0..10_000).for_each(|part| parts.add([(0, text(&part.to_string()))]));
        let mut whole = Vec::new();
        parts.complete(&mut whole);
        assert!(matches!(&whole[..], [(0, Value::Text(text))] if text.len() <= MAX_TEXT_BYTES));
    }
}
