//! Styles of all objects by an attribute and a filter.
//!
//! A part without a value has that of its parent, and passes a filter that its parent passes. Kinds of which no object has the
//! attribute, such as terrain, are drawn as they are.

use super::ObjectStyles;
use insula_objects::{FeatureKind, ObjectBlock, color::ColorBy, filter::Filter};
use std::collections::{BTreeMap, BTreeSet};

/// Colour of objects that do not pass a filter and are shown faintly.
const GHOST_RGB: [u8; 3] = [226, 226, 226];

/// What becomes of objects that do not pass a filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FilteredOut {
    /// Drawn in a pale colour.
    #[default]
    Ghost,
    /// Not drawn.
    Hide,
    /// Drawn as without a filter; those that pass have the highlight's colour.
    Keep,
}

/// How objects are drawn by their attributes.
#[derive(Debug, Default)]
pub struct ObjectQuery {
    pub color: Option<ColorBy>,
    pub filter: Option<Filter>,
    pub filtered_out: FilteredOut,
}

/// Colour of objects that pass a filter where others keep theirs.
const HIGHLIGHT_RGB: [u8; 3] = [255, 196, 61];

/// What is known of an object while the styles are made.
#[derive(Clone, Copy)]
struct Facts {
    kind: FeatureKind,
    rgb: Option<[u8; 3]>,
    passes: bool,
    parent: Option<u32>,
}

/// Makes styles from the blocks of a city, one after the other.
#[derive(Default)]
pub struct StyleBuilder {
    facts: BTreeMap<u32, Facts>,
    /// Kinds of which an object has a value.
    coloured_kinds: BTreeSet<FeatureKind>,
    /// Kinds of which an object passes the filter.
    passing_kinds: BTreeSet<FeatureKind>,
}

impl StyleBuilder {
    /// Evaluates the objects of a block.
    pub fn add(&mut self, block: &ObjectBlock, query: &ObjectQuery) {
        for &id in block.ids() {
            let Some(kind) = block.kind(id) else { continue };
            let rgb = query.color.as_ref().and_then(|color| {
                let value = color.value(block, id)?;
                let [r, g, b, _] = color.rgba(Some(&value));
                Some([r, g, b])
            });
            let passes = query.filter.as_ref().is_none_or(|filter| filter.matches(block, id));
            if rgb.is_some() {
                self.coloured_kinds.insert(kind);
            }
            if passes {
                self.passing_kinds.insert(kind);
            }
            self.facts.insert(id, Facts { kind, rgb, passes, parent: block.parent(id) });
        }
    }

    /// The styles of all objects that were added, and how many pass the filter.
    pub fn finish(mut self, query: &ObjectQuery) -> (ObjectStyles, usize) {
        self.include_parts();
        let mut styles = ObjectStyles::default();
        let mut passing = 0;
        for (&id, facts) in &self.facts {
            let own = self.with_parent(facts);
            passing += usize::from(own.passes);
            let colour = query.color.as_ref().filter(|_| self.coloured_kinds.contains(&own.kind)).map(|color| {
                let [r, g, b, _] = color.rgba(None);
                own.rgb.unwrap_or([r, g, b])
            });
            let is_filtered = query.filter.is_some() && self.passing_kinds.contains(&own.kind);
            match (is_filtered, own.passes, query.filtered_out) {
                (true, false, FilteredOut::Hide) => styles.hide(id),
                (true, false, FilteredOut::Ghost) => styles.set_colour(id, GHOST_RGB),
                (true, true, FilteredOut::Keep) => styles.set_colour(id, colour.unwrap_or(HIGHLIGHT_RGB)),
                _ => {
                    if let Some(rgb) = colour {
                        styles.set_colour(id, rgb);
                    }
                }
            }
        }
        (styles, passing)
    }

    /// Kinds of parts count where those of their parents do.
    fn include_parts(&mut self) {
        let mut more = (BTreeSet::new(), BTreeSet::new());
        for facts in self.facts.values() {
            let Some(parent) = facts.parent.and_then(|parent| self.facts.get(&parent)) else { continue };
            if parent.rgb.is_some() {
                more.0.insert(facts.kind);
            }
            if parent.passes {
                more.1.insert(facts.kind);
            }
        }
        self.coloured_kinds.extend(more.0);
        self.passing_kinds.extend(more.1);
    }

    /// An object's facts, with what it lacks from its parent.
    fn with_parent(&self, facts: &Facts) -> Facts {
        let Some(parent) = facts.parent.and_then(|parent| self.facts.get(&parent)) else { return *facts };
        Facts { rgb: facts.rgb.or(parent.rgb), passes: facts.passes || parent.passes, ..*facts }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_objects::{ObjectRecord, SchemaBuilder, Value, block};
    use insula_shaders::layout::{PALETTE_COLOURED, PALETTE_HIDDEN};

    /// A terrain, an old house of two parts, a new house and one without a year.
    fn town() -> (insula_objects::Schema, ObjectBlock) {
        let record = |kind, parent, year: Option<i64>| {
            let attributes = year.map(|year| (0, Value::Integer(year))).into_iter().collect();
            Some(ObjectRecord { identifier: String::new(), kind, parent, bounds: None, attributes })
        };
        let records = [
            record(FeatureKind::Relief, None, None),
            record(FeatureKind::Building, None, Some(1650)),
            record(FeatureKind::BuildingPart, Some(1), None),
            record(FeatureKind::BuildingPart, Some(1), None),
            record(FeatureKind::Building, None, Some(2010)),
            record(FeatureKind::Building, None, None),
        ];
        let mut builder = SchemaBuilder::default();
        [1650, 2010].iter().for_each(|year| builder.add("year", &Value::Integer(*year)));
        let schema = builder.finish(6);
        let bytes = block::encode(0, &records, &schema).unwrap();
        let block = ObjectBlock::decode(0, &bytes, &schema).unwrap();
        (schema, block)
    }

    fn styles(query: &ObjectQuery, block: &ObjectBlock) -> (Vec<u32>, usize) {
        let mut builder = StyleBuilder::default();
        builder.add(block, query);
        let (styles, passing) = builder.finish(query);
        (styles.words(&[0, 1, 2, 3, 4, 5]), passing)
    }

    #[test]
    fn parts_have_the_colours_of_their_parents_and_terrain_keeps_its_own() {
        let (schema, block) = town();
        let color = Some(ColorBy::parse("year", &schema).unwrap());
        let (words, _) = styles(&ObjectQuery { color, ..ObjectQuery::default() }, &block);
        assert_eq!(words[0], 0);
        assert!(words[1..].iter().all(|word| word & PALETTE_COLOURED != 0));
        assert_eq!([words[2], words[3]], [words[1]; 2]);
        assert!(words[4] != words[1] && words[5] != words[1]);
    }

    #[test]
    fn objects_that_do_not_pass_are_hidden_and_terrain_stays() {
        let (schema, block) = town();
        let filter = Some(Filter::parse("year < 1900", &schema).unwrap());
        let query = ObjectQuery { filter, filtered_out: FilteredOut::Hide, color: None };
        let (words, passing) = styles(&query, &block);
        assert_eq!(words, [0, 0, 0, 0, PALETTE_HIDDEN, PALETTE_HIDDEN]);
        assert_eq!(passing, 3);
    }
}
