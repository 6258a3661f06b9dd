//! CityJSONSeq: a header line, then one feature per line. Only one line is in memory at a time.

use std::io::BufRead;

use super::geometry::ObjectReader;
use super::objects::{ObjectBatch, SharedMembers, begin, parse_member, read_objects};
use super::schema::{CityJsonAppearance, CityJsonDocument, GeometryTemplates};
use crate::read::context::ReadContext;
use insula_source::error::{InputError, json_message};
use insula_source::json::{lenient, without_bom};
use insula_source::report::{SourceFormat, SourceReport};
use insula_source::source::{CitySource, NextLine, next_line};

/// Lines between two progress reports.
const TICK_LINES: usize = 64;

/// Reads a sequence. A damaged line is skipped and reported. Fails if the header is damaged.
pub(super) fn read(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    lines: &mut dyn BufRead,
    tick: &dyn Fn(),
) -> Result<SourceReport, InputError> {
    let limit = usize::try_from(context.options.max_line_bytes).unwrap_or(usize::MAX);
    let mut line = Vec::new();
    let mut next =
        |line: &mut Vec<u8>| next_line(lines, line, limit).map_err(|cause| InputError::io(&source.label, cause));
    if next(&mut line)? == NextLine::TooLong {
        let what = "the header line's length in bytes".to_owned();
        return Err(InputError::TooLarge { path: source.label.clone(), what, limit: limit as u64 });
    }
    let first = without_bom(&line).to_vec();
    let mut header: CityJsonDocument<'_> =
        serde_json::from_slice(&first).map_err(|error| InputError::json(&source.label, &error))?;
    if header.kind.as_deref() != Some("CityJSON") {
        let what = "its first line is not a CityJSON header";
        return Err(InputError::unsupported(&source.label, what));
    }
    let (mut report, placement) = begin(context, source, &header, SourceFormat::CityJsonSeq)?;
    let appearance: CityJsonAppearance = parse_member(header.appearance.take(), "appearance", &mut report);
    let templates: GeometryTemplates = parse_member(header.templates.take(), "geometry-templates", &mut report);
    let (transform, placement) = (header.transform, &placement);
    let shared = SharedMembers { transform, placement, templates: &templates, appearance: &appearance };
    // The header may have objects too.
    read_feature(context, source, &shared, &header, &mut report);
    let mut number = 1;
    loop {
        let status = next(&mut line)?;
        number += 1;
        match status {
            NextLine::EndOfFile => return Ok(report),
            NextLine::TooLong => {
                report.found += 1;
                report.skip("line too long", || format!("line {number}: more than {limit} bytes"));
            }
            NextLine::Complete if line.trim_ascii().is_empty() => {}
            NextLine::Complete => {
                let mut repaired = Vec::new();
                if let Some(feature) = parse_feature(&line, &mut repaired, number, &mut report) {
                    read_feature(context, source, &shared, &feature, &mut report);
                }
            }
        }
        if number % TICK_LINES == 0 {
            tick();
        }
    }
}

/// Parses a line; `None`, with the reason in the report, if it is not a feature. `repaired` is a buffer.
fn parse_feature<'t>(
    line: &'t [u8],
    repaired: &'t mut Vec<u8>,
    number: usize,
    report: &mut SourceReport,
) -> Option<CityJsonDocument<'t>> {
    match lenient::parse::<CityJsonDocument<'_>>(line, repaired) {
        Ok(document) if document.kind.as_deref() == Some("CityJSONFeature") => Some(document),
        Ok(document) => {
            let kind = document.kind.unwrap_or_default();
            report.found += 1;
            report.skip("line is no feature", || format!("line {number}: its type is \"{kind}\""));
            None
        }
        Err(error) => {
            report.found += 1;
            let detail = || format!("line {number}, column {}: {}", error.column(), json_message(&error));
            report.skip("broken line", detail);
            None
        }
    }
}

fn read_feature(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    shared: &SharedMembers<'_>,
    document: &CityJsonDocument<'_>,
    report: &mut SourceReport,
) {
    let objects = document.city_objects.texts();
    let mut own: Option<CityJsonAppearance> =
        document.appearance.map(|raw| parse_member(Some(raw), "appearance", report));
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
    let batch = ObjectBatch { objects: &objects, vertices: &document.vertices, appearance };
    read_objects(ObjectReader::new(context, source, report), shared, &batch, &|_| {});
}
