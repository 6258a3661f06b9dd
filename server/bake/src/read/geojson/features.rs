//! Reads the features of a source one at a time.

use std::io::BufRead;

use serde_json::{Map, Value};

use super::schema::GeoJsonFeature;
use crate::error::{InputError, json_message};
use crate::read::attributes::Attributes;
use crate::read::footprint::kind_of;
use crate::read::json::{attributes::flatten, lenient, metadata};
use crate::read::object::{AxisOrder, CrsReference, FeatureKind, Footprint, ObjectSink, Shape, SourceObject};
use crate::read::sink::SceneSink;
use crate::read::source::{CitySource, NextLine, next_line};
use crate::subject;

/// Features between two progress reports.
const TICK_FEATURES: u64 = 64;
/// Separates the records of a sequence (RFC 8142).
const RECORD_SEPARATOR: u8 = 0x1e;
/// What RFC 7946 prescribes.
const DEGREES: &str = "OGC:CRS84";

/// Reads the features of a source.
pub(super) struct FeatureReader<'r, 'o, 's> {
    pub(super) sink: SceneSink<'r, 'o, 's>,
    pub(super) source: &'s CitySource<'s>,
    /// Number of features so far.
    count: u64,
    has_crs: bool,
    /// Whether a feature without identifier is named by its text, because its number depends on the slice of the sequence.
    is_named_by_text: bool,
}

impl<'r, 'o, 's> FeatureReader<'r, 'o, 's> {
    pub(super) fn new(sink: SceneSink<'r, 'o, 's>, source: &'s CitySource<'s>) -> Self {
        Self { sink, source, count: 0, has_crs: false, is_named_by_text: false }
    }

    /// Reads one feature per line. A damaged line is skipped and reported. Fails if the source cannot be read.
    pub(super) fn read_lines(&mut self, mut lines: Box<dyn BufRead + '_>, tick: &dyn Fn()) -> Result<(), InputError> {
        self.is_named_by_text = true;
        let limit = usize::try_from(self.sink.options().max_line_bytes).unwrap_or(usize::MAX);
        let mut line = Vec::new();
        loop {
            let status = next_line(&mut *lines, &mut line, limit);
            match status.map_err(|cause| InputError::io(&self.source.label, cause))? {
                NextLine::EndOfFile => return Ok(()),
                NextLine::TooLong => {
                    self.count += 1;
                    self.sink.skip("line too long", format!("feature {}: more than {limit} bytes", self.count));
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
        if self.count > 0 {
            let what = "its \"crs\" comes after its features; move it to the front";
            return Err(InputError::unsupported(&self.source.label, what));
        }
        let named = name_of(crs).map_err(|what| InputError::unsupported(&self.source.label, what))?;
        let Some(name) = named else { return Ok(()) };
        self.has_crs = true;
        self.sink.set_crs(&CrsReference { name, order: AxisOrder::EastFirst })
    }

    /// Takes metadata from any other member of the document.
    pub(super) fn describe(&mut self, name: &str, value: Value) {
        let members = Value::Object([(name.to_owned(), value)].into_iter().collect());
        metadata::describe(&members, self.sink.report_mut());
    }

    /// Reads one feature; a malformed one is skipped and reported. Fails if its coordinate system cannot be that of the
    /// city.
    pub(super) fn read_feature(&mut self, text: &[u8]) -> Result<(), InputError> {
        if !std::mem::replace(&mut self.has_crs, true) {
            self.sink.set_crs(&CrsReference { name: DEGREES.to_owned(), order: AxisOrder::EastFirst })?;
        }
        self.count += 1;
        let number = self.count;
        subject::set(format_args!("{}: feature number {number}", self.source.label));
        let mut repaired = Vec::new();
        let feature = match lenient::parse::<GeoJsonFeature>(text, &mut repaired) {
            Ok(feature) if feature.kind == "Feature" => feature,
            Ok(feature) => {
                self.sink.skip("no feature", format!("feature {number}: its type is \"{}\"", feature.kind));
                return Ok(());
            }
            Err(error) => {
                self.sink.skip("malformed feature", format!("feature {number}: {}", json_message(&error)));
                return Ok(());
            }
        };
        let id = feature.id().unwrap_or_else(|| match self.is_named_by_text {
            true => format!("feature {}", &blake3::hash(text).to_hex()[..16]),
            false => format!("feature {number}"),
        });
        let Some(geometry) = &feature.geometry else {
            self.sink.skip("no geometry", id);
            return Ok(());
        };
        let footprints = match geometry.footprints() {
            Ok(footprints) if footprints.is_empty() => {
                self.sink.skip("no polygon", format!("{id}: its geometry is \"{}\"", geometry.kind));
                return Ok(());
            }
            Ok(footprints) => footprints,
            Err(detail) => {
                self.sink.skip("malformed coordinates", format!("{id}: {detail}"));
                return Ok(());
            }
        };
        let object = object_of(id, &geometry.kind, &feature.properties, footprints);
        self.sink.add(object)
    }
}

fn object_of(
    id: String,
    source_type: &str,
    properties: &Map<String, Value>,
    footprints: Vec<Footprint>,
) -> SourceObject {
    let mut attributes = Attributes::default();
    flatten(properties, &mut attributes);
    SourceObject {
        id,
        parent: None,
        kind: kind_of(&attributes).unwrap_or(FeatureKind::Building),
        source_type: source_type.to_owned(),
        lod: None,
        attributes,
        shape: Shape::Footprints(footprints),
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
