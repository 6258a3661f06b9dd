//! Values that wholes take from their parts in filters.

use super::Source;
use crate::block::{ObjectBlock, ObjectBounds};
use crate::family::PartValues;
use crate::value::{Value, ValueRef};
use std::collections::BTreeMap;

/// Numbers, dates and booleans of the parts of one whole, and the box around them. Texts are left out: those of parts that differ are no
/// value of the whole, and a filter finds the parts by them.
#[derive(Debug, Clone, Default)]
pub(super) struct PartFacts {
    values: PartValues,
    bounds: Option<ObjectBounds>,
}

impl PartFacts {
    pub(super) fn value(&self, source: Source) -> Option<ValueRef<'_>> {
        match source {
            Source::Attribute(attribute) => self.values.get(attribute).map(Value::borrowed),
            Source::Height => self.bounds.map(|bounds| ValueRef::Float(bounds.height_m())),
            Source::Id | Source::Identifier | Source::Kind => None,
        }
    }

    /// Adds other parts of the same whole.
    pub(super) fn merge(&mut self, other: Self) {
        self.values.merge(other.values);
        self.include(other.bounds);
    }

    fn include(&mut self, other: Option<ObjectBounds>) {
        self.bounds = match (self.bounds, other) {
            (Some(own), Some(other)) => Some(own.union(other)),
            (own, other) => own.or(other),
        };
    }

    fn add(&mut self, block: &ObjectBlock, part: u32, attributes: &[u32]) {
        let value = |attribute: &u32| match block.value_ref(block.row(part)?, *attribute)? {
            ValueRef::Text(_) => None,
            value => Some((*attribute, value.to_value())),
        };
        self.values.add(attributes.iter().filter_map(value));
        self.include(block.bounds(part));
    }
}

/// The values of these attributes that the wholes in `wholes` take from their parts in `block`.
pub(super) fn by_whole(wholes: &ObjectBlock, block: &ObjectBlock, attributes: &[u32]) -> BTreeMap<u32, PartFacts> {
    let mut facts: BTreeMap<u32, PartFacts> = BTreeMap::new();
    for &part in block.ids() {
        let Some(whole) = block.parent(part).filter(|whole| *whole != part) else { continue };
        let kinds = block.kind(part).zip(wholes.kind(whole));
        if kinds.is_some_and(|(part, whole)| part.is_part_of(whole)) {
            facts.entry(whole).or_default().add(block, part, attributes);
        }
    }
    facts
}
