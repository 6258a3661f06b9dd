//! A filter over all objects of a city: which pass, and which are filtered out.
//!
//! A part passes if its parent does. Where it lacks a value, it has that of its parent, and a whole has the largest of its parts. Kinds of
//! which no object passes, such as terrain, are neither: they stay as they are.

use super::Filter;
use super::evaluate::{ObjectInFamily, ObjectRow};
use super::parts::{self, PartFacts};
use crate::block::ObjectBlock;
use crate::kind::FeatureKind;
use insula_protocol::DecodeError;
use insula_protocol::object_tile::block_of_object;
use roaring::RoaringBitmap;
use std::collections::{BTreeMap, BTreeSet};

/// The first word of a bitmap without runs, in Roaring's portable format. Others could expand to much more than their bytes.
const COOKIE_WITHOUT_RUNS: u32 = 12_346;

/// Objects by a filter.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FilteredObjects {
    /// Objects that pass, and the parts of those.
    pub passing: RoaringBitmap,
    /// Objects of the same kinds that do not.
    pub others: RoaringBitmap,
    /// Objects that pass, or of which a part does: a building counts once with its parts, as in tables.
    pub passing_wholes: u32,
}

/// Evaluates a filter on the blocks of a city: on one after the other by [`FilterBuilder::add`], then on the pairs of
/// [`FilterBuilder::apart`].
#[derive(Debug, Default)]
pub struct FilterBuilder {
    passing: RoaringBitmap,
    by_kind: BTreeMap<FeatureKind, RoaringBitmap>,
    /// Parts and their parents.
    parts: Vec<[u32; 2]>,
    apart: BTreeSet<[u32; 2]>,
    /// Parts of the wholes of the block of parents that was taken last, and its number.
    of_parts: Option<(u32, BTreeMap<u32, PartFacts>)>,
}

impl FilterBuilder {
    /// Evaluates the filter on the objects of a block.
    pub fn add(&mut self, block: &ObjectBlock, filter: &Filter) {
        self.passing |= filter.select(block);
        for &id in block.ids() {
            if let Some(kind) = block.kind(id) {
                self.by_kind.entry(kind).or_default().insert(id);
            }
            let Some(parent) = block.parent(id) else { continue };
            self.parts.push([id, parent]);
            if block_of_object(parent) != block_of_object(id) {
                self.apart.insert([block_of_object(parent), block_of_object(id)]);
            }
        }
    }

    /// Pairs of blocks of which the first has parents of objects in the second, after all blocks were added. They are few: a parent
    /// mostly stands next to its parts.
    pub fn apart(&self) -> Vec<[u32; 2]> {
        self.apart.iter().copied().collect()
    }

    /// Evaluates the filter again on the objects of a block whose parents are in another one, and on these parents. Pairs with the same
    /// block of parents follow one another, as [`FilterBuilder::apart`] has them.
    pub fn add_apart(&mut self, parents: &ObjectBlock, block: &ObjectBlock, filter: &Filter) {
        let Some(number) = parents.ids().first().map(|id| block_of_object(*id)) else { return };
        let in_block = parts::by_whole(block, block, filter.attributes());
        for &id in block.ids() {
            let parent = block.parent(id).and_then(|parent| ObjectRow::of(parents, parent));
            let (Some(object), true) = (ObjectRow::of(block, id), parent.is_some()) else { continue };
            let passes = filter.expression.holds(&ObjectInFamily { object, parent, parts: in_block.get(&id) });
            self.set(id, passes);
        }
        let known = self.of_parts.take().filter(|(known, _)| *known == number).map(|(_, of_parts)| of_parts);
        let mut of_parts = known.unwrap_or_else(|| parts::by_whole(parents, parents, filter.attributes()));
        for (whole, facts) in parts::by_whole(parents, block, filter.attributes()) {
            let all = of_parts.entry(whole).or_default();
            all.merge(facts);
            // What has its own parent in a third block keeps the values of that one: parts of parts are seldom so far apart.
            let is_complete = parents.parent(whole).is_none_or(|parent| ObjectRow::of(parents, parent).is_some());
            if let Some(object) = ObjectRow::of(parents, whole).filter(|_| is_complete) {
                let passes = filter.holds(object, Some(all));
                self.set(whole, passes);
            }
        }
        self.of_parts = Some((number, of_parts));
    }

    fn set(&mut self, object: u32, passes: bool) {
        if passes {
            self.passing.insert(object);
        } else {
            self.passing.remove(object);
        }
    }

    /// The result for all blocks that were added.
    pub fn finish(self) -> FilteredObjects {
        let of_parents = self.parts.iter().filter(|[_, parent]| self.passing.contains(*parent)).map(|[part, _]| *part);
        let parts: RoaringBitmap = of_parents.collect();
        let passing = self.passing | parts;
        let is_filtered = |objects: &&RoaringBitmap| !objects.is_disjoint(&passing);
        let others = self.by_kind.values().filter(is_filtered).fold(RoaringBitmap::new(), |all, objects| all | objects);
        let kind_of = |id| self.by_kind.iter().find(|(_, objects)| objects.contains(id)).map(|(kind, _)| *kind);
        let mut wholes = passing.clone();
        for [part, parent] in self.parts.into_iter().filter(|[part, _]| passing.contains(*part)) {
            let is_part = |part: FeatureKind| kind_of(parent).is_some_and(|parent| part.is_part_of(parent));
            if kind_of(part).is_some_and(is_part) {
                wholes.remove(part);
                wholes.insert(parent);
            }
        }
        FilteredObjects { others: others - &passing, passing, passing_wholes: wholes.len() as u32 }
    }
}

impl FilteredObjects {
    /// The bytes for a client: the length of the first bitmap (u32), `passing`, `others`, `passing_wholes` (u32).
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = (self.passing.serialized_size() as u32).to_le_bytes().to_vec();
        for bitmap in [&self.passing, &self.others] {
            // Writing to memory does not fail.
            let _ = bitmap.serialize_into(&mut bytes);
        }
        bytes.extend_from_slice(&self.passing_wholes.to_le_bytes());
        bytes
    }

    /// Reads what [`FilteredObjects::encode`] wrote. Fails if the bytes are anything else.
    pub fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        let invalid = DecodeError::Invalid("the result of a filter has no two bitmaps");
        let Some((length, rest)) = bytes.split_first_chunk() else { return Err(invalid) };
        let Some((first, second)) = rest.split_at_checked(u32::from_le_bytes(*length) as usize) else {
            return Err(invalid);
        };
        let [Some(passing), Some(others)] = [first, second].map(bitmap) else { return Err(invalid) };
        // Earlier servers do not send it.
        let count = second.get(others.serialized_size()..).and_then(<[u8]>::first_chunk);
        let passing_wholes = count.map_or(passing.len() as u32, |count| u32::from_le_bytes(*count));
        Ok(Self { passing, others, passing_wholes })
    }
}

fn bitmap(bytes: &[u8]) -> Option<RoaringBitmap> {
    bytes.first_chunk().filter(|cookie| u32::from_le_bytes(**cookie) == COOKIE_WITHOUT_RUNS)?;
    RoaringBitmap::deserialize_from(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ObjectBounds, ObjectRecord, Schema, SchemaBuilder, Value, block};

    /// A terrain, an old house with a part, a new house.
    fn filtered(text: &str) -> FilteredObjects {
        let record = |kind, parent, year: Option<i64>| {
            let attributes = year.map(|year| (0, Value::Integer(year))).into_iter().collect();
            Some(ObjectRecord { identifier: String::new(), kind, parent, bounds: None, attributes })
        };
        let records = [
            record(FeatureKind::Relief, None, None),
            record(FeatureKind::Building, None, Some(1650)),
            record(FeatureKind::BuildingPart, Some(1), None),
            record(FeatureKind::Building, None, Some(2010)),
        ];
        let mut schema = SchemaBuilder::default();
        [1650, 2010].iter().for_each(|year| schema.add("year", &Value::Integer(*year)));
        let schema = schema.finish(4);
        let bytes = block::encode(0, &records, &schema).unwrap();
        let mut builder = FilterBuilder::default();
        builder.add(&ObjectBlock::decode(0, &bytes, &schema).unwrap(), &Filter::parse(text, &schema).unwrap());
        builder.finish()
    }

    #[test]
    fn parts_pass_with_their_parents_and_other_kinds_stay() {
        let FilteredObjects { passing, others, passing_wholes } = filtered("year < 1900");
        assert_eq!((passing.iter().collect(), others.iter().collect()), (vec![1, 2], vec![3]));
        assert_eq!(passing_wholes, 1, "a house with its part");
        assert_eq!(filtered("kind == \"building-part\"").passing_wholes, 1);
        assert_eq!(filtered("year > 3000"), FilteredObjects::default());
    }

    /// Checks which objects of two blocks pass filters. The second block has parts of objects of the first one.
    fn check_two_blocks(schema: &Schema, records: [&[Option<ObjectRecord>]; 2], cases: &[(&str, &[u32])]) {
        let [first, second] = [0, 1].map(|number: u32| {
            let bytes = block::encode(number, records[number as usize], schema).unwrap();
            ObjectBlock::decode(number, &bytes, schema).unwrap()
        });
        for (text, expected) in cases {
            let filter = Filter::parse(text, schema).unwrap();
            let mut builder = FilterBuilder::default();
            [&first, &second].into_iter().for_each(|block| builder.add(block, &filter));
            assert_eq!(builder.apart(), [[0, 1]]);
            builder.add_apart(&first, &second, &filter);
            assert_eq!(builder.finish().passing.iter().collect::<Vec<_>>(), *expected, "{text}");
        }
    }

    #[test]
    fn parts_have_the_values_of_their_parents_in_any_block() {
        let mut schema = SchemaBuilder::default();
        schema.add("year", &Value::Integer(1650));
        let schema = schema.finish(1024);
        let record = |parent, bounds, attributes| {
            Some(ObjectRecord { identifier: String::new(), kind: FeatureKind::Building, parent, bounds, attributes })
        };
        let high = Some(ObjectBounds { min: [0; 3], max: [9, 9, 300] });
        // Object 0 is a house without a shape; its parts are object 1, and object 512 of the next block.
        let house = record(None, None, vec![(0, Value::Integer(1650))]);
        let part = || record(Some(0), high, Vec::new());
        check_two_blocks(
            &schema,
            [&[house, part()], &[part(), record(None, high, Vec::new())]],
            &[
                ("year < 1900 && height > 20", &[0, 1, 512]),
                ("!(year < 1900)", &[513]),
                ("year == null", &[513]),
                ("year < 1900", &[0, 1, 512]),
            ],
        );
    }

    #[test]
    fn wholes_have_the_largest_numbers_of_their_parts_in_any_block() {
        let mut schema = SchemaBuilder::default();
        schema.add("year", &Value::Integer(1650));
        schema.add("roof", &Value::Float(8.63));
        let schema = schema.finish(1024);
        let boxed = |low, high| Some(ObjectBounds { min: [0, 0, low], max: [9, 9, high] });
        let record = |kind, parent, bounds, attributes| {
            Some(ObjectRecord { identifier: String::new(), kind, parent, bounds, attributes })
        };
        let part = |parent, bounds, roof| {
            record(FeatureKind::BuildingPart, Some(parent), bounds, vec![(1, Value::Float(roof))])
        };
        let house = |year| record(FeatureKind::Building, None, None, vec![(0, Value::Integer(year))]);
        // House 0 has a low part beside it, and the upper floors, object 512, in the next block. House 2 has one part; 4 is a group
        // of houses, which are no parts of it.
        let first = [
            house(1990),
            part(0, boxed(0, 60), 6.0),
            house(1960),
            part(2, boxed(0, 90), 9.0),
            record(FeatureKind::Generic, None, None, Vec::new()),
            record(FeatureKind::Building, Some(4), boxed(0, 300), vec![(1, Value::Float(30.0))]),
        ];
        check_two_blocks(
            &schema,
            [&first, &[part(0, boxed(60, 220), 22.0)]],
            &[
                ("height > 20 && year > 1950", &[0, 1, 512]),
                ("height > 8 && year > 1950", &[0, 1, 2, 3, 512]),
                ("roof > 20", &[0, 1, 5, 512]),
                ("roof > 20 && year > 1950", &[0, 1, 512]),
                ("kind == \"building\" && roof == null", &[]),
                ("kind == \"generic\" && roof == null", &[4, 5]),
            ],
        );
    }

    #[test]
    fn bytes_have_both_bitmaps_and_no_runs() {
        let mut objects = filtered("year < 1900");
        objects.others = (5..200_000).collect();
        let bytes = objects.encode();
        assert_eq!(FilteredObjects::decode(&bytes), Ok(objects));
        for end in 0..bytes.len().min(64) {
            assert!(FilteredObjects::decode(&bytes[..end]).is_err(), "{end} bytes");
        }
        let mut with_runs: RoaringBitmap = (0..1 << 20).collect();
        with_runs.optimize();
        let mut expanding = (with_runs.serialized_size() as u32).to_le_bytes().to_vec();
        (0..2).for_each(|_| with_runs.serialize_into(&mut expanding).unwrap());
        assert!(FilteredObjects::decode(&expanding).is_err());
    }
}
