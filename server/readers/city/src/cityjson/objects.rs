//! Reads the objects of a document or of a feature.

use super::appearance::AppearanceReader;
use super::geometry::{ObjectReferences, VertexFrame, surfaces_of};
use super::levels::{LevelChoice, choose_levels, find_wholes};
use super::schema::{
    CityJsonAppearance, CityJsonDocument, CityJsonLod, CityObject, GeometryTemplates, ObjectOutline, ObjectText,
    VertexTransform,
};
use crate::degrees::is_latitude_first;
use insula_place::crs::is_geographic;
use insula_source::attributes::Attributes;
use insula_source::error::{InputError, json_message};
use insula_source::json::attributes::flatten;
use insula_source::json::metadata;
use insula_source::json::position::JsonPosition;
use insula_source::object::{AxisOrder, CrsReference, FeatureKind, ObjectSink, Shape, SourceObject, WholeBuilding};
use insula_source::problems::{INEXACT, INTERIOR, NO_TRANSFORM};
use insula_source::subject;
use serde::de::DeserializeOwned;
use serde_json::value::RawValue;

/// Whole numbers with a larger range of heights are no metres: they wait for a transform, mostly to millimetres.
const MOST_METRES: f64 = 1000.0;
/// Larger steps of vertices in degrees, of about 1 m, bend walls and close gaps.
const MAX_STEP_DEG: f64 = 1e-5;
/// Objects between two progress reports.
const TICK_OBJECTS: usize = 256;

/// Checks a document or header, and passes on what it says of the whole. Returns whether positions are latitudes and longitudes.
/// Fails if its version or coordinate system is not supported. A header that names no system, after others, does not have theirs.
pub(super) fn begin(
    label: &str,
    header: &CityJsonDocument<'_>,
    is_first: bool,
    sink: &mut dyn ObjectSink,
) -> Result<bool, InputError> {
    let version = header.version.as_deref().unwrap_or("");
    if !(version.starts_with("1.") || version.starts_with("2.") || version.is_empty()) {
        let what = format!("its version is CityJSON {version}; cjio's command upgrade makes it a newer one");
        return Err(InputError::unsupported(label, what));
    }
    let metadata = header.metadata.and_then(|raw| serde_json::from_str(raw.get()).ok());
    let Some(name) = metadata.and_then(|metadata| metadata::describe(&metadata, sink)) else {
        if !is_first {
            sink.set_crs(&CrsReference::east_first(""))?;
        }
        return Ok(false);
    };
    let is_latitude_first = is_latitude_first(&name);
    let step = header.transform.map_or(0.0, |transform| transform.scale[0].abs().max(transform.scale[1].abs()));
    if step > MAX_STEP_DEG && is_geographic(&name) {
        let detail = format!("vertices of {label} are whole steps of {step} degrees, so that buildings are bent");
        sink.problem(INEXACT, detail);
    }
    // As the specification says: the order of the system's definition. Writers follow it for degrees, and mostly not for
    // projected systems whose definition begins with the northing.
    sink.set_crs(&match is_geographic(&name) {
        true => CrsReference::authority(name),
        false => CrsReference { order: AxisOrder::MostlyEastFirst, ..CrsReference::east_first(name) },
    })?;
    Ok(is_latitude_first)
}

/// Parses an optional member. A malformed one is reported and ignored.
pub(super) fn parse_member<T: DeserializeOwned + Default>(
    raw: Option<&RawValue>,
    name: &str,
    sink: &mut dyn ObjectSink,
) -> T {
    let Some(raw) = raw else { return T::default() };
    serde_json::from_str(raw.get()).unwrap_or_else(|error| {
        sink.problem("malformed member", format!("{name}: {}", json_message(&error)));
        T::default()
    })
}

/// Members that apply to a whole file.
pub(super) struct SharedMembers<'a> {
    /// The source, for messages.
    pub(super) label: &'a str,
    pub(super) transform: Option<VertexTransform>,
    /// Positions are latitudes and longitudes.
    pub(super) is_latitude_first: bool,
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

/// Whether vertices are whole numbers with a range of heights that no object in metres has.
fn look_untransformed(vertices: &[JsonPosition]) -> bool {
    let heights = vertices.iter().map(|JsonPosition(at)| at[2]);
    let (low, high) = heights.fold((f64::MAX, f64::MIN), |(low, high), z| (low.min(z), high.max(z)));
    high - low > MOST_METRES && vertices.iter().all(|JsonPosition(at)| at.iter().all(|number| number.fract() == 0.0))
}

/// Passes all objects of a batch to the sink; calls `tick` with the number of objects that are done. Fails as the sink, or if
/// the transform puts all vertices in one plane.
pub(super) fn read_objects(
    shared: &SharedMembers<'_>,
    batch: &ObjectBatch<'_>,
    sink: &mut dyn ObjectSink,
    tick: &dyn Fn(usize, &mut dyn ObjectSink),
) -> Result<(), InputError> {
    if shared.transform.is_none() && look_untransformed(batch.vertices) {
        sink.problem(NO_TRANSFORM, "they are whole numbers of a large range of heights".to_owned());
    }
    if !batch.vertices.is_empty() && shared.transform.is_some_and(|transform| transform.scale.contains(&0.0)) {
        return Err(InputError::damaged(shared.label, "transform", "its scale is 0, which leaves no bodies"));
    }
    let outlines: Vec<(&str, Option<ObjectOutline<'_>>)> =
        batch.objects.iter().map(|object| (object.id, serde_json::from_str(object.json).ok())).collect();
    let choices = choose_levels(&outlines, &shared.templates.templates);
    let wholes = find_wholes(&outlines);
    let (attributes, parents): (Vec<_>, Vec<_>) = outlines
        .into_iter()
        .map(|(_, outline)| outline.map_or((None, None), |outline| (outline.attributes, outline.parents)))
        .unzip();
    let mut references = ObjectReferences {
        frame: VertexFrame::new(batch.vertices, shared.transform, shared.is_latitude_first),
        appearance: AppearanceReader::new(batch.appearance),
        templates: shared.templates,
        template_appearance: AppearanceReader::new(shared.appearance),
    };
    for (i, (text, parents)) in batch.objects.iter().zip(parents).enumerate() {
        subject::set(format_args!("{}: object {}", shared.label, text.id));
        let parent = parents.and_then(|parents| parents.into_iter().next());
        let own = attributes_of(attributes[i]);
        let whole = wholes[i];
        let of_whole = if whole == i { own.clone() } else { attributes_of(attributes[whole]) };
        let about = ObjectAbout { parent, attributes: own };
        match read_object(text, choices[i], about, &mut references, sink) {
            Ok(object) => {
                sink.add_part(object, WholeBuilding { id: batch.objects[whole].id, attributes: &of_whole })?;
            }
            Err((reason, detail)) => sink.skip(reason, format!("{}: {detail}", text.id)),
        }
        if (i + 1) % TICK_OBJECTS == 0 {
            tick(i + 1, sink);
        }
    }
    Ok(())
}

/// The attributes of an object; none if they are malformed.
fn attributes_of(text: Option<&RawValue>) -> Attributes {
    let mut attributes = Attributes::default();
    if let Some(members) = text.and_then(|text| serde_json::from_str(text.get()).ok()) {
        flatten(&members, &mut attributes);
    }
    attributes
}

/// What is known of an object besides its geometry.
struct ObjectAbout {
    parent: Option<String>,
    attributes: Attributes,
}

/// Makes an object of its text. Fails with the reason and a detail if it must be skipped.
fn read_object(
    text: &ObjectText<'_>,
    choice: LevelChoice,
    ObjectAbout { parent, attributes }: ObjectAbout,
    references: &mut ObjectReferences<'_>,
    sink: &mut dyn ObjectSink,
) -> Result<SourceObject, (&'static str, String)> {
    let id = text.id;
    let object: CityObject =
        serde_json::from_str(text.json).map_err(|error| ("malformed object", json_message(&error)))?;
    let (lod, shape) = match choice {
        LevelChoice::NoGeometry => (None, Shape::None),
        LevelChoice::Interior => return Err((INTERIOR, object.kind)),
        LevelChoice::Coarser(level) => (Some(level), Shape::None),
        LevelChoice::Level(level) => {
            let polygons = surfaces_of(id, &object, level, references, sink);
            let polygons = polygons.map_err(|fault| (fault.reason, fault.detail))?;
            (Some(level), Shape::Surfaces { polygons, meshes: Vec::new() })
        }
    };
    Ok(SourceObject {
        id: id.to_owned(),
        parent,
        kind: FeatureKind::of_cityjson_type(&object.kind),
        source_type: object.kind,
        lod: lod.map(|CityJsonLod(level)| level as f32),
        attributes,
        shape,
    })
}
