//! Styles of all objects by an attribute and a filter.
//!
//! A part without a value has that of its parent, and a whole without one the largest number of its parts, also in filters. A part passes a
//! filter that its parent passes. Kinds of which no object has the attribute, such as terrain, are drawn as they are.

use super::ObjectStyles;
use insula_objects::color::ColorBy;
use insula_objects::family::of_largest_numbers;
use insula_objects::filter::{Filter, FilterBuilder, FilteredObjects};
use insula_objects::{FeatureKind, ObjectBlock, Value};
use std::collections::{BTreeMap, BTreeSet};

/// Colour of objects that do not pass a filter and are shown faintly.
const GHOST_RGB: [u8; 3] = [226, 226, 226];

/// What becomes of objects that do not pass a filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FilteredOut {
    /// Drawn in a pale colour.
    #[default]
    Ghost,
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

/// What is known of an object while the colours are made.
#[derive(Clone, Copy)]
struct Facts {
    kind: FeatureKind,
    rgb: Option<[u8; 3]>,
    /// Number or day of its value.
    number: Option<f64>,
    parent: Option<u32>,
}

/// Makes styles from the blocks of a city, one after the other.
#[derive(Default)]
pub struct StyleBuilder {
    facts: BTreeMap<u32, Facts>,
    filter: FilterBuilder,
    objects: usize,
}

impl StyleBuilder {
    /// Evaluates the objects of a block.
    pub fn add(&mut self, block: &ObjectBlock, query: &ObjectQuery) {
        self.objects += block.ids().len();
        if let Some(filter) = &query.filter {
            self.filter.add(block, filter);
        }
        let Some(color) = &query.color else { return };
        for &id in block.ids() {
            let Some(kind) = block.kind(id) else { continue };
            let value = color.value(block, id);
            let rgb = value.as_ref().map(|value| rgb_of(color, Some(value)));
            let number = value.as_ref().and_then(Value::as_f64);
            self.facts.insert(id, Facts { kind, rgb, number, parent: block.parent(id) });
        }
    }

    /// Pairs of blocks that [`Self::add_apart`] takes after all blocks: see [`FilterBuilder::apart`].
    pub fn apart(&self) -> Vec<[u32; 2]> {
        self.filter.apart()
    }

    /// Evaluates the filter again on the objects of a block whose parents are in another one.
    pub fn add_apart(&mut self, parents: &ObjectBlock, block: &ObjectBlock, query: &ObjectQuery) {
        if let Some(filter) = &query.filter {
            self.filter.add_apart(parents, block, filter);
        }
    }

    /// The styles of all objects that were added, and how many pass the filter: a building counts once with its parts.
    pub fn finish(self, query: &ObjectQuery) -> (ObjectStyles, usize) {
        let filtered = query.filter.is_some().then(|| self.filter.finish());
        let passing = filtered.as_ref().map_or(self.objects, |filtered| filtered.passing_wholes as usize);
        let mut styles = ObjectStyles::default();
        if let Some(filtered) = &filtered {
            highlight(&mut styles, filtered, query.filtered_out);
        }
        if let Some(color) = &query.color {
            set_colours(&mut styles, &self.facts, rgb_of(color, None));
        }
        if let Some(filtered) = &filtered {
            filter_out(&mut styles, filtered, query.filtered_out);
        }
        (styles, passing)
    }
}

/// The styles of a filter alone.
pub(super) fn styles_of_filter(filtered: &FilteredObjects, filtered_out: FilteredOut) -> ObjectStyles {
    let mut styles = ObjectStyles::default();
    highlight(&mut styles, filtered, filtered_out);
    filter_out(&mut styles, filtered, filtered_out);
    styles
}

/// Colours what passes where the others stay as they are. Colours by an attribute replace this one.
fn highlight(styles: &mut ObjectStyles, filtered: &FilteredObjects, filtered_out: FilteredOut) {
    if filtered_out == FilteredOut::Keep {
        filtered.passing.iter().for_each(|id| styles.set_colour(id, HIGHLIGHT_RGB));
    }
}

fn filter_out(styles: &mut ObjectStyles, filtered: &FilteredObjects, filtered_out: FilteredOut) {
    for id in &filtered.others {
        match filtered_out {
            FilteredOut::Hide => styles.hide(id),
            FilteredOut::Ghost => styles.set_colour(id, GHOST_RGB),
            FilteredOut::Keep => {}
        }
    }
}

/// Colours the objects of all kinds of which one has a value, itself or by its parent.
fn set_colours(styles: &mut ObjectStyles, facts: &BTreeMap<u32, Facts>, no_data: [u8; 3]) {
    let of_parts = colours_of_parts(facts);
    let colour = |id: u32, object: &Facts| {
        let inherited = object.rgb.or_else(|| facts.get(&object.parent?)?.rgb);
        inherited.or_else(|| of_parts.get(&id).copied())
    };
    let with_colour = facts.iter().filter(|(id, object)| colour(**id, object).is_some());
    let kinds: BTreeSet<FeatureKind> = with_colour.map(|(_, object)| object.kind).collect();
    for (&id, object) in facts.iter().filter(|(_, object)| kinds.contains(&object.kind)) {
        styles.set_colour(id, colour(id, object).unwrap_or(no_data));
    }
}

/// The colours of wholes without a value, by the largest number of their parts.
fn colours_of_parts(facts: &BTreeMap<u32, Facts>) -> BTreeMap<u32, [u8; 3]> {
    let numbers = facts.values().filter_map(|part| {
        let (number, rgb, parent) = (part.number?, part.rgb?, part.parent?);
        let whole = facts.get(&parent)?;
        (whole.rgb.is_none() && part.kind.is_part_of(whole.kind)).then_some((parent, number, rgb))
    });
    of_largest_numbers(numbers)
}

fn rgb_of(color: &ColorBy, value: Option<&Value>) -> [u8; 3] {
    let [r, g, b, _] = color.rgba(value);
    [r, g, b]
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_objects::{ObjectRecord, SchemaBuilder, block};
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
    fn wholes_have_the_colour_of_the_largest_number_of_their_parts() {
        let record = |kind, parent, roof: Option<f64>| {
            let attributes = roof.map(|roof| (0, Value::Float(roof))).into_iter().collect();
            Some(ObjectRecord { identifier: String::new(), kind, parent, bounds: None, attributes })
        };
        let records = [
            record(FeatureKind::Building, None, None),
            record(FeatureKind::BuildingPart, Some(0), Some(6.0)),
            record(FeatureKind::BuildingPart, Some(0), Some(22.0)),
            record(FeatureKind::Generic, None, None),
            record(FeatureKind::Building, Some(3), Some(22.0)),
        ];
        let mut builder = SchemaBuilder::default();
        [6.0, 22.0].iter().for_each(|roof| builder.add("roof", &Value::Float(*roof)));
        let schema = builder.finish(6);
        let block = ObjectBlock::decode(0, &block::encode(0, &records, &schema).unwrap(), &schema).unwrap();
        let color = Some(ColorBy::parse("roof", &schema).unwrap());
        let (words, _) = styles(&ObjectQuery { color, ..ObjectQuery::default() }, &block);
        assert_eq!([words[0], words[4]], [words[2]; 2]);
        // A group of houses is no house.
        assert!(words[1] != words[2] && words[3] == 0);
    }

    #[test]
    fn objects_that_do_not_pass_are_hidden_and_terrain_stays() {
        let (schema, block) = town();
        let filter = Some(Filter::parse("year < 1900", &schema).unwrap());
        let query = ObjectQuery { filter, filtered_out: FilteredOut::Hide, color: None };
        let (words, passing) = styles(&query, &block);
        assert_eq!(words, [0, 0, 0, 0, PALETTE_HIDDEN, PALETTE_HIDDEN]);
        assert_eq!(passing, 1, "a house with its parts");
    }
}
