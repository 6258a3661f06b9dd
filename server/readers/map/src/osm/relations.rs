//! The multipolygons of a file: their tags, and the ways that they are made of.

use super::classes::{Class, Form, Outline, Verdict, classify, tell_nothing};
use super::element::{ElementId, Member, Tags};
use insula_source::object::FeatureKind;

/// More bytes of members and tags of all relations are refused. A country has some ten million.
pub(super) const MAX_BYTES: usize = 1 << 31;

/// Multipolygons that a way may be part of. It is the border of a few as a rule, and each is as much work as the way is long.
const MAX_AROUND: usize = 64;
/// Why others are left out.
pub(super) const TOO_SHARED: &str = "multipolygon with a way of more than 64 others";

/// A multipolygon.
#[derive(Debug, Clone)]
pub(super) struct Relation {
    pub(super) id: i64,
    /// `None` if its tags tell nothing and are to be taken from its outer ways.
    pub(super) class: Option<Class>,
    /// Whether its class is that of an outer way.
    is_adopted: bool,
    /// Range in the members of all.
    members: [u32; 2],
    /// Range in the places of tags of all.
    spans: [u32; 2],
}

impl Relation {
    pub(super) fn is_building_part(&self) -> bool {
        self.class.is_some_and(|class| class.kind == FeatureKind::BuildingPart)
    }
}

/// A way of a multipolygon.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MemberWay {
    pub(super) id: i64,
    pub(super) is_inner: bool,
}

/// What is kept of a relation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kept {
    Yes,
    /// It is no object.
    No,
    /// It is an object that is left out, with the reason.
    LeftOut(&'static str),
    /// There are too many relations.
    TooMany,
}

/// Multipolygons that are or may be objects; building parts come first after [`Self::finish`].
#[derive(Debug, Default)]
pub(super) struct Relations {
    list: Vec<Relation>,
    members: Vec<MemberWay>,
    text: Vec<u8>,
    spans: Vec<[u32; 4]>,
    /// Ways that are not inner rings, with their relations' numbers; sorted.
    outer_ways: Vec<(i64, u32)>,
}

impl Relations {
    /// Takes a relation if it is a multipolygon of a city.
    pub(super) fn push(&mut self, id: i64, members: &[Member<'_>], tags: Tags<'_>) -> Kept {
        if tags.get("type") != Some("multipolygon") {
            return Kept::No;
        }
        let class = match classify(tags, Outline::Multipolygon) {
            Verdict::Object(class) => Some(class),
            Verdict::LeftOut(reason) => return Kept::LeftOut(reason),
            Verdict::Other if tell_nothing(tags) => None,
            Verdict::Other => return Kept::No,
        };
        if self.text.len() + self.members.len() * size_of::<MemberWay>() + self.spans.len() * 16 > MAX_BYTES {
            return Kept::TooMany;
        }
        let first = self.members.len() as u32;
        let ways = members.iter().filter_map(|member| match member.element {
            Some(ElementId::Way(id)) => Some(MemberWay { id, is_inner: member.role == b"inner" }),
            _ => None,
        });
        self.members.extend(ways);
        let spans = self.keep_tags(tags);
        self.list.push(Relation { id, class, is_adopted: false, members: [first, self.members.len() as u32], spans });
        Kept::Yes
    }

    fn keep_tags(&mut self, tags: Tags<'_>) -> [u32; 2] {
        let first = self.spans.len() as u32;
        for (key, value) in tags.iter() {
            let start = self.text.len() as u32;
            self.text.extend_from_slice(key);
            let middle = self.text.len() as u32;
            self.text.extend_from_slice(value);
            self.spans.push([start, middle, middle, self.text.len() as u32]);
        }
        [first, self.spans.len() as u32]
    }

    /// Orders the relations, after the last one. Returns those that are left out because one of their ways is part of too many.
    pub(super) fn finish(&mut self) -> Vec<i64> {
        self.list.sort_by_key(|relation| !relation.is_building_part());
        let too_shared = self.too_shared();
        let mut left_out = Vec::new();
        let mut number = 0;
        self.list.retain(|relation| {
            let is_kept = too_shared.binary_search(&number).is_err();
            number += 1;
            if !is_kept {
                left_out.push(relation.id);
            }
            is_kept
        });
        for (relation, number) in self.list.iter().zip(0..) {
            let members = &self.members[relation.members[0] as usize..relation.members[1] as usize];
            self.outer_ways.extend(members.iter().filter(|way| !way.is_inner).map(|way| (way.id, number)));
        }
        self.outer_ways.sort_unstable();
        left_out
    }

    /// Numbers of the relations with a way that is part of [`MAX_AROUND`] before them; sorted.
    fn too_shared(&self) -> Vec<u32> {
        let ways = |relation| self.members(relation).iter().map(|way| way.id);
        let mut uses: Vec<(i64, u32)> = (self.list.iter().zip(0..))
            .flat_map(|(relation, number)| ways(relation).map(move |way| (way, number)))
            .collect();
        uses.sort_unstable();
        uses.dedup();
        let mut numbers: Vec<u32> = uses
            .chunk_by(|a, b| a.0 == b.0)
            .flat_map(|way| way.iter().skip(MAX_AROUND).map(|(_, number)| *number))
            .collect();
        numbers.sort_unstable();
        numbers
    }

    pub(super) fn list(&self) -> &[Relation] {
        &self.list
    }

    pub(super) fn part_count(&self) -> usize {
        self.list.partition_point(Relation::is_building_part)
    }

    pub(super) fn members(&self, relation: &Relation) -> &[MemberWay] {
        &self.members[relation.members[0] as usize..relation.members[1] as usize]
    }

    pub(super) fn tags(&self, relation: &Relation) -> Tags<'_> {
        Tags { text: &self.text, spans: &self.spans[relation.spans[0] as usize..relation.spans[1] as usize] }
    }

    /// The multipolygons of which a way is an outer ring or a piece of one.
    pub(super) fn around(&self, way: i64) -> impl Iterator<Item = &Relation> {
        let first = self.outer_ways.partition_point(|(id, _)| *id < way);
        let own = self.outer_ways[first..].iter().take_while(move |(id, _)| *id == way);
        own.take(MAX_AROUND).filter_map(|(_, number)| self.list.get(*number as usize))
    }

    /// Whether a way's tags are those of a multipolygon around it, so that the way is no object of its own.
    pub(super) fn speaks_for(&self, way: i64, class: Class, tags: Tags<'_>) -> bool {
        class.form == Form::Area
            && self.around(way).any(|relation| match relation.class {
                None => true,
                Some(_) if relation.is_adopted => true,
                Some(own) => {
                    let is_building = matches!(own.kind, FeatureKind::Building | FeatureKind::BuildingPart);
                    own.kind == class.kind
                        && own.key == class.key
                        && (is_building || self.tags(relation).get(own.key) == tags.get(own.key))
                }
            })
    }

    /// Whether a way's tags became those of a multipolygon around it.
    pub(super) fn adopts(&self, way: i64) -> bool {
        self.around(way).any(|relation| relation.class.is_none() || relation.is_adopted)
    }

    /// Gives relations without telling tags the tags of one of their outer ways. `range` limits their numbers.
    pub(super) fn adopt_tags(&mut self, way: i64, tags: Tags<'_>, range: std::ops::Range<usize>) {
        let first = self.outer_ways.partition_point(|(id, _)| *id < way);
        for next in first..first + MAX_AROUND {
            let Some(&(_, number)) = self.outer_ways.get(next).filter(|(id, _)| *id == way) else { return };
            let number = number as usize;
            let has_class = self.list.get(number).is_none_or(|relation| relation.class.is_some());
            if has_class || !range.contains(&number) || self.text.len() > MAX_BYTES {
                continue;
            }
            if let Verdict::Object(class) = classify(tags, Outline::Multipolygon) {
                let spans = self.keep_tags(tags);
                let relation = &mut self.list[number];
                (relation.class, relation.is_adopted, relation.spans) = (Some(class), true, spans);
            }
        }
    }
}
