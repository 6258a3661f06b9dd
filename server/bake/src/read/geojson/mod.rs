//! GeoJSON footprints, raised to prisms: a document whose features are read one at a time, or a feature a line.
//!
//! In: a source. Out: objects in the builder and a [`SourceReport`]. Next: `builder`.

mod colour;
mod footprint;
mod height;
mod model;
mod place;
mod stream;
#[cfg(test)]
mod tests;

use std::io::BufRead;

use serde_json::Value;

use super::builder::WorldTriangle;
use super::cityjson::{lenient, metadata};
use super::error::{InputError, json_message};
use super::report::{SourceFormat, SourceReport};
use super::source::{CitySource, SourceKind, named_as, next_line, open};
use super::{ByteProgress, ReadContext};
use crate::scene::ObjectKind;
use footprint::Footprint;
use height::PrismHeight;
use model::GeoJsonFeature;
use place::InputProjection;

pub(super) use stream::kind_of;

/// After how many features progress is told.
const TICK_FEATURES: u64 = 64;
/// Between records of a sequence (RFC 8142).
const RECORD_SEPARATOR: u8 = 0x1e;

/// Reads a source.
pub(crate) fn read(
    reading: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    tick: ByteProgress<'_>,
) -> Result<SourceReport, InputError> {
    let opened = open(source)?;
    let taken = opened.taken;
    let mut features = FeatureReader::new(reading, source);
    let tick = || tick(taken.get());
    if named_as(&source.name) == Some(SourceKind::GeoJsonLines) {
        features.lines(opened.reader, &tick)?;
    } else {
        stream::read(opened.reader, &mut features, &tick)?;
    }
    Ok(features.report)
}

/// What all features of a source share.
struct FeatureReader<'r, 'o, 's> {
    reading: &'r mut ReadContext<'o>,
    source: &'s CitySource<'s>,
    report: SourceReport,
    place: InputProjection,
    /// Features met.
    count: u64,
    faces: Vec<WorldTriangle>,
}

impl<'r, 'o, 's> FeatureReader<'r, 'o, 's> {
    fn new(reading: &'r mut ReadContext<'o>, source: &'s CitySource<'s>) -> Self {
        let place = InputProjection::new(reading.crs.as_ref().map(|(crs, _)| crs.as_str()));
        let report = SourceReport::new(&source.label, SourceFormat::GeoJson, source.bytes);
        Self { reading, source, report, place, count: 0, faces: Vec::new() }
    }

    /// Features line by line; a broken line costs itself.
    fn lines(&mut self, mut lines: Box<dyn BufRead + '_>, tick: &dyn Fn()) -> Result<(), InputError> {
        let limit = usize::try_from(self.reading.options.max_line_bytes).unwrap_or(usize::MAX);
        let mut line = Vec::new();
        let next = |lines: &mut dyn BufRead, line: &mut Vec<u8>| {
            next_line(lines, line, limit).map_err(|cause| InputError::io(&self.source.label, cause))
        };
        while let Some(whole) = next(&mut *lines, &mut line)? {
            let text = line.strip_prefix(&[RECORD_SEPARATOR]).unwrap_or(&line).trim_ascii();
            if !whole {
                self.count += 1;
                let count = self.count;
                self.report.skip("line too long", || format!("feature {count}: more than {limit} bytes"));
            } else if !text.is_empty() {
                self.feature(text)?;
            }
            self.tick(tick);
        }
        Ok(())
    }

    fn tick(&self, tick: &dyn Fn()) {
        if self.count.is_multiple_of(TICK_FEATURES) {
            tick();
        }
    }

    /// The document's own coordinate system, if it names one.
    fn system(&mut self, crs: &Value) -> Result<(), InputError> {
        if self.count > 0 {
            let what = "its \"crs\" comes after its features; move it to the front";
            return Err(InputError::unsupported(&self.source.label, what));
        }
        match InputProjection::named(crs).map_err(|what| InputError::unsupported(&self.source.label, what))? {
            None => Ok(()),
            Some((place, epsg)) => {
                self.place = place;
                self.report.crs = Some(epsg);
                self.reading.agree_on_crs(&self.source.label, self.report.crs.as_deref())
            }
        }
    }

    /// Any other member may say who made the data.
    fn about(&mut self, name: &str, value: Value) {
        metadata::describe(&Value::Object([(name.to_owned(), value)].into_iter().collect()), &mut self.report);
    }

    /// One feature's text. Only what concerns all of them is an error.
    fn feature(&mut self, text: &[u8]) -> Result<(), InputError> {
        self.count += 1;
        let number = self.count;
        let parsed =
            serde_json::from_slice::<GeoJsonFeature>(text).or_else(|error| match lenient::without_odd_numbers(text) {
                Some(clean) => serde_json::from_slice(&clean),
                None => Err(error),
            });
        let feature = match parsed {
            Ok(feature) if feature.kind == "Feature" => feature,
            Ok(feature) => {
                self.report.skip("no feature", || format!("feature {number}: its type is \"{}\"", feature.kind));
                return Ok(());
            }
            Err(error) => {
                self.report.skip("malformed feature", || format!("feature {number}: {}", json_message(&error)));
                return Ok(());
            }
        };
        let id = feature.id().unwrap_or_else(|| format!("feature {number}"));
        let Some(geometry) = &feature.geometry else {
            self.report.skip("no geometry", || id);
            return Ok(());
        };
        self.report.count_type(&geometry.kind);
        match geometry.polygons() {
            Ok(polygons) if polygons.is_empty() => {
                self.report.skip("no polygon", || format!("{id}: its geometry is \"{}\"", geometry.kind));
            }
            Ok(polygons) => {
                if let Some(epsg) = self.place.settle(&polygons) {
                    self.reading.agree_on_crs(&self.source.label, Some(&epsg))?;
                    self.report.crs = Some(epsg);
                }
                self.raise(&id, &feature, &polygons);
            }
            Err(detail) => self.report.skip("malformed coordinates", || format!("{id}: {detail}")),
        }
        Ok(())
    }

    /// Polygons to one object.
    fn raise(&mut self, id: &str, feature: &GeoJsonFeature, polygons: &[model::GeoJsonPolygon]) {
        let height = PrismHeight::of(&feature.properties, |kind, detail| {
            self.report.problem(kind, || format!("{id}: {detail}"));
        });
        let colours = colour::of(&feature.properties, &self.reading.options.palette, |detail| {
            self.report.problem("colour not understood", || format!("{id}: {detail}"));
        });
        let materials = colours.map(|rgb| self.reading.builder.material(rgb, None));
        self.faces.clear();
        let mut fault = None;
        for polygon in polygons {
            let footprint = Footprint::new(polygon, &self.place, |kind| self.report.problem(kind, || id.to_owned()));
            match footprint {
                Ok(footprint) => {
                    let triangulator = &mut self.reading.triangulator;
                    match footprint.raise(&height, materials, triangulator, &mut self.faces) {
                        Ok(true) => {}
                        Ok(false) => self.report.problem("ring crosses itself", || id.to_owned()),
                        Err(reason) => fault = Some(reason),
                    }
                }
                Err(reason) => fault = Some(reason),
            }
        }
        match fault {
            Some(reason) if self.faces.is_empty() => self.report.skip(reason, || id.to_owned()),
            Some(reason) => self.report.problem(reason, || id.to_owned()),
            None => {}
        }
        let (source, kind) = (self.reading.source, ObjectKind::Building);
        self.reading.builder.add(source, id, kind, &self.faces, &mut self.report);
    }
}
