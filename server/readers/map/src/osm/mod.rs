//! OpenStreetMap: `.osm.pbf`, `.osm` and `.osm.gz`.
//!
//! A file is read several times, because relations come after ways and ways after nodes. The first pass notes the
//! multipolygons and coastlines and adds the trees ([`survey`]). Then rounds of a limited number of nodes ([`collect`]) make objects of ways
//! and multipolygons: building parts first, so that outlines which they cover are left out. The parts themselves follow at
//! the end, when their outlines are known. Memory follows the limits of a round, the relations and the building parts, not
//! the file.

mod box_tree;
mod classes;
mod coast;
mod collect;
mod cover;
mod element;
mod emit;
mod nesting;
mod nodes;
mod parts;
mod pbf;
mod relations;
mod rings;
mod survey;
mod tagged;
#[cfg(test)]
mod tests;
mod xml;

pub(crate) use classes::NOT_BUILT;
use classes::{Class, Form, NOT_CLOSED, Outline, Verdict, classify, is_harbour};
use coast::Sea;
use collect::{Limits, Round, is_part, outline_of};
use cover::{Bounds, bounds};
use element::{Element, ElementFile, ElementId, Pass, Position, Tags, UNITS_PER_DEGREE};
use emit::{area_of_way, areas_of_relation, footprints, is_in_bbox, lines, object, pieces_of_way};
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::{CrsReference, Description, FeatureKind, ObjectSink, SourceObject};
use insula_source::problems::TOO_MANY;
use nesting::Polygon;
use nodes::NodeStore;
use parts::{Heights, OutlineFate, Parts};
use std::ops::{ControlFlow, Range};
use survey::Survey;
pub(crate) use tagged::kind_by_tags;

const AT_COAST: &str = "harbour at the sea, whose coastline tells what is water";
/// The sea reaches at most so far beyond the border of the map, in units: 550 m to the north.
const MOST_BEYOND: i32 = 50_000;
const COVERED: &str = "outline covered by its building parts";
/// Points of all building parts; they are in memory together.
const MAX_PART_BYTES: u64 = 4 << 30;
/// Nodes of multipolygons that are assembled for each byte of a file, and in any case. A way borders a few of them.
const ASSEMBLED_PER_BYTE: u64 = 16;
const MIN_ASSEMBLED: u64 = 1 << 20;
/// Ways between two reports of progress.
const WAYS_PER_TICK: u64 = 4096;

/// Reads a file of OpenStreetMap: PBF if its name ends in `.pbf`, XML otherwise. Positions are longitude and latitude in
/// degrees. Fails if the file is no such map, or is damaged.
pub fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    read_within(input, Limits::default(), sink)
}

fn read_within(input: &Input<'_>, limits: Limits, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    let is_pbf = input.name.to_ascii_lowercase().ends_with(".pbf");
    let mut file: Box<dyn ElementFile + '_> =
        if is_pbf { Box::new(pbf::PbfFile::open(input)?) } else { Box::new(xml::XmlFile::new(input)) };
    sink.describe(Description::Attribution, "OpenStreetMap contributors");
    sink.describe(Description::Licence, "ODbL 1.0");
    sink.set_crs(&CrsReference::east_first("OGC:CRS84"))?;
    let survey = Survey::read(input, &mut *file, sink)?;
    let size_bytes = input.files.len(input.name).map_err(|cause| InputError::io(input.label, cause))?;
    let assembled_left = MIN_ASSEMBLED + ASSEMBLED_PER_BYTE * size_bytes.min(u64::MAX >> 8);
    let mut reading = Reading {
        input,
        survey,
        parts: Parts::default(),
        size_bytes,
        assembled_left,
        extent: None,
        wanted_extent: None,
    };
    reading.read_objects(&mut *file, limits, sink)?;
    reading.add_sea(&mut *file, sink)?;
    reading.add_parts(&mut *file, sink)?;
    sink.tick(size_bytes);
    Ok(())
}

/// The passes after the first.
struct Reading<'a, 'i> {
    input: &'a Input<'i>,
    survey: Survey,
    parts: Parts,
    size_bytes: u64,
    /// Nodes of multipolygons that may still be assembled.
    assembled_left: u64,
    /// Bounds of what is on land so far.
    extent: Option<Bounds>,
    /// Of what is within the wanted area.
    wanted_extent: Option<Bounds>,
}

impl Reading<'_, '_> {
    fn read_objects(
        &mut self,
        file: &mut dyn ElementFile,
        limits: Limits,
        sink: &mut dyn ObjectSink,
    ) -> Result<(), InputError> {
        let mut work = self.survey.work();
        let part_relations = self.survey.relations.part_count();
        let mut has_all_parts = false;
        while !work.is_empty() {
            let round = Round::collect(&work, limits, &mut self.survey.relations, file, sink)?;
            let done = &round.work;
            self.collect_part_ways(done.part_ways.clone(), &round, file, sink)?;
            let parts_end = done.relations.end.min(part_relations).max(done.relations.start);
            self.collect_part_relations(done.relations.start..parts_end, &round, sink);
            if self.parts.bytes() > MAX_PART_BYTES {
                let (path, what) = (self.input.label.to_owned(), "the size of its building parts in bytes".to_owned());
                return Err(InputError::TooLarge { path, what, limit: MAX_PART_BYTES });
            }
            (work.part_ways.start, work.ways.start) = (done.part_ways.end, done.ways.end);
            work.relations.start = done.relations.end;
            if !has_all_parts && work.part_ways.is_empty() && work.relations.start >= part_relations {
                self.parts.finish();
                has_all_parts = true;
            }
            self.add_ways(done.ways.clone(), &round, file, sink)?;
            self.add_relations(parts_end..done.relations.end, &round, sink)?;
        }
        Ok(())
    }

    /// Keeps the building parts among ways.
    fn collect_part_ways(
        &mut self,
        ways: Range<u64>,
        round: &Round,
        file: &mut dyn ElementFile,
        sink: &mut dyn ObjectSink,
    ) -> Result<(), InputError> {
        if ways.is_empty() {
            return Ok(());
        }
        file.read_through(Pass::Ways(ways), sink, &mut |element, sink| {
            if let Some((id, refs, tags, class)) = object_way(element)
                && is_part(class.kind)
                && !self.survey.relations.speaks_for(id, class, tags)
            {
                let id = ElementId::Way(id);
                match area_of_way(refs, &round.nodes) {
                    Ok(polygon) => {
                        self.parts.push(id, &[polygon], Heights::of(tags), self.survey.named_outline(id));
                    }
                    Err(reason) => sink.skip(reason, id.to_string()),
                }
            }
            Ok(ControlFlow::Continue(()))
        })
    }

    fn collect_part_relations(&mut self, range: Range<usize>, round: &Round, sink: &mut dyn ObjectSink) {
        for number in range {
            let relations = &self.survey.relations;
            let relation = &relations.list()[number];
            let id = ElementId::Relation(relation.id);
            match areas_of_relation(relation, relations, &round.members, &round.nodes, &mut self.assembled_left) {
                Ok(polygons) => {
                    let heights = Heights::of(relations.tags(relation));
                    self.parts.push(id, &polygons, heights, self.survey.named_outline(id));
                }
                Err(reason) => sink.skip(reason, id.to_string()),
            }
        }
    }

    /// Adds the ways that are no building parts.
    fn add_ways(
        &mut self,
        ways: Range<u64>,
        round: &Round,
        file: &mut dyn ElementFile,
        sink: &mut dyn ObjectSink,
    ) -> Result<(), InputError> {
        if ways.is_empty() {
            return Ok(());
        }
        file.read_through(Pass::Ways(ways), sink, &mut |element, sink| {
            let Element::Way { id, number, refs, tags } = element else { return Ok(ControlFlow::Continue(())) };
            if number % WAYS_PER_TICK == 0 {
                let share = number as f64 / self.survey.way_count.max(1) as f64;
                sink.tick((self.size_bytes as f64 * (0.5 + 0.5 * share)) as u64);
            }
            match classify(tags, outline_of(refs)) {
                Verdict::Object(class) if !is_part(class.kind) => self.add_way(id, refs, tags, class, round, sink)?,
                // The open outer ways of a multipolygon may have its tags too.
                Verdict::LeftOut(reason)
                    if reason != NOT_CLOSED || self.survey.relations.around(id).next().is_none() =>
                {
                    sink.skip(reason, ElementId::Way(id).to_string());
                }
                _ => {}
            }
            Ok(ControlFlow::Continue(()))
        })
    }

    fn add_way(
        &mut self,
        way: i64,
        refs: &[i64],
        tags: Tags<'_>,
        class: Class,
        round: &Round,
        sink: &mut dyn ObjectSink,
    ) -> Result<(), InputError> {
        let id = ElementId::Way(way);
        if self.survey.relations.speaks_for(way, class, tags) {
            if outline_of(refs) == Outline::ClosedWay && !self.survey.relations.adopts(way) {
                sink.skip("outer ring with the tags of its multipolygon", id.to_string());
            }
            return Ok(());
        }
        if is_harbour(class, tags) && self.has_coast() {
            sink.skip(AT_COAST, id.to_string());
            return Ok(());
        }
        if class.form == Form::Area {
            let polygons = area_of_way(refs, &round.nodes).map(|polygon| vec![polygon]);
            self.widen(class, polygons.iter().flatten().flatten().flatten());
            return add_area(self.input, &mut self.parts, (id, class, tags), polygons, sink);
        }
        let (pieces, is_missing) = match pieces_of_way(refs, &round.nodes) {
            Ok(pieces) => pieces,
            Err(reason) => {
                sink.skip(reason, id.to_string());
                return Ok(());
            }
        };
        if is_missing {
            sink.problem("partly outside of the extract", id.to_string());
        }
        if !is_in_bbox(self.input.bbox_deg, pieces.iter().flatten()) {
            return Ok(());
        }
        self.widen(class, pieces.iter().flatten());
        sink.add(object(id, class, tags, None, lines(pieces, class.form)))
    }

    fn has_coast(&self) -> bool {
        !self.survey.coast.is_empty()
    }

    /// Notes where an object lies, if it is on land.
    fn widen<'p>(&mut self, class: Class, positions: impl IntoIterator<Item = &'p Position>) {
        if class.kind == FeatureKind::Water {
            return;
        }
        let Some([west, south, east, north]) = bounds(positions) else { return };
        let is_wanted = is_in_bbox(self.input.bbox_deg, &[[west, south], [east, north]]);
        for extent in [Some(&mut self.extent), is_wanted.then_some(&mut self.wanted_extent)].into_iter().flatten() {
            let [w, s, e, n] = extent.unwrap_or([west, south, east, north]);
            *extent = Some([w.min(west), s.min(south), e.max(east), n.max(north)]);
        }
    }

    /// Adds the sea, if there are coastlines: as far as the file says it reaches, else as far as there is land, and within the wanted
    /// area. Where objects of the land reach out of that, so does the sea, because ground lies around them.
    fn add_sea(&mut self, file: &mut dyn ElementFile, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
        let coast = std::mem::take(&mut self.survey.coast);
        if self.survey.coast_is_too_long() {
            sink.problem(TOO_MANY, format!("more than {}", coast::MAX_NODES));
            return Ok(());
        }
        let extent = file.extent().map(|[[west, south], [east, north]]| [west, south, east, north]).or(self.extent);
        let (Some([west, south, east, north]), false) = (extent, coast.is_empty()) else { return Ok(()) };
        let land = self.wanted_extent;
        let [w, s, e, n] = match self.input.bbox_deg {
            Some(bbox_deg) => grown(bbox_deg.map(|degrees| (degrees * UNITS_PER_DEGREE).round() as i32), land),
            None => [west, south, east, north],
        };
        let extent = [west.max(w), south.max(s), east.min(e), north.min(n)];
        let nodes = NodeStore::read(coast.iter().flatten().copied().collect(), file, sink)?;
        let pieces = coast.iter().filter_map(|refs| pieces_of_way(refs, &nodes).ok());
        let sea = Sea::new(pieces.flat_map(|(pieces, _)| pieces).collect(), extent, grown(extent, land));
        for (reason, place) in sea.problems {
            sink.problem(reason, place);
        }
        if sea.polygons.is_empty() {
            return Ok(());
        }
        let mut attributes = Attributes::default();
        attributes.push("natural", AttributeValue::Text("coastline".to_owned()));
        sink.add(SourceObject {
            id: "coastline".to_owned(),
            parent: None,
            kind: FeatureKind::Water,
            source_type: "natural=coastline".to_owned(),
            lod: None,
            attributes,
            shape: footprints(sea.polygons, false),
        })
    }

    fn add_relations(
        &mut self,
        range: Range<usize>,
        round: &Round,
        sink: &mut dyn ObjectSink,
    ) -> Result<(), InputError> {
        for number in range {
            let relation = &self.survey.relations.list()[number];
            // Without telling tags on its outer ways either it is no object.
            let Some(class) = relation.class else { continue };
            let polygons = areas_of_relation(
                relation, &self.survey.relations, &round.members, &round.nodes, &mut self.assembled_left,
            );
            self.widen(class, polygons.iter().flatten().flatten().flatten());
            let relations = &self.survey.relations;
            let relation = &relations.list()[number];
            let (id, tags) = (ElementId::Relation(relation.id), relations.tags(relation));
            if is_harbour(class, tags) && self.has_coast() {
                sink.skip(AT_COAST, id.to_string());
                continue;
            }
            add_area(self.input, &mut self.parts, (id, class, tags), polygons, sink)?;
        }
        Ok(())
    }

    /// Adds the building parts, in the order in which they were kept.
    fn add_parts(&mut self, file: &mut dyn ElementFile, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
        if self.parts.is_empty() {
            return Ok(());
        }
        let mut next = 0;
        let bbox_deg = self.input.bbox_deg;
        let parts = &self.parts;
        let mut add = |id: ElementId, class: Class, tags: Tags<'_>, sink: &mut dyn ObjectSink| {
            let Some(part) = parts.get(next, id) else { return Ok(()) };
            next += 1;
            if !is_in_bbox(bbox_deg, part.polygons.iter().flatten().flatten()) {
                return Ok(());
            }
            let shape = footprints(part.polygons, part.is_supported);
            let mut object = object(id, class, tags, part.parent, shape);
            for (key, value) in part.inherited {
                object.attributes.push(key, AttributeValue::Text(value.clone()));
            }
            sink.add(object)
        };
        file.read_through(Pass::Ways(self.survey.work().part_ways), sink, &mut |element, sink| {
            if let Some((id, _, tags, class)) = object_way(element).filter(|(.., class)| is_part(class.kind)) {
                add(ElementId::Way(id), class, tags, sink)?;
            }
            Ok(ControlFlow::Continue(()))
        })?;
        let relations = &self.survey.relations;
        for relation in &relations.list()[..relations.part_count()] {
            if let Some(class) = relation.class {
                add(ElementId::Relation(relation.id), class, relations.tags(relation), sink)?;
            }
        }
        Ok(())
    }
}

/// An extent that reaches as far as another one on each side, but by at most [`MOST_BEYOND`].
fn grown([west, south, east, north]: Bounds, to: Option<Bounds>) -> Bounds {
    let [w, s, e, n] = to.unwrap_or([west, south, east, north]);
    let low = |own: i32, other: i32| own.min(other).max(own.saturating_sub(MOST_BEYOND));
    let high = |own: i32, other: i32| own.max(other).min(own.saturating_add(MOST_BEYOND));
    [low(west, w), low(south, s), high(east, e), high(north, n)]
}

/// Adds an area, unless it is an outline for which its parts stand.
fn add_area(
    input: &Input<'_>,
    parts: &mut Parts,
    (id, class, tags): (ElementId, Class, Tags<'_>),
    polygons: Result<Vec<Polygon>, &'static str>,
    sink: &mut dyn ObjectSink,
) -> Result<(), InputError> {
    let mut skip = |reason| {
        sink.skip(reason, id.to_string());
        Ok(())
    };
    let polygons = match polygons {
        Ok(polygons) => polygons,
        Err(reason) => return skip(reason),
    };
    let mut is_supported = false;
    if class.kind == FeatureKind::Building {
        match parts.settle_outline(id, tags, &polygons) {
            OutlineFate::Kept { has_parts } => is_supported = has_parts,
            OutlineFate::LeftOut => return skip(COVERED),
            OutlineFate::NotCompared => sink.problem("too many building parts, outline kept", id.to_string()),
        }
    }
    if !is_in_bbox(input.bbox_deg, polygons.iter().flatten().flatten()) {
        return Ok(());
    }
    sink.add(object(id, class, tags, None, footprints(polygons, is_supported)))
}

fn object_way(element: Element<'_>) -> Option<(i64, &[i64], Tags<'_>, Class)> {
    let Element::Way { id, refs, tags, .. } = element else { return None };
    match classify(tags, outline_of(refs)) {
        Verdict::Object(class) => Some((id, refs, tags, class)),
        _ => None,
    }
}
