//! CityJSON 1.0 to 2.0, as one document or as a sequence of features.

mod appearance;
mod geometry;
mod levels;
mod nested;
mod objects;
mod schema;
mod sequence;

use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::json::{lenient, without_bom};
use insula_source::object::ObjectSink;
use objects::{ObjectBatch, SharedMembers, begin, parse_member, read_objects};
use schema::{CityJsonAppearance, CityJsonDocument, GeometryTemplates};
use serde::Deserialize;
use serde_json::error::Category;

/// The two forms of CityJSON.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CityJsonForm {
    /// One JSON document, which is in memory while it is read.
    Document,
    /// A header line, then one feature per line.
    Sequence,
}

/// Reads all objects of a file. `form` is what its name tells; a document may turn out to be a sequence, of which the form is
/// returned. Lines of a sequence that are longer than `input.max_line_bytes` are skipped. Fails if the text is damaged or not
/// CityJSON; objects before the damage of a sequence are passed on.
pub fn read(input: &Input<'_>, form: CityJsonForm, sink: &mut dyn ObjectSink) -> Result<CityJsonForm, InputError> {
    if form == CityJsonForm::Sequence {
        let mut opened = input.open()?;
        let bytes_read = opened.bytes_read;
        sequence::read(input.label, &mut opened.reader, input.max_line_bytes, sink, &|| bytes_read.get())?;
        return Ok(form);
    }
    let bytes = input.read_all(input.max_bytes)?;
    let text = without_bom(&bytes);
    if is_sequence(text) {
        sequence::read(input.label, &mut &*text, input.max_line_bytes, sink, &|| 0)?;
        return Ok(CityJsonForm::Sequence);
    }
    match serde_json::from_slice::<CityJsonDocument<'_>>(text) {
        Ok(document) => read_document(input, document, sink)?,
        Err(error) => {
            let Some(repaired) = lenient::replace_invalid_numbers(text) else {
                return Err(unparsed(input.label, text, &error));
            };
            match serde_json::from_slice::<CityJsonDocument<'_>>(&repaired) {
                Ok(document) => read_document(input, document, sink)?,
                Err(error) => return Err(unparsed(input.label, &repaired, &error)),
            }
        }
    }
    Ok(form)
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

/// The error of a text that is not a [`CityJsonDocument`]: invalid JSON, or other JSON.
fn unparsed(label: &str, text: &[u8], error: &serde_json::Error) -> InputError {
    let found = json_type(text);
    if error.classify() == Category::Data && found.as_deref() != Some("CityJSON") {
        return unknown_type(label, found);
    }
    InputError::json(label, error)
}

fn unknown_type(label: &str, found: Option<String>) -> InputError {
    let what = found.map_or("not CityJSON".to_owned(), |found| format!("its type is \"{found}\", not \"CityJSON\""));
    InputError::unknown_format(label, what)
}

fn read_document(
    input: &Input<'_>,
    document: CityJsonDocument<'_>,
    sink: &mut dyn ObjectSink,
) -> Result<(), InputError> {
    if document.kind.as_deref() != Some("CityJSON") {
        return Err(unknown_type(input.label, document.kind));
    }
    let is_latitude_first = begin(input.label, &document, true, sink)?;
    let appearance: CityJsonAppearance = parse_member(document.appearance, "appearance", sink);
    let templates: GeometryTemplates = parse_member(document.templates, "geometry-templates", sink);
    let shared = SharedMembers {
        label: input.label,
        transform: document.transform,
        is_latitude_first,
        templates: &templates,
        appearance: &appearance,
    };
    let objects = document.city_objects.texts();
    let (bytes, count) = (input.files.len(input.name).unwrap_or(0), objects.len().max(1) as u64);
    // Parsing is behind: the objects that are done stand for their share of the bytes.
    let tick = |done: usize, sink: &mut dyn ObjectSink| {
        sink.tick((u128::from(bytes) * done as u128 / u128::from(count)) as u64);
    };
    let batch = ObjectBatch { objects: &objects, vertices: &document.vertices, appearance: &appearance };
    read_objects(&shared, &batch, sink, &tick)
}
