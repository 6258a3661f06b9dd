//! `inspect` of city files: kinds, counts, levels of detail, extent, coordinate system and attributes, before a bake.

use super::bake::{read_options, unknown_names};
use super::error::CommandError;
use super::interrupt;
use super::output::{print, print_pretty};
use crate::args::InspectArgs;
use insula_bake::read::{AttributeCount, FaultCount, InputSurvey, ReadOptions, ReadProgress, SourceReport, survey};
use insula_protocol::text::{count, human_bytes, printable};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::io::IsTerminal;
use std::path::Path;
use std::time::{Duration, Instant};

/// Rows of a table that are shown; JSON has all.
const MAX_ROWS: usize = 40;
/// Time between two lines of progress.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(500);

/// Whether `inspect` reads the path as an input of a bake: it exists and is no baked city, or it is a list or an address.
pub(super) fn is_input(path: &Path) -> bool {
    let text = path.to_string_lossy();
    let name = text.rsplit('/').next().unwrap_or_default();
    let is_tileset = text.starts_with("http") && name.ends_with(".json") && name != "city.json";
    // A baked city in a bucket cannot be inspected there.
    let is_marked = text.starts_with('@') || text.starts_with("s3://");
    path.exists() && !path.join("city.json").is_file() || is_marked || is_tileset
}

/// Reads the input and prints what it contains. Fails if a bake would.
pub(super) fn run(args: &InspectArgs) -> Result<(), CommandError> {
    let options = ReadOptions { skip_bad_inputs: true, ..read_options(&args.read)? };
    // Which removes the copies of unpacked inputs.
    interrupt::watch(None, || {}, || {});
    let last = Cell::new(Instant::now());
    let progress = |ReadProgress { bytes_done, bytes_total }: ReadProgress| {
        if std::io::stderr().is_terminal() && last.get().elapsed() > PROGRESS_INTERVAL {
            last.set(Instant::now());
            eprint!("\rreading {:.0}%", 100.0 * bytes_done as f64 / bytes_total.max(1) as f64);
        }
    };
    let found = survey(std::slice::from_ref(&args.city), &options, &progress);
    if std::io::stderr().is_terminal() {
        eprint!("\r\x1b[K");
    }
    let found = found.map_err(|error| CommandError::Bake(error.to_string()))?;
    if args.json {
        return print_pretty(&found);
    }
    print(&to_text(&found, &unknown_names(&args.read, &found.read)));
    Ok(())
}

fn to_text(survey: &InputSurvey, more_warnings: &[String]) -> String {
    let read = &survey.read;
    let mut out = String::new();
    let mut line = |name: &str, value: String| {
        let _ = writeln!(out, "{name:<12}{}", printable(&value));
    };
    line("CRS", read.crs.clone().unwrap_or_else(|| "none named: metres of an unknown place".into()));
    if let Some(vertical) = &read.vertical_datum {
        let geoid = read.geoid.as_ref().map(|geoid| format!(" (geoid {geoid})")).unwrap_or_default();
        line("heights", format!("{vertical}{geoid}"));
    }
    if let Some([[x0, y0, z0], [x1, y1, z1]]) = survey.bounds {
        line("extent", format!("{:.1} x {:.1} x {:.1} m from {x0:.1}, {y0:.1}, {z0:.1}", x1 - x0, y1 - y0, z1 - z0));
    }
    line("objects", format!("{} with {}", read.objects, count(read.triangles, "triangle")));
    for bad in &read.bad_inputs {
        line("left out", format!("{}: {}", bad.path, bad.reason));
    }
    read.unread.iter().for_each(|unread| line("not read", unread.clone()));
    for warning in read.placing_warnings() {
        line("warning", warning.to_owned());
    }
    for warning in read.warnings().chain(more_warnings.iter().cloned()) {
        line("warning", warning);
    }
    for source in read.sources.iter().take(MAX_ROWS) {
        out.push('\n');
        out.push_str(&source_text(source));
    }
    if read.sources.len() > MAX_ROWS {
        let _ = writeln!(out, "\nand {} more; --json has all", count((read.sources.len() - MAX_ROWS) as u64, "source"));
    }
    out
}

fn source_text(source: &SourceReport) -> String {
    let mut out = format!("{} ({:?}, {})\n", printable(&source.path), source.format, human_bytes(source.bytes));
    let mut row = |name: &str, value: String| {
        let _ = writeln!(out, "  {name:<12}{}", printable(&value));
    };
    row("CRS", source.crs.clone().unwrap_or_else(|| "-".into()));
    row("found", count(source.found, "object"));
    let list = |map: &mut dyn Iterator<Item = (String, u64)>| {
        map.map(|(name, n)| format!("{n} {name}")).collect::<Vec<_>>().join(", ")
    };
    let kinds = list(&mut source.objects_by_kind.iter().map(|(kind, n)| (kind.name().to_owned(), *n)));
    if !kinds.is_empty() {
        row("kinds", kinds);
    }
    row("types", list(&mut source.objects_by_type.iter().take(MAX_ROWS).map(|(name, n)| (name.clone(), *n))));
    let levels = list(&mut source.objects_by_level.iter().map(|(level, n)| (format!("at LoD {level}"), *n)));
    if !levels.is_empty() {
        row("levels", levels);
    }
    if source.textures > 0 {
        row("textures", source.textures.to_string());
    }
    if source.duplicates.count > 0 {
        row("duplicates", fault(&source.duplicates));
    }
    for (name, faults) in [("merged", &source.merged), ("skipped", &source.skipped), ("problems", &source.problems)] {
        faults.iter().for_each(|(reason, found)| row(name, format!("{reason}: {}", fault(found))));
    }
    for (what, texts) in
        [("title", &source.titles), ("attribution", &source.attributions), ("licence", &source.licences)]
    {
        texts.iter().for_each(|text| row(what, text.clone()));
    }
    out.push_str(&attribute_text(&source.attributes));
    out
}

fn fault(fault: &FaultCount) -> String {
    let first = fault.first.first().map(|first| format!(" (first: {first})")).unwrap_or_default();
    format!("{}{first}", fault.count)
}

fn attribute_text(attributes: &BTreeMap<String, AttributeCount>) -> String {
    let mut out = String::new();
    if attributes.is_empty() {
        return out;
    }
    let _ = writeln!(out, "  {:<32} {:>8}  {:<16} examples", "attribute", "values", "types");
    for (name, attribute) in attributes.iter().take(MAX_ROWS) {
        let types = attribute.types.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
        let examples = attribute.examples.join(" | ");
        let examples: String = examples.chars().take(80).collect();
        let _ = writeln!(out, "  {:<32} {:>8}  {types:<16} {}", printable(name), attribute.count, printable(&examples));
    }
    if attributes.len() > MAX_ROWS {
        let _ = writeln!(out, "  and {} more; --json has all", attributes.len() - MAX_ROWS);
    }
    out
}
