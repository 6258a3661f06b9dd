//! CityJSONSeq: a header line, then one feature a line, each read and dropped.
//!
//! In: lines. Out: objects in the builder and a [`SourceReport`]. Next: `builder`.

use std::io::BufRead;

use super::geometry::ObjectReader;
use super::model::{CityJsonAppearance, CityJsonDocument, GeometryTemplates};
use super::{ObjectBatch, SharedMembers, begin, lenient, member, read_objects, without_mark};
use crate::read::ReadContext;
use crate::read::error::{InputError, json_message};
use crate::read::report::{SourceFormat, SourceReport};
use crate::read::source::{CitySource, next_line};

/// After how many lines progress is told.
const TICK_LINES: usize = 64;

/// Reads a sequence. A broken header is an error, a broken line a reported skip.
pub(super) fn read(
    reading: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    lines: &mut dyn BufRead,
    tick: &dyn Fn(),
) -> Result<SourceReport, InputError> {
    let limit = usize::try_from(reading.options.max_line_bytes).unwrap_or(usize::MAX);
    let mut line = Vec::new();
    let mut next =
        |line: &mut Vec<u8>| next_line(lines, line, limit).map_err(|cause| InputError::io(&source.label, cause));
    if next(&mut line)? == Some(false) {
        let what = "the header line's length in bytes".to_owned();
        return Err(InputError::TooLarge { path: source.label.clone(), what, limit: limit as u64 });
    }
    let first = without_mark(&line).to_vec();
    let mut header: CityJsonDocument<'_> =
        serde_json::from_slice(&first).map_err(|error| InputError::json(&source.label, &error))?;
    if header.kind.as_deref() != Some("CityJSON") {
        let what = "its first line is no CityJSON header";
        return Err(InputError::unsupported(&source.label, what));
    }
    let mut report = begin(reading, source, &header, SourceFormat::CityJsonSeq)?;
    let appearance: CityJsonAppearance = member(header.appearance.take(), "appearance", &mut report);
    let templates: GeometryTemplates = member(header.templates.take(), "geometry-templates", &mut report);
    let shared = SharedMembers { transform: header.transform, templates: &templates, appearance: &appearance };
    // A header may hold objects too.
    feature(reading, source, &shared, &header, &mut report);
    let mut number = 1;
    while let Some(whole) = next(&mut line)? {
        number += 1;
        if !whole {
            report.skip("line too long", || format!("line {number}: more than {limit} bytes"));
        } else if !line.trim_ascii().is_empty() {
            parse(&line, number, &mut report, |document, report| {
                feature(reading, source, &shared, document, report);
            });
        }
        if number % TICK_LINES == 0 {
            tick();
        }
    }
    Ok(report)
}

/// Hands a line's feature on, or notes why there is none.
fn parse(
    line: &[u8],
    number: usize,
    report: &mut SourceReport,
    mut then: impl FnMut(&CityJsonDocument<'_>, &mut SourceReport),
) {
    let clean;
    let document = match serde_json::from_slice::<CityJsonDocument<'_>>(line) {
        Ok(document) => Ok(document),
        Err(error) => match lenient::without_odd_numbers(line) {
            None => Err(error),
            Some(text) => {
                clean = text;
                serde_json::from_slice(&clean)
            }
        },
    };
    match document {
        Ok(document) if document.kind.as_deref() == Some("CityJSONFeature") => then(&document, report),
        Ok(document) => {
            let kind = document.kind.unwrap_or_default();
            report.skip("line is no feature", || format!("line {number}: its type is \"{kind}\""));
        }
        Err(error) => {
            let detail = || format!("line {number}, column {}: {}", error.column(), json_message(&error));
            report.skip("broken line", detail);
        }
    }
}

fn feature(
    reading: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    shared: &SharedMembers<'_>,
    document: &CityJsonDocument<'_>,
    report: &mut SourceReport,
) {
    let objects: Vec<(&str, &str)> = document.city_objects.0.iter().map(|(id, raw)| (&**id, raw.get())).collect();
    let own: Option<CityJsonAppearance> = document.appearance.map(|raw| member(Some(raw), "appearance", report));
    let appearance = own.as_ref().unwrap_or(shared.appearance);
    let batch = ObjectBatch { objects: &objects, vertices: &document.vertices, appearance };
    read_objects(ObjectReader::new(reading, source, report), shared, &batch, &|_| {});
}
