//! Reads the features of a source one at a time.

use std::io::BufRead;

use serde_json::{Map, Value};

use super::colour::{PrismMaterial, by_use, is_water, prism_materials, water_material};
use super::footprint::Footprint;
use super::height::PrismHeight;
use super::projection::InputProjection;
use super::schema::{GeoJsonFeature, GeoJsonPolygon};
use crate::error::{InputError, json_message};
use crate::read::context::ReadContext;
use crate::read::facade::FacadeUse;
use crate::read::json::{lenient, metadata};
use crate::read::palette::{Look, ObjectShape, WallKind};
use crate::read::report::{SourceFormat, SourceReport};
use crate::read::scene_builder::{OpenObject, WorldTriangle};
use crate::read::source::{CitySource, NextLine, next_line};
use crate::scene::{ObjectKind, scratch_scene::StoredMaterial};
use crate::subject;

/// Features between two progress reports.
const TICK_FEATURES: u64 = 64;
/// Separates the records of a sequence (RFC 8142).
const RECORD_SEPARATOR: u8 = 0x1e;

/// Height of water above the ground of the footprints.
const WATER_M: f64 = 0.0;

/// What becomes of a polygon, with the numbers of its materials.
enum PolygonForm {
    Prism {
        height: PrismHeight,
        facade_use: FacadeUse,
        materials: [u32; 3],
    },
    /// A level surface.
    Water {
        material: u32,
    },
}

/// Reads the features of a source.
pub(super) struct FeatureReader<'r, 'o, 's> {
    pub(super) context: &'r mut ReadContext<'o>,
    pub(super) source: &'s CitySource<'s>,
    pub(super) report: SourceReport,
    projection: InputProjection,
    /// Number of features so far.
    count: u64,
    faces: Vec<WorldTriangle>,
}

impl<'r, 'o, 's> FeatureReader<'r, 'o, 's> {
    pub(super) fn new(context: &'r mut ReadContext<'o>, source: &'s CitySource<'s>) -> Self {
        let projection = InputProjection::new(context.crs());
        let report = SourceReport::new(&source.label, SourceFormat::GeoJson, source.bytes);
        Self { context, source, report, projection, count: 0, faces: Vec::new() }
    }

    /// Reads one feature per line. A damaged line is skipped and reported. Fails if the source cannot be read.
    pub(super) fn read_lines(&mut self, mut lines: Box<dyn BufRead + '_>, tick: &dyn Fn()) -> Result<(), InputError> {
        let limit = usize::try_from(self.context.options.max_line_bytes).unwrap_or(usize::MAX);
        let mut line = Vec::new();
        loop {
            let status = next_line(&mut *lines, &mut line, limit);
            match status.map_err(|cause| InputError::io(&self.source.label, cause))? {
                NextLine::EndOfFile => return Ok(()),
                NextLine::TooLong => {
                    self.count += 1;
                    let count = self.count;
                    self.report.skip("line too long", || format!("feature {count}: more than {limit} bytes"));
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

    /// The report of the whole source.
    pub(super) fn into_report(mut self) -> SourceReport {
        // Also of a zone that an earlier source chose.
        let zone = self.projection.zone().filter(|_| self.report.objects > 0);
        self.report.found = self.count;
        self.report.crs = self.report.crs.or_else(|| zone.map(str::to_owned));
        self.report
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
        let named = InputProjection::from_crs(crs).map_err(|what| InputError::unsupported(&self.source.label, what))?;
        let Some(epsg) = named else { return Ok(()) };
        self.projection = InputProjection::Metres;
        self.report.crs = Some(epsg);
        self.context.agree_on_crs(&self.source.label, self.report.crs.as_deref())
    }

    /// Takes metadata from any other member of the document.
    pub(super) fn describe(&mut self, name: &str, value: Value) {
        metadata::describe(&Value::Object([(name.to_owned(), value)].into_iter().collect()), &mut self.report);
    }

    /// Reads one feature; a malformed one is skipped and reported. Fails if its coordinate system differs from the
    /// city's.
    pub(super) fn read_feature(&mut self, text: &[u8]) -> Result<(), InputError> {
        self.count += 1;
        let number = self.count;
        subject::set(format_args!("{}: feature number {number}", self.source.label));
        let mut repaired = Vec::new();
        let feature = match lenient::parse::<GeoJsonFeature>(text, &mut repaired) {
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
        subject::set(format_args!("{}: feature {id}", self.source.label));
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
                if let Some(epsg) = self.projection.choose_zone(&polygons) {
                    self.context.agree_on_crs(&self.source.label, Some(&epsg))?;
                    self.report.crs = Some(epsg);
                }
                self.add_object(&id, &feature, &polygons);
            }
            Err(detail) => self.report.skip("malformed coordinates", || format!("{id}: {detail}")),
        }
        Ok(())
    }

    /// What becomes of the polygons of a feature.
    fn form_of(&mut self, id: &str, properties: &Map<String, Value>) -> PolygonForm {
        let options = self.context.options;
        let palette = &options.palette;
        if is_water(properties) {
            let water = water_material(palette);
            return PolygonForm::Water { material: self.number_of(&water) };
        }
        let height = PrismHeight::of(properties, |kind, detail| {
            self.report.problem(kind, || format!("{id}: {detail}"));
        });
        let look = Look::new(id, by_use(properties, WallKind::of_use), &ObjectShape::new());
        let materials = prism_materials(properties, palette, &look, |detail| {
            self.report.problem("colour not understood", || format!("{id}: {detail}"));
        });
        let windows = by_use(properties, FacadeUse::of_use).unwrap_or_default();
        // Walls of glass need no windows.
        let facade_use = if materials[1].is_reflective { FacadeUse::Windowless } else { windows };
        PolygonForm::Prism { height, facade_use, materials: materials.map(|material| self.number_of(&material)) }
    }

    fn number_of(&mut self, material: &PrismMaterial) -> u32 {
        let PrismMaterial { rgb, origin, is_reflective } = *material;
        self.report.colours.add(origin);
        self.context.builder.material(StoredMaterial { rgb, texture: None, is_reflective })
    }

    /// Adds the polygons of a feature as one object.
    fn add_object(&mut self, id: &str, feature: &GeoJsonFeature, polygons: &[GeoJsonPolygon]) {
        let form = self.form_of(id, &feature.properties);
        let (kind, facade_use) = match form {
            PolygonForm::Prism { facade_use, .. } => (ObjectKind::Building, facade_use),
            PolygonForm::Water { .. } => (ObjectKind::Terrain, FacadeUse::Windowless),
        };
        let mut open = OpenObject::new(kind);
        let mut fault = None;
        for polygon in polygons {
            self.faces.clear();
            let note = |kind: &str| self.report.problem(kind, || id.to_owned());
            let (triangulator, faces) = (&mut self.context.triangulator, &mut self.faces);
            let added = Footprint::new(polygon, &self.projection, note).and_then(|footprint| match &form {
                PolygonForm::Prism { height, materials, .. } => {
                    footprint.extrude(height, *materials, triangulator, faces)
                }
                PolygonForm::Water { material } => footprint.cover(WATER_M, *material, triangulator, faces),
            });
            match added {
                Ok(true) => {}
                Ok(false) => self.report.problem("ring crosses itself", || id.to_owned()),
                Err(reason) => fault = Some(reason),
            }
            self.context.push(&mut open, &mut self.faces, facade_use);
        }
        match fault {
            Some(reason) if open.triangles == 0 => self.report.skip(reason, || id.to_owned()),
            Some(reason) => self.report.problem(reason, || id.to_owned()),
            None if open.triangles == 0 => self.report.skip("no surface with an area", || id.to_owned()),
            None => {}
        }
        self.context.builder.close(self.context.source, id, open, &mut self.report);
    }
}
