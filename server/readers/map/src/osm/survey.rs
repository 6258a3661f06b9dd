//! The first pass over a file: which objects it has, and its trees.

use super::classes::{POINT_STRUCTURE, Verdict, classify, is_point_structure, plant};
use super::coast;
use super::collect::{Work, is_part, outline_of};
use super::element::{Element, ElementFile, ElementId, Member, Pass, Position, Tags, degrees};
use super::emit::{attributes, is_in_bbox};
use super::relations::{self, Kept, Relations};
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::{FeatureKind, ObjectSink, Shape, SourceObject};
use std::ops::ControlFlow;

/// More building parts with a named outline are refused.
const MAX_NAMED: usize = 16 << 20;

/// What a file has.
#[derive(Debug, Default)]
pub(super) struct Survey {
    pub(super) relations: Relations,
    /// Building parts with the outlines that relations name; sorted.
    pub(super) named_outlines: Vec<(ElementId, ElementId)>,
    pub(super) way_count: u64,
    /// Nodes of coastlines.
    pub(super) coast: Vec<Vec<i64>>,
    coast_nodes: usize,
    /// Numbers of the first and the last building part among the ways, the latter exclusive.
    part_ways: [u64; 2],
}

impl Survey {
    /// Reads a file through for the first time; adds the trees.
    pub(super) fn read(
        input: &Input<'_>,
        file: &mut dyn ElementFile,
        sink: &mut dyn ObjectSink,
    ) -> Result<Self, InputError> {
        let mut survey = Self { part_ways: [u64::MAX, 0], ..Self::default() };
        file.read_through(Pass::First, sink, &mut |element, sink| {
            match element {
                Element::Node { id, position, tags } => add_plant(input, id, position, tags, sink)?,
                Element::Way { number, refs, tags, .. } => survey.way(number, refs, tags),
                Element::Relation { id, members, tags } => survey.relation(input, id, members, tags, sink)?,
            }
            Ok(ControlFlow::Continue(()))
        })?;
        for id in survey.relations.finish() {
            sink.skip(relations::TOO_SHARED, ElementId::Relation(id).to_string());
        }
        survey.named_outlines.sort_unstable();
        survey.named_outlines.dedup_by_key(|(part, _)| *part);
        Ok(survey)
    }

    /// Whether the coast has too many nodes.
    pub(super) fn coast_is_too_long(&self) -> bool {
        self.coast_nodes > coast::MAX_NODES
    }

    /// All that the file has to be read for.
    pub(super) fn work(&self) -> Work {
        let [first, end] = self.part_ways;
        Work { part_ways: first.min(end)..end, ways: 0..self.way_count, relations: 0..self.relations.list().len() }
    }

    /// The outline that a relation names for a building part.
    pub(super) fn named_outline(&self, part: ElementId) -> Option<ElementId> {
        let place = self.named_outlines.binary_search_by_key(&part, |(part, _)| *part).ok()?;
        self.named_outlines.get(place).map(|(_, outline)| *outline)
    }

    fn way(&mut self, number: u64, refs: &[i64], tags: Tags<'_>) {
        self.way_count = number + 1;
        if tags.get("natural") == Some("coastline") {
            self.coast_nodes += refs.len();
            // What is too long has no sea, see `coast_is_too_long`.
            if !self.coast_is_too_long() {
                self.coast.push(refs.to_vec());
            }
        }
        if let Verdict::Object(class) = classify(tags, outline_of(refs))
            && is_part(class.kind)
        {
            let [first, _] = self.part_ways;
            self.part_ways = [first.min(number), number + 1];
        }
    }

    fn relation(
        &mut self,
        input: &Input<'_>,
        id: i64,
        members: &[Member<'_>],
        tags: Tags<'_>,
        sink: &mut dyn ObjectSink,
    ) -> Result<(), InputError> {
        let too_large = |what: &str, limit: usize| {
            Err(InputError::TooLarge { path: input.label.to_owned(), what: what.to_owned(), limit: limit as u64 })
        };
        if tags.get("type") == Some("building") {
            self.name_outline(members);
            let is_too_large = self.named_outlines.len() > MAX_NAMED;
            return if is_too_large { too_large("the number of its building parts", MAX_NAMED) } else { Ok(()) };
        }
        match self.relations.push(id, members, tags) {
            Kept::Yes | Kept::No => Ok(()),
            Kept::LeftOut(reason) => {
                sink.skip(reason, ElementId::Relation(id).to_string());
                Ok(())
            }
            Kept::TooMany => too_large("the size of its relations in bytes", relations::MAX_BYTES),
        }
    }

    /// Notes the parts of a building with one outline.
    fn name_outline(&mut self, members: &[Member<'_>]) {
        let of_role = |role: &'static [u8]| {
            members.iter().filter(move |member| member.role == role).filter_map(|member| member.element)
        };
        if let Some(outline) = of_role(b"outline").next() {
            let parts = of_role(b"part").filter(|part| *part != outline);
            self.named_outlines.extend(parts.map(|part| (part, outline)));
        }
    }
}

/// Adds a node that is a tree or a shrub, and counts one that is another structure.
fn add_plant(
    input: &Input<'_>,
    id: i64,
    position: Position,
    tags: Tags<'_>,
    sink: &mut dyn ObjectSink,
) -> Result<(), InputError> {
    let (plant, is_structure) = (plant(tags), is_point_structure(tags));
    if plant.is_none() && !is_structure || !is_in_bbox(input.bbox_deg, [&position]) {
        return Ok(());
    }
    if is_structure {
        sink.skip(POINT_STRUCTURE, format!("node/{id}"));
    }
    let Some(value) = plant else { return Ok(()) };
    sink.add(SourceObject {
        id: format!("node/{id}"),
        parent: None,
        kind: FeatureKind::Vegetation,
        source_type: format!("natural={value}"),
        lod: None,
        attributes: attributes(tags),
        shape: Shape::Points(vec![degrees(position).into()]),
    })
}
