//! CityJSON 1.0 to 2.0, as one document or as a sequence of features.
//!
//! In: a source. Out: objects in the builder and a [`SourceReport`]. Next: `builder`.

mod geometry;
pub(crate) mod lenient;
mod levels;
mod looks;
pub(crate) mod metadata;
mod model;
mod nested;
mod seq;
#[cfg(test)]
mod tests;

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::error::Category;
use serde_json::value::RawValue;

use super::error::{InputError, json_message};
use super::palette::object_kind;
use super::report::{SourceFormat, SourceReport};
use super::source::{CitySource, SourceKind, named_as, open, read_all};
use super::{ByteProgress, ReadContext};
use geometry::{ObjectReader, VertexFrame};
use levels::{LevelChoice, choose};
use looks::AppearanceReader;
use model::{CityJsonAppearance, CityJsonDocument, CityObject, GeometryTemplates, ObjectOutline, VertexTransform};

pub(crate) use looks::byte;
pub(crate) use model::JsonPosition;

/// After how many objects progress is told.
const TICK_OBJECTS: usize = 256;

/// Reads a source; `None` if it was only found in a folder and is some other kind of JSON.
pub(crate) fn read(
    reading: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    tick: ByteProgress<'_>,
) -> Result<Option<SourceReport>, InputError> {
    if named_as(&source.name) == Some(SourceKind::JsonLines) {
        let mut opened = open(source)?;
        let taken = opened.taken;
        return seq::read(reading, source, &mut opened.reader, &|| tick(taken.get())).map(Some);
    }
    let bytes = read_all(source, reading.options.max_source_bytes)?;
    let text = without_mark(&bytes);
    if is_sequence(text) {
        return seq::read(reading, source, &mut &*text, &|| {}).map(Some);
    }
    match serde_json::from_slice::<CityJsonDocument<'_>>(text) {
        Ok(document) => read_document(reading, source, document, tick),
        Err(error) => {
            let clean = lenient::without_odd_numbers(text);
            let Some(clean) = &clean else { return not_parsed(source, text, &error) };
            match serde_json::from_slice::<CityJsonDocument<'_>>(clean) {
                Ok(document) => read_document(reading, source, document, tick),
                Err(error) => not_parsed(source, clean, &error),
            }
        }
    }
}

/// A text without its byte order mark.
fn without_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text)
}

/// Whether the first line is a whole CityJSON document and more follows.
fn is_sequence(text: &[u8]) -> bool {
    let Some(end) = text.iter().position(|&byte| byte == b'\n') else { return false };
    !text[end..].trim_ascii().is_empty() && kind_of(&text[..end]).as_deref() == Some("CityJSON")
}

/// The `type` member of a document that may be of any kind.
fn kind_of(text: &[u8]) -> Option<String> {
    #[derive(Deserialize)]
    struct TypeMember {
        #[serde(rename = "type")]
        kind: String,
    }
    serde_json::from_slice::<TypeMember>(text).ok().map(|kind| kind.kind)
}

/// Damage is an error; JSON of another shape is one only if it was asked for.
fn not_parsed(
    source: &CitySource<'_>,
    text: &[u8],
    error: &serde_json::Error,
) -> Result<Option<SourceReport>, InputError> {
    if error.classify() == Category::Data && kind_of(text).as_deref() != Some("CityJSON") {
        return other_kind(source, kind_of(text));
    }
    Err(InputError::json(&source.label, error))
}

fn other_kind(source: &CitySource<'_>, kind: Option<String>) -> Result<Option<SourceReport>, InputError> {
    if source.found {
        return Ok(None);
    }
    let what = kind.map_or("no CityJSON".to_owned(), |kind| format!("its type is \"{kind}\" and not \"CityJSON\""));
    Err(InputError::unsupported(&source.label, what))
}

fn read_document(
    reading: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    document: CityJsonDocument<'_>,
    tick: ByteProgress<'_>,
) -> Result<Option<SourceReport>, InputError> {
    if document.kind.as_deref() != Some("CityJSON") {
        return other_kind(source, document.kind);
    }
    let mut report = begin(reading, source, &document, SourceFormat::CityJson)?;
    let appearance: CityJsonAppearance = member(document.appearance, "appearance", &mut report);
    let templates: GeometryTemplates = member(document.templates, "geometry-templates", &mut report);
    let shared = SharedMembers { transform: document.transform, templates: &templates, appearance: &appearance };
    let objects: Vec<(&str, &str)> = document.city_objects.0.iter().map(|(id, raw)| (&**id, raw.get())).collect();
    let count = objects.len().max(1) as u64;
    let part = |done: usize| tick((u128::from(source.bytes) * done as u128 / u128::from(count)) as u64);
    let batch = ObjectBatch { objects: &objects, vertices: &document.vertices, appearance: &appearance };
    read_objects(ObjectReader::new(reading, source, &mut report), &shared, &batch, &part);
    Ok(Some(report))
}

/// Checks a header and starts the report.
fn begin(
    reading: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    header: &CityJsonDocument<'_>,
    format: SourceFormat,
) -> Result<SourceReport, InputError> {
    let version = header.version.as_deref().unwrap_or("");
    if !(version.starts_with("1.") || version.starts_with("2.") || version.is_empty()) {
        return Err(InputError::unsupported(&source.label, format!("its version is CityJSON {version}")));
    }
    let mut report = SourceReport::new(&source.label, format, source.bytes);
    if let Some(raw) = header.metadata
        && let Ok(value) = serde_json::from_str(raw.get())
    {
        metadata::describe(&value, &mut report);
    }
    if let Some(crs) = report.crs.clone().filter(|crs| metadata::is_degrees(crs)) {
        return Err(InputError::Degrees { path: source.label.clone(), crs });
    }
    reading.agree_on_crs(&source.label, report.crs.as_deref())?;
    Ok(report)
}

/// A member that the file can do without.
fn member<T: DeserializeOwned + Default>(raw: Option<&RawValue>, name: &str, report: &mut SourceReport) -> T {
    let Some(raw) = raw else { return T::default() };
    serde_json::from_str(raw.get()).unwrap_or_else(|error| {
        report.problem("malformed member", || format!("{name}: {}", json_message(&error)));
        T::default()
    })
}

/// What a whole file shares.
struct SharedMembers<'a> {
    transform: Option<VertexTransform>,
    templates: &'a GeometryTemplates,
    /// The templates' own indices mean this one.
    appearance: &'a CityJsonAppearance,
}

/// Objects that may be related, with the vertices that they share.
struct ObjectBatch<'a> {
    objects: &'a [(&'a str, &'a str)],
    vertices: &'a [JsonPosition],
    appearance: &'a CityJsonAppearance,
}

fn read_objects(
    mut reader: ObjectReader<'_, '_, '_>,
    shared: &SharedMembers<'_>,
    batch: &ObjectBatch<'_>,
    tick: &dyn Fn(usize),
) {
    let outlines: Vec<(&str, Option<ObjectOutline>)> =
        batch.objects.iter().map(|(id, text)| (*id, serde_json::from_str(text).ok())).collect();
    let choices = choose(&outlines, &shared.templates.templates);
    drop(outlines);
    let frame = VertexFrame::new(batch.vertices, shared.transform);
    let mut looks = (AppearanceReader::new(batch.appearance), AppearanceReader::new(shared.appearance));
    for (i, (&(id, text), choice)) in batch.objects.iter().zip(choices).enumerate() {
        read_object(&mut reader, (id, text), choice, shared, (&frame, &mut looks));
        if (i + 1) % TICK_OBJECTS == 0 {
            tick(i + 1);
        }
    }
}

fn read_object(
    reader: &mut ObjectReader<'_, '_, '_>,
    (id, text): (&str, &str),
    choice: LevelChoice,
    shared: &SharedMembers<'_>,
    (frame, looks): (&VertexFrame<'_>, &mut (AppearanceReader<'_>, AppearanceReader<'_>)),
) {
    let object: CityObject = match serde_json::from_str(text) {
        Ok(object) => object,
        Err(error) => {
            reader.report.skip("malformed object", || format!("{id}: {}", json_message(&error)));
            return;
        }
    };
    reader.report.count_type(&object.kind);
    let level = match choice {
        LevelChoice::Level(level) => level,
        LevelChoice::Coarser => {
            reader.report.coarser_left_out += 1;
            return;
        }
        LevelChoice::NoGeometry => return,
    };
    let result = reader.read((id, &object), level, (frame, &mut looks.0), (shared.templates, &mut looks.1));
    match result {
        Ok(_) if reader.faces.is_empty() => reader.report.skip("no surface with an area", || id.to_owned()),
        Ok(has_volume) => {
            let kind = object_kind(&object.kind, has_volume);
            reader.reading.builder.add(reader.reading.source, id, kind, &reader.faces, reader.report);
        }
        Err(fault) => reader.report.skip(fault.reason, || format!("{id}: {}", fault.detail)),
    }
}
