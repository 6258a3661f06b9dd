//! CityJSON 1.0 to 2.0, as one document or as a sequence of features.

mod appearance;
mod geometry;
mod levels;
mod nested;
mod objects;
mod schema;
mod sequence;
#[cfg(test)]
mod tests;

use serde::Deserialize;
use serde_json::error::Category;

use super::context::{ByteProgress, ReadContext};
use geometry::ObjectReader;
use insula_source::error::InputError;
use insula_source::json::{lenient, without_bom};
use insula_source::report::{SourceFormat, SourceReport};
use insula_source::source::{CitySource, SourceKind, kind_by_name, open, read_all};
use objects::{ObjectBatch, SharedMembers, begin, parse_member, read_objects};
use schema::{CityJsonAppearance, CityJsonDocument, GeometryTemplates};

/// Reads a source; `None` if it was found in a folder and is other JSON. Fails if the text is damaged or not CityJSON.
pub(crate) fn read(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    tick: ByteProgress<'_>,
) -> Result<Option<SourceReport>, InputError> {
    if kind_by_name(&source.name) == Some(SourceKind::JsonLines) {
        let mut opened = open(source)?;
        let bytes_read = opened.bytes_read;
        return sequence::read(context, source, &mut opened.reader, &|| tick(bytes_read.get())).map(Some);
    }
    let options = context.options;
    let bytes = read_all(source, options.max_document_bytes.min(options.max_source_bytes))?;
    let text = without_bom(&bytes);
    if is_sequence(text) {
        return sequence::read(context, source, &mut &*text, &|| {}).map(Some);
    }
    match serde_json::from_slice::<CityJsonDocument<'_>>(text) {
        Ok(document) => read_document(context, source, document, tick),
        Err(error) => {
            let repaired = lenient::replace_invalid_numbers(text);
            let Some(repaired) = &repaired else { return refuse_unparsed(source, text, &error) };
            match serde_json::from_slice::<CityJsonDocument<'_>>(repaired) {
                Ok(document) => read_document(context, source, document, tick),
                Err(error) => refuse_unparsed(source, repaired, &error),
            }
        }
    }
}

/// Whether the first line is a whole CityJSON document and more lines follow.
fn is_sequence(text: &[u8]) -> bool {
    let Some(end) = text.iter().position(|&byte| byte == b'\n') else { return false };
    !text[end..].trim_ascii().is_empty() && json_type(&text[..end]).as_deref() == Some("CityJSON")
}

/// The `type` member of a JSON document.
fn json_type(text: &[u8]) -> Option<String> {
    #[derive(Deserialize)]
    struct TypeMember {
        #[serde(rename = "type")]
        name: String,
    }
    serde_json::from_slice::<TypeMember>(text).ok().map(|member| member.name)
}

/// Handles a text that is not a [`CityJsonDocument`]: invalid JSON is an error, other JSON only if the user named the
/// file.
fn refuse_unparsed(
    source: &CitySource<'_>,
    text: &[u8],
    error: &serde_json::Error,
) -> Result<Option<SourceReport>, InputError> {
    if error.classify() == Category::Data && json_type(text).as_deref() != Some("CityJSON") {
        return refuse_type(source, json_type(text));
    }
    Err(InputError::json(&source.label, error))
}

fn refuse_type(source: &CitySource<'_>, found: Option<String>) -> Result<Option<SourceReport>, InputError> {
    if source.found {
        return Ok(None);
    }
    let what = found.map_or("not CityJSON".to_owned(), |found| format!("its type is \"{found}\", not \"CityJSON\""));
    Err(InputError::unknown_format(&source.label, what))
}

fn read_document(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    document: CityJsonDocument<'_>,
    tick: ByteProgress<'_>,
) -> Result<Option<SourceReport>, InputError> {
    if document.kind.as_deref() != Some("CityJSON") {
        return refuse_type(source, document.kind);
    }
    let (mut report, placement) = begin(context, source, &document, SourceFormat::CityJson)?;
    let appearance: CityJsonAppearance = parse_member(document.appearance, "appearance", &mut report);
    let templates: GeometryTemplates = parse_member(document.templates, "geometry-templates", &mut report);
    let (transform, placement) = (document.transform, &placement);
    let shared = SharedMembers { transform, placement, templates: &templates, appearance: &appearance };
    let objects = document.city_objects.texts();
    let count = objects.len().max(1) as u64;
    let tick_objects = |done: usize| tick((u128::from(source.bytes) * done as u128 / u128::from(count)) as u64);
    let batch = ObjectBatch { objects: &objects, vertices: &document.vertices, appearance: &appearance };
    read_objects(ObjectReader::new(context, source, &mut report), &shared, &batch, &tick_objects);
    Ok(Some(report))
}
