//! GeoJSON (RFC 7946): a collection with one feature on each line, in longitude and latitude.
//!
//! Foreign members of the collection are `name` and `attribution`. A feature's `id` is the object's number.

use super::record::{Field, Record};
use super::{ExportError, Projections, RecordWriter, TableSetup};
use insula_protocol::text::without_sign_of_zero;
use serde_json::json;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

/// Decimals of degrees: 0.1 mm.
const DEGREES: f64 = 1e9;

pub(super) struct Writer<'a> {
    out: BufWriter<File>,
    fields: &'a [Field],
    projections: &'a Projections<'a>,
    is_first: bool,
    path: PathBuf,
}

impl<'a> Writer<'a> {
    pub(super) fn new(setup: &TableSetup<'a>, file: File) -> Result<Self, ExportError> {
        let (fields, projections, path) = (setup.fields, setup.projections, setup.path.to_owned());
        let mut writer = Self { out: BufWriter::new(file), fields, projections, is_first: true, path };
        let mut head = format!("{{\"type\":\"FeatureCollection\",\"name\":{}", json!(setup.title));
        if !setup.attribution.is_empty() {
            head += &format!(",\"attribution\":{}", json!(setup.attribution));
        }
        writer.put(&(head + ",\"features\":["))?;
        Ok(writer)
    }

    fn put(&mut self, text: &str) -> Result<(), ExportError> {
        self.out.write_all(text.as_bytes()).map_err(ExportError::write(&self.path))
    }

    /// The position of a place in world metres; `None` where the projection does not reach.
    fn position(&self, place: [f64; 2]) -> Option<[f64; 2]> {
        match self.projections.to_lon_lat {
            Some(to_lon_lat) => {
                to_lon_lat(place).map(|degrees| degrees.map(|v| without_sign_of_zero((v * DEGREES).round() / DEGREES)))
            }
            None => Some(place),
        }
    }

    fn coordinates(&self, polygons: &[Vec<Vec<[f64; 2]>>]) -> Option<Vec<Vec<Vec<[f64; 2]>>>> {
        let ring = |ring: &Vec<[f64; 2]>| ring.iter().map(|place| self.position(*place)).collect::<Option<Vec<_>>>();
        polygons.iter().map(|rings| rings.iter().map(ring).collect()).collect()
    }
}

impl RecordWriter for Writer<'_> {
    fn write(&mut self, record: &Record) -> Result<Option<&'static str>, ExportError> {
        let Some(mut polygons) = self.coordinates(record.polygons()) else {
            return Ok(Some("it lies where the coordinate system has no longitude and latitude"));
        };
        let geometry = match polygons.len() {
            0 => json!(null),
            1 => json!({ "type": "Polygon", "coordinates": polygons.pop() }),
            _ => json!({ "type": "MultiPolygon", "coordinates": polygons }),
        };
        let mut line = String::from(if self.is_first { "\n" } else { ",\n" });
        line += &format!("{{\"type\":\"Feature\",\"id\":{},\"properties\":{{", record.object);
        let mut separator = "";
        for (field, value) in self.fields.iter().zip(record.values(self.fields)) {
            if let Some(value) = value {
                line += &format!("{separator}{}:{}", json!(field.name), json!(value));
                separator = ",";
            }
        }
        line += &format!("}},\"geometry\":{geometry}}}");
        self.put(&line)?;
        self.is_first = false;
        Ok(None)
    }

    fn finish(mut self: Box<Self>) -> Result<File, ExportError> {
        self.put("\n]}\n")?;
        let path = self.path;
        self.out.into_inner().map_err(|error| ExportError::write(&path)(error.into_error()))
    }
}
