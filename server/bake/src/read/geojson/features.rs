//! Reads the features of a source one at a time.

use std::io::BufRead;

use serde_json::{Map, Value};

use super::schema::GeoJsonFeature;
use crate::error::{InputError, json_message};
use crate::read::attributes::Attributes;
use crate::read::context::ReadOptions;
use crate::read::json::{attributes::flatten, lenient};
use crate::read::source::{NextLine, next_line};
use crate::read::vector::{FeatureWriter, Geometry};
use crate::subject;

/// Features between two progress reports.
const TICK_FEATURES: u64 = 64;
/// Separates the records of a sequence (RFC 8142).
const RECORD_SEPARATOR: u8 = 0x1e;
/// Further members of a document are not kept.
const MAX_MEMBERS: usize = 1000;
/// What RFC 7946 prescribes.
const DEGREES: &str = "OGC:CRS84";

/// Reads the features of a source.
pub(super) struct FeatureReader<'a> {
    pub(super) writer: FeatureWriter<'a>,
    pub(super) options: &'a ReadOptions,
    pub(super) label: &'a str,
    /// Number of features so far.
    count: u64,
    /// The system of geometries that are not those of JSON-FG, once it is known.
    crs: Option<String>,
    /// The system that JSON-FG names for the places of all features.
    place_crs: Option<String>,
    /// Texts of the document about itself, by the names of its members.
    pub(super) texts: Map<String, Value>,
    /// Whether a feature without identifier is named by its text, because its number depends on the slice of the sequence.
    is_named_by_text: bool,
}

impl<'a> FeatureReader<'a> {
    pub(super) fn new(writer: FeatureWriter<'a>, options: &'a ReadOptions, label: &'a str) -> Self {
        let (place_crs, texts) = (None, Map::new());
        Self { writer, options, label, count: 0, crs: None, place_crs, texts, is_named_by_text: false }
    }

    /// Reads one feature per line. A damaged line is skipped and reported. Fails if the source cannot be read.
    pub(super) fn read_lines(&mut self, mut lines: Box<dyn BufRead + '_>, tick: &dyn Fn()) -> Result<(), InputError> {
        self.is_named_by_text = true;
        let limit = usize::try_from(self.options.max_line_bytes).unwrap_or(usize::MAX);
        let mut line = Vec::new();
        loop {
            let status = next_line(&mut *lines, &mut line, limit);
            match status.map_err(|cause| InputError::io(self.label, cause))? {
                NextLine::EndOfFile => return Ok(()),
                NextLine::TooLong => {
                    self.count += 1;
                    self.writer.sink.skip("line too long", format!("feature {}: more than {limit} bytes", self.count));
                }
                NextLine::Complete => {
                    let text = line.strip_prefix(&[RECORD_SEPARATOR]).unwrap_or(&line).trim_ascii();
                    if !text.is_empty() {
                        self.read_feature(text)?;
                    }
                }
            }
            self.tick(tick);
        }
    }

    /// Calls `tick` now and then.
    pub(super) fn tick(&self, tick: &dyn Fn()) {
        if self.count.is_multiple_of(TICK_FEATURES) {
            tick();
        }
    }

    /// Applies the document's `crs` member. Fails if it comes after a feature or names an unsupported system.
    pub(super) fn set_crs(&mut self, crs: &Value) -> Result<(), InputError> {
        self.check_front("crs")?;
        let named = name_of(crs).map_err(|what| InputError::unsupported(self.label, what))?;
        let Some(name) = named else { return Ok(()) };
        self.crs = Some(name.clone());
        self.writer.set_crs(name)
    }

    /// Sets the system of the places of all features, as JSON-FG names it. Fails if features came before.
    pub(super) fn set_place_crs(&mut self, crs: &Value) -> Result<(), InputError> {
        self.check_front("coordRefSys")?;
        self.place_crs = name_of_place(crs);
        Ok(())
    }

    fn check_front(&self, member: &str) -> Result<(), InputError> {
        if self.count == 0 {
            return Ok(());
        }
        let what = format!("its \"{member}\" comes after its features; move it to the front");
        Err(InputError::unsupported(self.label, what))
    }

    /// Keeps a text of the document about itself.
    pub(super) fn describe(&mut self, name: &str, value: Value) {
        if self.texts.len() < MAX_MEMBERS {
            self.texts.insert(name.to_owned(), value);
        }
    }

    /// Reads a feature, or skips and reports it. Fails if its coordinate system is not known.
    pub(super) fn read_feature(&mut self, text: &[u8]) -> Result<(), InputError> {
        self.count += 1;
        let number = self.count;
        subject::set(format_args!("{}: feature number {number}", self.label));
        let mut repaired = Vec::new();
        let feature = match lenient::parse::<GeoJsonFeature>(text, &mut repaired) {
            Ok(feature) if feature.kind == "Feature" => feature,
            Ok(feature) => {
                self.writer.sink.skip("no feature", format!("feature {number}: its type is \"{}\"", feature.kind));
                return Ok(());
            }
            Err(error) => {
                self.writer.sink.skip("malformed feature", format!("feature {number}: {}", json_message(&error)));
                return Ok(());
            }
        };
        let id = feature.id().unwrap_or_else(|| match self.is_named_by_text {
            true => format!("feature {}", &blake3::hash(text).to_hex()[..16]),
            false => format!("feature {number}"),
        });
        let place_crs = name_of_place(&feature.crs).or_else(|| self.place_crs.clone());
        let (shape, crs) = match (&feature.place, &feature.geometry) {
            (Some(place), _) => (place, place_crs),
            (None, Some(geometry)) => (geometry, None),
            (None, None) => {
                self.writer.sink.skip("no geometry", id);
                return Ok(());
            }
        };
        let geometry = match shape.geometry() {
            Ok(geometry) => geometry,
            Err((reason, detail)) => {
                self.writer.sink.skip(reason, format!("{id}: {detail}"));
                return Ok(());
            }
        };
        match crs {
            Some(name) => self.writer.set_crs_of_registry(&name)?,
            None => {
                if self.crs.is_none() {
                    self.crs = degrees_of(&geometry);
                }
                if let Some(name) = self.crs.clone() {
                    self.writer.set_crs(name)?;
                }
            }
        }
        let mut attributes = Attributes::default();
        flatten(&feature.properties, &mut attributes);
        self.writer.add_named(id, attributes, Ok(geometry))
    }
}

/// Without a system, positions are in degrees, as RFC 7946 says; `None` if they cannot be. Some files have the latitude
/// first.
fn degrees_of(geometry: &Geometry) -> Option<String> {
    let [west, south, east, north] = geometry.bounds()?;
    let [x, y] = [west.abs().max(east.abs()), south.abs().max(north.abs())];
    (x.max(y) <= 360.0 && x.min(y) <= 90.0).then(|| DEGREES.to_owned())
}

/// The name of a `coordRefSys` member: a URI, a reference with one, or a list of both systems of a compound one.
fn name_of_place(crs: &Value) -> Option<String> {
    match crs {
        Value::String(name) => Some(name.clone()),
        Value::Array(parts) => {
            let names: Option<Vec<String>> = parts.iter().take(2).map(name_of_place).collect();
            names.map(|names| names.join(","))
        }
        crs => crs["href"].as_str().map(str::to_owned),
    }
}

/// The name of the system in a `crs` member; `None` for the default. Fails with the reason if it has none.
fn name_of(crs: &Value) -> Result<Option<String>, String> {
    match &crs["properties"] {
        properties if properties["name"].is_string() => {
            Ok(Some(properties["name"].as_str().unwrap_or_default().to_owned()))
        }
        properties if properties["code"].is_number() => Ok(Some(format!("EPSG:{}", properties["code"]))),
        _ if crs.is_null() => Ok(None),
        _ => Err("its \"crs\" has no name; remove it, or export as WGS84".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crs_member_is_understood_in_every_spelling() {
        let named = |text: &str| name_of(&serde_json::from_str(text).unwrap());
        let name = |name: &str| format!(r#"{{"type": "name", "properties": {{"name": "{name}"}}}}"#);
        assert_eq!(named("null"), Ok(None));
        assert_eq!(named(&name("EPSG:28992")), Ok(Some("EPSG:28992".to_owned())));
        assert_eq!(named(r#"{"type": "EPSG", "properties": {"code": 6677}}"#), Ok(Some("EPSG:6677".to_owned())));
        assert!(named("{}").is_err() && named("7").is_err());
    }
}
