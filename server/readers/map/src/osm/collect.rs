//! One round of reading: as many ways and multipolygons as have room in memory, and the nodes that they need.

use super::classes::{Outline, Verdict, classify};
use super::element::{Element, ElementFile, Pass, Tags};
use super::nodes::NodeStore;
use super::relations::{Relation, Relations};
use insula_source::error::InputError;
use insula_source::object::{FeatureKind, ObjectSink};
use std::collections::HashMap;
use std::ops::{ControlFlow, Range};

/// Limits of a round, in references to nodes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// Of building parts, and of other ways.
    pub(super) way_refs: usize,
    /// Of ways of multipolygons; they are kept from one pass to the next.
    pub(super) member_refs: usize,
    /// Of a single multipolygon.
    pub(super) relation_refs: usize,
}

impl Default for Limits {
    /// At most 16 M nodes of 16 bytes in a round, and 4 M references of 8 bytes.
    fn default() -> Self {
        Self { way_refs: 6 << 20, member_refs: 4 << 20, relation_refs: 32 << 20 }
    }
}

/// What a file still has to be read for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Work {
    /// Numbers of ways among which are building parts.
    pub(super) part_ways: Range<u64>,
    /// Numbers of the other ways.
    pub(super) ways: Range<u64>,
    /// Numbers of multipolygons, building parts first.
    pub(super) relations: Range<usize>,
}

impl Work {
    pub(super) fn is_empty(&self) -> bool {
        self.part_ways.is_empty() && self.ways.is_empty() && self.relations.is_empty()
    }
}

/// A part of the work, with all that it needs.
pub(super) struct Round {
    pub(super) work: Work,
    pub(super) nodes: NodeStore,
    pub(super) members: MemberWays,
}

/// Nodes of the ways of multipolygons.
#[derive(Debug, Default)]
pub(super) struct MemberWays {
    refs: Vec<i64>,
    places: HashMap<i64, Range<usize>>,
    is_too_large: bool,
}

impl MemberWays {
    /// Nodes of a way; `None` if the file lacks it.
    pub(super) fn get(&self, id: i64) -> Option<&[i64]> {
        self.refs.get(self.places.get(&id)?.clone())
    }

    /// Whether the single multipolygon of the round was too large to keep.
    pub(super) fn is_too_large(&self) -> bool {
        self.is_too_large
    }

    fn push(&mut self, id: i64, refs: &[i64]) {
        let start = self.refs.len();
        self.refs.extend_from_slice(refs);
        self.places.entry(id).or_insert(start..self.refs.len());
    }

    /// Drops the ways that are not among sorted identifiers.
    fn retain(&mut self, ids: &[i64]) {
        let old = std::mem::take(self);
        for (id, place) in old.places.into_iter().filter(|(id, _)| ids.binary_search(id).is_ok()) {
            self.push(id, &old.refs[place]);
        }
    }
}

/// Which of both kinds of plain ways a way is.
pub(super) fn is_part(kind: FeatureKind) -> bool {
    kind == FeatureKind::BuildingPart
}

pub(super) fn outline_of(refs: &[i64]) -> Outline {
    let is_closed = refs.len() > 1 && refs.first() == refs.last();
    if is_closed { Outline::ClosedWay } else { Outline::OpenWay }
}

impl Round {
    /// Takes as much of `work` as the limits allow, building parts first, and reads its nodes.
    pub(super) fn collect(
        work: &Work,
        limits: Limits,
        relations: &mut Relations,
        file: &mut dyn ElementFile,
        sink: &mut dyn ObjectSink,
    ) -> Result<Self, InputError> {
        let mut collector = Collector::new(work, limits, relations);
        let first = work.part_ways.start.min(work.ways.start);
        let first = if work.relations.is_empty() { first } else { 0 };
        file.read_through(Pass::Ways(first..u64::MAX), sink, &mut |element, _| {
            let Element::Way { id, number, refs, tags } = element else { return Ok(ControlFlow::Continue(())) };
            collector.way(id, number, refs, tags);
            let is_done = collector.is_done();
            Ok(if is_done { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
        })?;
        let Collector { mut round, part_refs, way_refs, members, .. } = collector;
        let is_last_part = round.part_ways.end == work.part_ways.end;
        let mut needed = part_refs;
        if is_last_part && round.relations.end >= relations.part_count().min(work.relations.end) {
            needed.extend_from_slice(&way_refs);
        } else {
            // Outlines wait for all parts.
            round.ways.end = round.ways.start;
            round.relations.end = round.relations.end.min(relations.part_count().max(round.relations.start));
        }
        drop(way_refs);
        needed.extend_from_slice(&members.refs);
        let nodes = NodeStore::read(needed, file, sink)?;
        Ok(Self { work: round, nodes, members })
    }
}

struct Collector<'r> {
    round: Work,
    limits: Limits,
    relations: &'r mut Relations,
    part_refs: Vec<i64>,
    way_refs: Vec<i64>,
    members: MemberWays,
    /// Ways of the round's multipolygons, sorted.
    wanted: Vec<i64>,
    is_parts_full: bool,
    is_ways_full: bool,
}

impl<'r> Collector<'r> {
    fn new(work: &Work, limits: Limits, relations: &'r mut Relations) -> Self {
        let wanted = wanted_ways(relations, &work.relations);
        Self {
            round: work.clone(),
            limits,
            relations,
            part_refs: Vec::new(),
            way_refs: Vec::new(),
            members: MemberWays::default(),
            wanted,
            is_parts_full: work.part_ways.is_empty(),
            is_ways_full: work.ways.is_empty(),
        }
    }

    fn is_done(&self) -> bool {
        self.is_parts_full && self.is_ways_full && self.wanted.is_empty()
    }

    fn way(&mut self, id: i64, number: u64, refs: &[i64], tags: Tags<'_>) {
        if self.wanted.binary_search(&id).is_ok() {
            self.relations.adopt_tags(id, tags, self.round.relations.clone());
            self.members.push(id, refs);
            self.shrink();
        }
        let is_for_parts = !self.is_parts_full && self.round.part_ways.contains(&number);
        let is_for_ways = !self.is_ways_full && self.round.ways.contains(&number);
        if !is_for_parts && !is_for_ways {
            return;
        }
        if let Verdict::Object(class) = classify(tags, outline_of(refs)) {
            // The last node of a ring is its first.
            let refs = if outline_of(refs) == Outline::ClosedWay { &refs[1..] } else { refs };
            match (is_part(class.kind), is_for_parts, is_for_ways) {
                (true, true, _) => self.part_refs.extend_from_slice(refs),
                (false, _, true) => self.way_refs.extend_from_slice(refs),
                _ => {}
            }
        }
        if is_for_parts && self.part_refs.len() >= self.limits.way_refs {
            self.is_parts_full = true;
            self.round.part_ways.end = number + 1;
        }
        if is_for_ways && self.way_refs.len() >= self.limits.way_refs {
            self.is_ways_full = true;
            self.round.ways.end = number + 1;
        }
    }

    /// Leaves multipolygons to later rounds while their ways have too many nodes.
    fn shrink(&mut self) {
        while self.members.refs.len() > self.limits.member_refs && self.round.relations.len() > 1 {
            let range = &mut self.round.relations;
            range.end = range.start + range.len() / 2;
            self.wanted = wanted_ways(self.relations, range);
            self.members.retain(&self.wanted);
        }
        if self.members.refs.len() > self.limits.relation_refs {
            self.members = MemberWays { is_too_large: true, ..MemberWays::default() };
            self.wanted.clear();
        }
    }
}

fn wanted_ways(relations: &Relations, range: &Range<usize>) -> Vec<i64> {
    let list: &[Relation] = relations.list().get(range.clone()).unwrap_or_default();
    let mut wanted: Vec<i64> = list.iter().flat_map(|relation| relations.members(relation)).map(|way| way.id).collect();
    wanted.sort_unstable();
    wanted.dedup();
    wanted
}
