//! Exports of objects as tables with footprints, and the entry of all exports of one file.
//!
//! | module | contents |
//! |---|---|
//! | `report`, `output` | what was done and why it failed; files that appear whole or not at all |
//! | `city` | blocks of objects through a cache; what is selected |
//! | `grid`, `walk` | whole coordinates on the map; end nodes along a Hilbert curve |
//! | `gather`, `columns` | the footprint of each object from meshes, or from columns where there are none |
//! | `outline`, `tidy` | union of triangles, without slivers |
//! | `record` | the columns of the tables |
//! | `csv`, `geojson`, `geoparquet`, `flatgeobuf` | the formats; `wkb` and `projjson` for geometries and coordinate systems |

pub(crate) mod city;
pub(crate) mod columns;
mod csv;
mod flatgeobuf;
pub(crate) mod gather;
pub(crate) mod geojson;
mod geoparquet;
pub(crate) mod grid;
mod outline;
pub(crate) mod output;
mod projjson;
mod record;
mod report;
#[cfg(test)]
pub(crate) mod test_city;
#[cfg(test)]
mod tests;
mod tidy;
pub(crate) mod walk;
mod wkb;

pub use report::{ExportError, ExportReport};

use crate::{cityjson, raster, selection::Selection, source::CitySource};
use city::{City, Plan};
use gather::{Footprint, visit_footprints};
use output::OutputFile;
use record::{Field, Record};
use roaring::RoaringBitmap;
use std::{fs::File, path::Path};

/// A format of one file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Comma-separated values (RFC 4180) with the footprint as well-known text.
    Csv,
    /// GeoJSON (RFC 7946).
    GeoJson,
    /// GeoParquet 1.1.
    GeoParquet,
    /// FlatGeobuf 3.
    FlatGeobuf,
    /// CityJSON 2.0 text sequences.
    CityJsonSeq,
    /// Heights as GeoTIFF 1.1.
    GeoTiff,
}

impl Format {
    /// All formats with their names on the command line.
    pub const NAMES: [(&str, Self); 6] = [
        ("csv", Self::Csv),
        ("geojson", Self::GeoJson),
        ("geoparquet", Self::GeoParquet),
        ("flatgeobuf", Self::FlatGeobuf),
        ("cityjsonseq", Self::CityJsonSeq),
        ("geotiff", Self::GeoTiff),
    ];
}

/// The city's coordinate system, as far as the caller knows it.
#[derive(Clone, Copy, Default)]
pub struct Projections<'a> {
    /// Longitude and latitude in degrees of WGS 84 of a place in world metres; `None` where the projection does not reach. Only
    /// GeoJSON needs it.
    pub to_lon_lat: Option<&'a dyn Fn([f64; 2]) -> Option<[f64; 2]>>,
    /// EPSG code of the projected system of the plane, such as 28992 where the manifest says `EPSG:7415`.
    pub epsg: Option<u32>,
    /// Its definition. Only GeoParquet needs it, because its readers do not look codes up.
    pub definition: Option<&'a PlaneDefinition>,
}

/// How a projected coordinate system is defined.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneDefinition {
    /// EPSG code of the geographic system that is projected, such as 4289. With it, readers find the shift of its datum.
    pub base_epsg: u32,
    /// Definition for PROJ, such as `+proj=utm +zone=32 +ellps=GRS80 +units=m`.
    pub proj: String,
    /// Semi-major axis in metres and inverse flattening of the ellipsoid; infinite for a sphere.
    pub ellipsoid: [f64; 2],
}

/// Writes the selected part of a city as a file. Nothing is at `out` if it fails, or what was there before.
///
/// Tables have one row for each selected object, with its number, identifiers, kind, footprint, heights, area and attributes. The
/// footprint of an object includes its parts. Memory holds the objects around one place at a time.
pub fn export(
    source: &dyn CitySource,
    format: Format,
    selection: &Selection,
    projections: &Projections<'_>,
    out: &Path,
) -> Result<ExportReport, ExportError> {
    check(selection)?;
    let city = City::new(source);
    match format {
        Format::GeoTiff => raster::write(&city, selection, projections, out),
        Format::CityJsonSeq => cityjson::write(&city, &Plan::of(&city, selection)?, out),
        _ => write_table(&city, format, &Plan::of(&city, selection)?, projections, out),
    }
}

/// Fails on a selection in which no place can be.
fn check(selection: &Selection) -> Result<(), ExportError> {
    let wrong = |reason: &str| Err(ExportError::Selection(reason.to_owned()));
    if let Some([min, max]) = selection.bbox {
        let is_ordered = (0..2).all(|k| min[k] <= max[k] && min[k].is_finite() && max[k].is_finite());
        if !is_ordered {
            return wrong("the box must be west, south, east, north, in metres of the city's coordinate system");
        }
    }
    if let Some(rings) = &selection.polygon {
        let is_finite = rings.iter().flatten().flatten().all(|v| v.is_finite());
        if rings.is_empty() || rings.iter().any(|ring| ring.len() < 3) || !is_finite {
            return wrong("the polygon needs rings of three or more points");
        }
    }
    Ok(())
}

/// Writes rows in one format.
trait RecordWriter {
    /// Writes a row, or returns why the format cannot have it. Fails if the file cannot be written.
    fn write(&mut self, record: &Record) -> Result<Option<&'static str>, ExportError>;
    /// Ends the file. Fails if it cannot be written.
    fn finish(self: Box<Self>) -> Result<File, ExportError>;
}

/// What the writers of all tables need.
struct TableSetup<'a> {
    /// Of the city, for people.
    title: &'a str,
    fields: &'a [Field],
    projections: &'a Projections<'a>,
    attribution: &'a str,
    path: &'a Path,
}

fn write_table(
    city: &City<'_>,
    format: Format,
    plan: &Plan,
    projections: &Projections<'_>,
    out: &Path,
) -> Result<ExportReport, ExportError> {
    let mut report = ExportReport::new(city.source);
    let fields = record::fields(city.source.schema());
    let (output, file) = OutputFile::create(out)?;
    let attribution = report.attribution.clone();
    let title = &city.manifest.title;
    let setup = TableSetup { title, fields: &fields, projections, attribution: &attribution, path: out };
    let mut writer: Box<dyn RecordWriter> = match format {
        Format::GeoJson => Box::new(geojson::Writer::new(&setup, file)?),
        Format::GeoParquet => Box::new(geoparquet::Writer::new(&setup, file)?),
        Format::FlatGeobuf => Box::new(flatgeobuf::Writer::new(&setup, file)?),
        _ => Box::new(csv::Writer::new(&setup, file)?),
    };
    write_records(city, plan, writer.as_mut(), &mut report)?;
    report.bytes = output.commit(writer.finish()?)?;
    report.files.push(out.to_owned());
    match format {
        Format::Csv => csv::write_sidecar(&setup, &mut report)?,
        Format::GeoJson if projections.to_lon_lat.is_none() => report.warnings.push(
            "the city's coordinate system is not known: coordinates are its own, not longitude and latitude as GeoJSON asks for"
                .to_owned(),
        ),
        Format::GeoParquet if projections.definition.is_none() || projections.epsg.is_none() => {
            report.warnings.push("the city's coordinate system is not known: readers will ask for it".to_owned());
        }
        Format::FlatGeobuf if projections.epsg.is_none() => {
            report.warnings.push("the city's coordinate system is not known: readers will ask for it".to_owned());
        }
        _ => {}
    }
    Ok(report)
}

fn write_records(
    city: &City<'_>,
    plan: &Plan,
    writer: &mut dyn RecordWriter,
    report: &mut ExportReport,
) -> Result<(), ExportError> {
    let mut written = RoaringBitmap::new();
    let mut write = |object: u32, footprint: Option<Footprint>| -> Result<(), ExportError> {
        let Some(stored) = city.record(object)? else { return Ok(()) };
        let parent = stored.parent.map(|parent| city.identifier(parent)).transpose()?;
        let (identifier, kind, attributes) = (stored.identifier, stored.kind, stored.attributes);
        let record = Record { object, identifier, parent, kind, footprint, attributes };
        match writer.write(&record)? {
            Some(reason) => report.skip(reason),
            None => {
                report.objects += 1;
                report.without_geometry += u64::from(record.footprint.is_none());
            }
        }
        Ok(())
    };
    visit_footprints(city, plan, &mut |object, footprint| {
        written.insert(object);
        write(object, Some(footprint))
    })?;
    for object in &plan.selected - &written {
        write(object, None)?;
    }
    Ok(())
}
