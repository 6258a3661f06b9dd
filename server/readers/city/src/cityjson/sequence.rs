//! CityJSONSeq: a header line, then one feature per line. Only one line is in memory at a time.

use super::objects::{ObjectBatch, SharedMembers, begin, parse_member, read_objects};
use super::schema::{CityJsonAppearance, CityJsonDocument, GeometryTemplates};
use insula_source::error::{InputError, json_message};
use insula_source::json::{lenient, without_bom};
use insula_source::object::ObjectSink;
use insula_source::source::{NextLine, next_line};
use std::io::BufRead;

/// Lines between two progress reports.
const TICK_LINES: usize = 64;

/// Reads a sequence, whose lines have `max_line_bytes` at most. A damaged line is skipped and reported. Several sequences may follow
/// one another, each with its header. Fails if a header is damaged.
pub(super) fn read(
    label: &str,
    lines: &mut dyn BufRead,
    max_line_bytes: u64,
    sink: &mut dyn ObjectSink,
    bytes_read: &dyn Fn() -> u64,
) -> Result<(), InputError> {
    let limit = usize::try_from(max_line_bytes).unwrap_or(usize::MAX);
    let mut lines = Lines { label, lines, limit, line: Vec::new(), number: 0, bytes_read };
    if lines.next()? == NextLine::TooLong {
        let what = "the header line's length in bytes".to_owned();
        return Err(InputError::TooLarge { path: label.to_owned(), what, limit: limit as u64 });
    }
    let mut next = Some(without_bom(&lines.line).to_vec());
    while let Some(header) = next {
        next = read_sequence(&header, &mut lines, sink)?;
    }
    Ok(())
}

struct Lines<'a> {
    label: &'a str,
    lines: &'a mut dyn BufRead,
    limit: usize,
    line: Vec<u8>,
    /// Of the line, from 1.
    number: usize,
    bytes_read: &'a dyn Fn() -> u64,
}

impl Lines<'_> {
    fn next(&mut self) -> Result<NextLine, InputError> {
        self.number += 1;
        next_line(self.lines, &mut self.line, self.limit).map_err(|cause| InputError::io(self.label, cause))
    }
}

/// Reads the features behind a header. Returns the next header.
fn read_sequence(
    header: &[u8],
    lines: &mut Lines<'_>,
    sink: &mut dyn ObjectSink,
) -> Result<Option<Vec<u8>>, InputError> {
    let label = lines.label;
    let mut header: CityJsonDocument<'_> =
        serde_json::from_slice(header).map_err(|error| InputError::json(label, &error))?;
    if header.kind.as_deref() != Some("CityJSON") {
        return Err(InputError::unsupported(label, "its first line is not a CityJSON header"));
    }
    let is_latitude_first = begin(label, &header, lines.number == 1, sink)?;
    let appearance: CityJsonAppearance = parse_member(header.appearance.take(), "appearance", sink);
    let templates: GeometryTemplates = parse_member(header.templates.take(), "geometry-templates", sink);
    let shared = SharedMembers {
        label,
        transform: header.transform,
        is_latitude_first,
        templates: &templates,
        appearance: &appearance,
    };
    // The header may have objects too.
    read_feature(&shared, &header, sink)?;
    loop {
        match lines.next()? {
            NextLine::EndOfFile => return Ok(None),
            NextLine::TooLong => {
                sink.skip("line too long", format!("line {}: more than {} bytes", lines.number, lines.limit));
            }
            NextLine::Complete if lines.line.trim_ascii().is_empty() => {}
            NextLine::Complete => {
                let mut repaired = Vec::new();
                match parse_line(&lines.line, &mut repaired, lines.number, sink) {
                    Some(document) if document.kind.as_deref() == Some("CityJSON") => {
                        return Ok(Some(without_bom(&lines.line).to_vec()));
                    }
                    Some(feature) => read_feature(&shared, &feature, sink)?,
                    None => {}
                }
            }
        }
        if lines.number.is_multiple_of(TICK_LINES) {
            sink.tick((lines.bytes_read)());
        }
    }
}

/// Parses a line; `None`, which is reported, if it is neither a feature nor a header. `repaired` is a buffer.
fn parse_line<'t>(
    line: &'t [u8],
    repaired: &'t mut Vec<u8>,
    number: usize,
    sink: &mut dyn ObjectSink,
) -> Option<CityJsonDocument<'t>> {
    match lenient::parse::<CityJsonDocument<'_>>(line, repaired) {
        Ok(document) if matches!(document.kind.as_deref(), Some("CityJSONFeature" | "CityJSON")) => Some(document),
        Ok(document) => {
            let kind = document.kind.unwrap_or_default();
            sink.skip("line is no feature", format!("line {number}: its type is \"{kind}\""));
            None
        }
        Err(error) => {
            let detail = format!("line {number}, column {}: {}", error.column(), json_message(&error));
            sink.skip("broken line", detail);
            None
        }
    }
}

fn read_feature(
    shared: &SharedMembers<'_>,
    document: &CityJsonDocument<'_>,
    sink: &mut dyn ObjectSink,
) -> Result<(), InputError> {
    let objects = document.city_objects.texts();
    let mut own: Option<CityJsonAppearance> =
        document.appearance.map(|raw| parse_member(Some(raw), "appearance", sink));
    if let Some(own) = &mut own {
        // The header has what all features have in common.
        let CityJsonAppearance { default_theme_texture, default_theme_material, .. } = shared.appearance;
        for (theme, common) in [
            (&mut own.default_theme_texture, default_theme_texture),
            (&mut own.default_theme_material, default_theme_material),
        ] {
            if theme.is_null() {
                theme.clone_from(common);
            }
        }
    }
    let appearance = own.as_ref().unwrap_or(shared.appearance);
    // Some writers give a feature a transform of its own.
    let shared = &SharedMembers { transform: document.transform.or(shared.transform), ..*shared };
    let batch = ObjectBatch { objects: &objects, vertices: &document.vertices, appearance };
    read_objects(shared, &batch, sink, &|_, _| {})
}
