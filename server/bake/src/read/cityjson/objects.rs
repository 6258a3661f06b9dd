//! Reads the objects of a document or of a feature.

use serde::de::DeserializeOwned;
use serde_json::value::RawValue;
use serde_json::{Map, Value};

use super::appearance::AppearanceReader;
use super::geometry::{ObjectReader, ObjectReferences, VertexFrame, WholeBuilding};
use super::levels::{LevelChoice, choose_levels, find_wholes};
use super::schema::{
    CityJsonAppearance, CityJsonDocument, CityObject, GeometryTemplates, ObjectOutline, ObjectText, UseAttributes,
    VertexTransform,
};
use crate::read::context::ReadContext;
use crate::read::facade::FacadeUse;
use crate::read::scene_builder::{ObjectRelation, hash_of_id};
use insula_dress::palette::WallKind;
use insula_place::crs::is_geographic;
use insula_place::placement::{FirstShape, Placement};
use insula_source::attributes::Attributes;
use insula_source::error::{InputError, json_message};
use insula_source::json::attributes::flatten;
use insula_source::json::metadata;
use insula_source::json::position::JsonPosition;
use insula_source::object::{AxisOrder, CrsReference, FeatureKind};
use insula_source::problems::NO_CRS;
use insula_source::report::{SourceFormat, SourceReport};
use insula_source::source::CitySource;
use insula_source::subject;

/// Vertices are whole numbers of steps; objects are larger than so many.
const STEPS_OF_OBJECT: f64 = 1000.0;
/// Objects between two progress reports.
const TICK_OBJECTS: usize = 256;

/// Checks a document or header, and starts the report and the placement. Fails if its version or coordinate system is not
/// supported.
pub(super) fn begin(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    header: &CityJsonDocument<'_>,
    format: SourceFormat,
) -> Result<(SourceReport, Placement), InputError> {
    let version = header.version.as_deref().unwrap_or("");
    if !(version.starts_with("1.") || version.starts_with("2.") || version.is_empty()) {
        return Err(InputError::unsupported(&source.label, format!("its version is CityJSON {version}")));
    }
    let mut report = SourceReport::new(&source.label, format, source.bytes);
    let mut crs = None;
    if let Some(raw) = header.metadata
        && let Ok(value) = serde_json::from_str(raw.get())
    {
        crs = metadata::describe(&value, &mut report);
    }
    let first = first_shape(header);
    let reference = match crs {
        // As the specification says: the order of the system's definition. Writers follow it for degrees, and mostly not for
        // projected systems whose definition begins with the northing.
        Some(name) if is_geographic(&name) => CrsReference::authority(name),
        Some(name) => CrsReference { order: AxisOrder::MostlyEastFirst, ..CrsReference::east_first(name) },
        None => {
            let Some((reference, text)) = first.and_then(|first| context.world.guess(&first)) else {
                return Ok((report, Placement::Unknown));
            };
            report.problem(NO_CRS, || text);
            reference
        }
    };
    let mut placement = context.world.place(&source.label, &reference)?;
    if let Some(first) = first {
        context.settle(&mut placement, &source.label, first)?;
    }
    placement.note_in(&mut report);
    Ok((report, placement))
}

/// Where the document's objects begin: features have no vertices of their own in the header.
fn first_shape(header: &CityJsonDocument<'_>) -> Option<FirstShape> {
    /// Vertices that are probably of one object.
    const VERTICES: usize = 4;
    let placed = |JsonPosition(vertex): &JsonPosition| {
        let [x, y, _] = header.transform.map_or(*vertex, |transform| transform.apply(*vertex));
        [x, y]
    };
    let of_vertices = FirstShape::of(header.vertices.iter().take(VERTICES).map(placed));
    of_vertices.or_else(|| {
        let transform = header.transform?;
        let ([x, y, _], [x1, y1, _]) = (transform.apply([0.0; 3]), transform.apply([STEPS_OF_OBJECT; 3]));
        Some(FirstShape::at([x, y], Some([(x1 - x).abs(), (y1 - y).abs()])))
    })
}

/// Parses an optional member. A malformed one is noted in the report and ignored.
pub(super) fn parse_member<T: DeserializeOwned + Default>(
    raw: Option<&RawValue>,
    name: &str,
    report: &mut SourceReport,
) -> T {
    let Some(raw) = raw else { return T::default() };
    serde_json::from_str(raw.get()).unwrap_or_else(|error| {
        report.problem("malformed member", || format!("{name}: {}", json_message(&error)));
        T::default()
    })
}

/// Members that apply to a whole file.
pub(super) struct SharedMembers<'a> {
    pub(super) transform: Option<VertexTransform>,
    pub(super) placement: &'a Placement,
    pub(super) templates: &'a GeometryTemplates,
    /// The appearance that the templates refer to.
    pub(super) appearance: &'a CityJsonAppearance,
}

/// Objects that may be related, with the vertices that they share.
pub(super) struct ObjectBatch<'a> {
    pub(super) objects: &'a [ObjectText<'a>],
    pub(super) vertices: &'a [JsonPosition],
    pub(super) appearance: &'a CityJsonAppearance,
}

/// Reads all objects of a batch; calls `tick` with the number of objects that are done.
pub(super) fn read_objects(
    mut reader: ObjectReader<'_, '_, '_>,
    shared: &SharedMembers<'_>,
    batch: &ObjectBatch<'_>,
    tick: &dyn Fn(usize),
) {
    reader.report.found += batch.objects.len() as u64;
    let outlines: Vec<(&str, Option<ObjectOutline<'_>>)> =
        batch.objects.iter().map(|object| (object.id, serde_json::from_str(object.json).ok())).collect();
    let choices = choose_levels(&outlines, &shared.templates.templates);
    let wholes = find_wholes(&outlines);
    let attributes: Vec<Option<&RawValue>> =
        outlines.iter().map(|(_, outline)| outline.as_ref().and_then(|outline| outline.attributes)).collect();
    let parents: Vec<Option<u64>> = outlines
        .iter()
        .map(|(_, outline)| outline.as_ref()?.parents.as_ref()?.first().map(|id| hash_of_id(id)))
        .collect();
    drop(outlines);
    let mut references = ObjectReferences {
        frame: VertexFrame::new(batch.vertices, shared.transform, shared.placement),
        appearance: AppearanceReader::new(batch.appearance),
        templates: shared.templates,
        template_appearance: AppearanceReader::new(shared.appearance),
    };
    for (i, (object, choice)) in batch.objects.iter().zip(choices).enumerate() {
        let uses = attributes[wholes[i]].and_then(|text| serde_json::from_str(text.get()).ok()).unwrap_or_default();
        let (walls, facade_use) = (by_use(&uses, WallKind::of_use), by_use(&uses, FacadeUse::of_use));
        let whole =
            WholeBuilding { id: batch.objects[wholes[i]].id, walls, facade_use: facade_use.unwrap_or_default() };
        let own = attributes[i].and_then(|text| serde_json::from_str(text.get()).ok());
        let own: Map<String, Value> = own.unwrap_or_default();
        let facts = ObjectFacts { attributes: &own, parent: parents[i] };
        read_object(&mut reader, object, choice, &whole, facts, &mut references);
        if (i + 1) % TICK_OBJECTS == 0 {
            tick(i + 1);
        }
    }
}

/// What follows from a building's use, as far as the attributes tell.
fn by_use<T>(attributes: &UseAttributes, of_use: fn(&str) -> Option<T>) -> Option<T> {
    let UseAttributes { function, usage, class } = attributes;
    [usage, function, class].iter().find_map(|value| of_use(value.as_str()?))
}

/// What an object has besides its geometry.
#[derive(Clone, Copy)]
struct ObjectFacts<'a> {
    attributes: &'a Map<String, Value>,
    /// See [`hash_of_id`].
    parent: Option<u64>,
}

fn read_object(
    reader: &mut ObjectReader<'_, '_, '_>,
    text: &ObjectText<'_>,
    choice: LevelChoice,
    whole: &WholeBuilding<'_>,
    facts: ObjectFacts<'_>,
    references: &mut ObjectReferences<'_>,
) {
    let id = text.id;
    subject::set(format_args!("{}: object {id}", reader.report.path));
    let object: CityObject = match serde_json::from_str(text.json) {
        Ok(object) => object,
        Err(error) => {
            reader.report.skip("malformed object", || format!("{id}: {}", json_message(&error)));
            return;
        }
    };
    reader.report.count_type(&object.kind);
    let kind = FeatureKind::of_cityjson_type(&object.kind);
    if !reader.context.options.kinds.contains(kind) {
        reader.report.left_out_by_kind += 1;
        return;
    }
    let mut attributes = Attributes::default();
    flatten(facts.attributes, &mut attributes);
    reader.report.count_attributes(&attributes);
    *reader.report.objects_by_kind.entry(kind).or_default() += 1;
    let record = Some(reader.context.record_of(id, kind, &attributes));
    let relation = ObjectRelation { parent: facts.parent, record, ..ObjectRelation::default() };
    let level = match choice {
        LevelChoice::Level(level) => level,
        LevelChoice::Coarser | LevelChoice::NoGeometry => {
            let report = &mut *reader.report;
            *match choice {
                LevelChoice::NoGeometry => &mut report.without_geometry,
                _ => &mut report.coarser_left_out,
            } += 1;
            reader.context.builder.add_parent(reader.context.source, id, relation);
            return;
        }
    };
    *reader.report.objects_by_level.entry(level.0.to_string()).or_default() += 1;
    reader.relation = ObjectRelation { lod: Some(level.0 as f32), ..relation };
    match reader.read(id, &object, level, whole, references) {
        Ok(true) => {}
        Ok(false) => reader.report.skip("no surface with an area", || id.to_owned()),
        Err(fault) => reader.report.skip(fault.reason, || format!("{id}: {}", fault.detail)),
    }
}
