//! Reads the features of a source one at a time.

use super::geometry::Fault;
use super::schema::{GeoJsonFeature, name_of};
use crate::vector::feature::{DEGREES, FeatureWriter, NamedFeature, mostly_east_first};
use crate::vector::geometry::{Geometry, UNKNOWN_TYPE};
use crate::vector::layer::Columns;
use insula_dress::footprint::{HeightHints, has_height, kind_of};
use insula_place::placement::{is_on_globe, width_deg};
use insula_source::attributes::Attributes;
use insula_source::error::{InputError, json_message};
use insula_source::json::attributes::flatten;
use insula_source::json::members::Members;
use insula_source::json::{lenient, metadata};
use insula_source::object::{CrsReference, FeatureKind};
use insula_source::source::{NextLine, next_line};
use insula_source::subject;
use serde_json::Value;
use std::io::BufRead;

/// Features between two progress reports.
const TICK_FEATURES: u64 = 64;
/// No building is so large; one that is has its coordinates in metres of a plan.
const MAX_BUILDING_DEG: f64 = 1.0;
/// Separates the records of a sequence (RFC 8142).
const RECORD_SEPARATOR: u8 = 0x1e;

/// The system of the member `geometry`.
enum GeometrySystem {
    Named(String),
    /// Degrees, as RFC 7946 prescribes, if they can be so.
    Prescribed,
    /// No degrees: that of the city.
    OfCity,
}

/// The system that a feature itself tells.
enum OwnSystem {
    /// Of its `place`, with coordinates in the order of the system's definition.
    Place(String),
    /// Of its `geometry`, by a member `crs`.
    Member(String),
}

/// Reads the features of a source.
pub(super) struct FeatureReader<'a> {
    pub(super) writer: FeatureWriter<'a>,
    pub(super) label: &'a str,
    /// Number of features so far.
    count: u64,
    /// `None` before the first position.
    system: Option<GeometrySystem>,
    /// The system of the member `place` of features that name none, by `coordRefSys` of the document.
    place_system: Option<String>,
    /// Whether `place_system` is known, or known to be missing.
    is_place_system_known: bool,
    /// Finds a `coordRefSys` that comes after the features of a document. Lines are no document.
    later_system: Option<&'a dyn Fn() -> Option<Value>>,
    /// Whether a feature without identifier is named by its text, because its number depends on the slice of the sequence.
    is_named_by_text: bool,
}

impl<'a> FeatureReader<'a> {
    pub(super) fn new(
        writer: FeatureWriter<'a>,
        label: &'a str,
        later_system: Option<&'a dyn Fn() -> Option<Value>>,
    ) -> Self {
        Self {
            writer,
            label,
            count: 0,
            system: None,
            place_system: None,
            is_place_system_known: false,
            later_system,
            is_named_by_text: false,
        }
    }

    /// Reads one feature per line, of `limit` bytes at most. A damaged line is skipped and reported. Fails if the source cannot
    /// be read.
    pub(super) fn read_lines(
        &mut self,
        mut lines: Box<dyn BufRead + '_>,
        limit: u64,
        bytes_read: &dyn Fn() -> u64,
    ) -> Result<(), InputError> {
        self.is_named_by_text = true;
        // Whether other lines are walls is not known to the slice of a sequence.
        self.writer.take_level_polygons_as_plans();
        let limit = usize::try_from(limit).unwrap_or(usize::MAX);
        let mut line = Vec::new();
        loop {
            let status = next_line(&mut *lines, &mut line, limit);
            match status.map_err(|cause| InputError::io(self.label, cause))? {
                NextLine::EndOfFile => return Ok(()),
                NextLine::TooLong => {
                    self.count += 1;
                    let detail = format!("feature {}: more than {limit} bytes", self.count);
                    self.writer.sink.skip("line too long", detail);
                }
                NextLine::Complete => {
                    let text = line.strip_prefix(&[RECORD_SEPARATOR]).unwrap_or(&line).trim_ascii();
                    if !text.is_empty() {
                        self.read_feature(text)?;
                    }
                }
            }
            self.tick(bytes_read);
        }
    }

    /// Reports progress now and then.
    pub(super) fn tick(&mut self, bytes_read: &dyn Fn() -> u64) {
        if self.count.is_multiple_of(TICK_FEATURES) {
            self.writer.sink.tick(bytes_read());
        }
    }

    /// Applies the document's `crs` member. Fails if it has no name, or comes after a feature that was read in another system.
    pub(super) fn set_crs(&mut self, crs: &Value) -> Result<(), InputError> {
        let named = name_of(crs).map_err(|what| InputError::unsupported(self.label, what))?;
        if self.count == 0 {
            self.system = named.map(GeometrySystem::Named);
            return Ok(());
        }
        match (named, &self.system) {
            (None, _) => Ok(()),
            (Some(name), Some(GeometrySystem::Named(known))) if name == *known => Ok(()),
            _ => {
                let what = "its \"crs\" comes after its features; move it to the front";
                Err(InputError::unsupported(self.label, what))
            }
        }
    }

    /// Whether a `crs` member came before the features.
    pub(super) fn has_crs(&self) -> bool {
        self.system.is_some()
    }

    /// Applies the document's `coordRefSys` member of JSON-FG.
    pub(super) fn set_place_system(&mut self, system: &Value) {
        (self.place_system, self.is_place_system_known) = (reference_system(system), true);
    }

    /// The system of places that name none. Looks for it behind the features, too.
    fn place_system(&mut self) -> Option<String> {
        if !self.is_place_system_known {
            let found = self.later_system.and_then(|find| find());
            (self.place_system, self.is_place_system_known) = (found.as_ref().and_then(reference_system), true);
        }
        self.place_system.clone()
    }

    /// Takes metadata from any other member of the document.
    pub(super) fn describe(&mut self, name: &str, text: &str) {
        if let Some(what) = metadata::description(name, "") {
            self.writer.sink.describe(what, text);
        }
    }

    /// Reads one feature; a malformed one is skipped and reported. Fails if its coordinate system cannot be that of the
    /// city.
    pub(super) fn read_feature(&mut self, text: &[u8]) -> Result<(), InputError> {
        self.count += 1;
        let number = self.count;
        subject::set(format_args!("{}: feature number {number}", self.label));
        let mut repaired = Vec::new();
        let feature = match lenient::parse::<GeoJsonFeature>(text, &mut repaired) {
            Ok(feature) if feature.kind == "Feature" => feature,
            Ok(feature) => {
                let detail = format!("feature {number}: its type is \"{}\"", feature.kind);
                self.writer.sink.skip("no feature", detail);
                return Ok(());
            }
            Err(error) => {
                let detail = format!("feature {number}: {}", json_message(&error));
                self.writer.sink.skip("malformed feature", detail);
                return Ok(());
            }
        };
        let id = feature.id().unwrap_or_else(|| match self.is_named_by_text {
            true => format!("feature {}", &blake3::hash(text).to_hex()[..16]),
            false => format!("feature {number}"),
        });
        let attributes = attributes_of(&feature.properties);
        let geometry = match self.geometry(&id, &feature) {
            Ok((geometry, None)) => {
                self.set_system(&geometry, &attributes)?;
                Ok(geometry)
            }
            Ok((geometry, Some(OwnSystem::Place(name)))) => {
                self.writer.set_own_crs(CrsReference::authority(name))?;
                Ok(geometry)
            }
            Ok((geometry, Some(OwnSystem::Member(name)))) => {
                self.writer.set_own_crs(mostly_east_first(name))?;
                Ok(geometry)
            }
            Err(Fault { reason, detail: None }) => Err(reason),
            Err(Fault { reason, detail: Some(detail) }) => {
                self.writer.sink.skip(reason, format!("{id}: {detail}"));
                return Ok(());
            }
        };
        let columns = Columns::new(feature.properties.iter().map(|(name, _)| name));
        self.writer.add_named(NamedFeature { id, attributes, geometry, columns })
    }

    /// The geometry of a feature, and its system if it tells one.
    fn geometry(&mut self, id: &str, feature: &GeoJsonFeature) -> Result<(Geometry, Option<OwnSystem>), Fault> {
        if let Some(place) = &feature.place {
            let own = place.coord_ref_sys.as_ref().or(feature.coord_ref_sys.as_ref()).and_then(reference_system);
            let system = own.or_else(|| self.place_system());
            match (place.read(), &feature.geometry) {
                (Ok(geometry), _) => {
                    return Ok((geometry, Some(OwnSystem::Place(system.unwrap_or_else(|| DEGREES.to_owned())))));
                }
                (Err(Fault { reason: UNKNOWN_TYPE, .. }), Some(_)) => {
                    let detail = format!("{id}: its \"place\" is a \"{}\", its \"geometry\" is taken", place.kind);
                    self.writer.sink.problem(UNKNOWN_TYPE, detail);
                }
                (Err(fault), _) => return Err(fault),
            }
        }
        let geometry = feature.geometry.as_ref().ok_or("no geometry")?;
        let own = geometry.crs.as_ref().or(feature.crs.as_ref()).map_or(Ok(None), name_of);
        let own = own.map_err(|what| Fault { reason: "coordinate system without a name", detail: Some(what) })?;
        Ok((geometry.read()?, own.map(OwnSystem::Member)))
    }

    /// Sets the system of the member `geometry`. Fails if positions of it cannot be placed.
    fn set_system(&mut self, geometry: &Geometry, attributes: &Attributes) -> Result<(), InputError> {
        let Some([west, south, east, north]) = geometry.bounds() else { return Ok(()) };
        let system = self.system.get_or_insert_with(|| {
            let is_on_globe = is_on_globe([west, south]) && is_on_globe([east, north]);
            let is_beyond_half_a_turn = west < -180.0 || east > 180.0;
            let is_large = width_deg([west, east]) > MAX_BUILDING_DEG || north - south > MAX_BUILDING_DEG;
            let is_on_globe = is_on_globe && !(is_large && (is_beyond_half_a_turn || is_building(attributes)));
            // The sink says in which system it takes others.
            if is_on_globe { GeometrySystem::Prescribed } else { GeometrySystem::OfCity }
        });
        let name = match system {
            GeometrySystem::Named(name) => name.clone(),
            GeometrySystem::Prescribed => DEGREES.to_owned(),
            GeometrySystem::OfCity => return self.writer.set_layer_crs(),
        };
        self.writer.set_crs(name)
    }
}

/// Whether a text begins with a record of a sequence, or with a feature on a line of its own and another record behind it. Many
/// programs name such files as they name documents.
pub(in crate::vector) fn is_of_lines(head: &[u8]) -> bool {
    let head = head.trim_ascii_start();
    if head.first() == Some(&RECORD_SEPARATOR) {
        return true;
    }
    let Some(end) = head.iter().position(|byte| *byte == b'\n') else { return false };
    let (line, rest) = head.split_at(end);
    rest.trim_ascii_start().starts_with(b"{")
        && lenient::parse::<GeoJsonFeature>(line, &mut Vec::new()).is_ok_and(|feature| feature.kind == "Feature")
}

/// Whether a feature is certainly a building.
fn is_building(attributes: &Attributes) -> bool {
    match kind_of(attributes) {
        Some(kind) => matches!(kind, FeatureKind::Building | FeatureKind::BuildingPart),
        None => has_height(attributes, HeightHints::default()),
    }
}

fn attributes_of(properties: &Members) -> Attributes {
    let mut attributes = Attributes::default();
    flatten(properties, &mut attributes);
    attributes
}

/// The name of the system in a `coordRefSys` member: a URI, `[EPSG:1234]`, an object with a URI, or a list of a horizontal and
/// a vertical system.
fn reference_system(system: &Value) -> Option<String> {
    match system {
        Value::String(name) => Some(name.trim_matches(['[', ']']).to_owned()),
        Value::Object(members) => reference_system(members.get("href")?),
        Value::Array(parts) => {
            // As a code of both, which is known in this spelling.
            let names: Option<Vec<String>> = parts.iter().take(3).map(reference_system).collect();
            names.map(|names| names.join(","))
        }
        _ => None,
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

    #[test]
    fn lines_are_told_by_the_first() {
        let feature = r#"{"properties": {"h": NaN}, "geometry": null, "type": "Feature"}"#;
        for text in [format!("{feature}\r\n\n{feature}"), "\n\u{1e}{".to_owned(), format!("{feature}\n{{")] {
            assert!(is_of_lines(text.as_bytes()), "{text}");
        }
        let collection = r#"{"type": "FeatureCollection", "features": []}"#;
        for text in [feature.to_owned(), format!("{feature}\n"), format!("{collection}\n{feature}"), "{\n{".to_owned()]
        {
            assert!(!is_of_lines(text.as_bytes()), "{text}");
        }
    }

    #[test]
    fn reference_systems_of_json_fg_are_understood_in_every_form() {
        let named = |text: &str| reference_system(&serde_json::from_str(text).unwrap());
        let uri = "http://www.opengis.net/def/crs/EPSG/0/5555";
        assert_eq!(named(&format!("\"{uri}\"")).as_deref(), Some(uri));
        assert_eq!(named(r#""[EPSG:25832]""#).as_deref(), Some("EPSG:25832"));
        assert_eq!(named(&format!(r#"{{"type": "Reference", "href": "{uri}"}}"#)).as_deref(), Some(uri));
        assert_eq!(named(r#"["EPSG:25832", "EPSG:7837"]"#).as_deref(), Some("EPSG:25832,EPSG:7837"));
        assert_eq!((named("null"), named("[7]"), named("{}")), (None, None, None));
    }
}
