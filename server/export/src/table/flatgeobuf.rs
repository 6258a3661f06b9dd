//! FlatGeobuf: typed columns, multipolygons in world metres, and an index by place.
//!
//! The writer of the crate keeps features in a temporary file, and about 150 bytes of each in memory for the index. Objects without a
//! footprint are left out, because the index cannot have them. The header's `metadata` is a JSON object with `attribution`.

use super::record::{Field, Record};
use super::{ExportError, RecordWriter, TableSetup};
use flatgeobuf::geozero::error::Result as GeozeroResult;
use flatgeobuf::geozero::{ColumnValue, GeomProcessor, GeozeroGeometry, PropertyProcessor};
use flatgeobuf::{ColumnType, FgbCrs, FgbWriter, FgbWriterOptions, GeometryType};
use insula_objects::{Value, ValueType};
use serde_json::json;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

const FORMAT: &str = "FlatGeobuf";

pub(super) struct Writer<'a> {
    features: FgbWriter<'static>,
    file: File,
    fields: &'a [Field],
    path: PathBuf,
}

impl<'a> Writer<'a> {
    pub(super) fn new(setup: &TableSetup<'a>, file: File) -> Result<Self, ExportError> {
        let metadata = (!setup.attribution.is_empty()).then(|| json!({ "attribution": setup.attribution }).to_string());
        let code = setup.projections.epsg.and_then(|epsg| i32::try_from(epsg).ok()).unwrap_or(0);
        let options = FgbWriterOptions {
            crs: FgbCrs { code, ..FgbCrs::default() },
            title: Some(setup.title),
            metadata: metadata.as_deref(),
            detect_type: false,
            ..FgbWriterOptions::default()
        };
        let error = ExportError::encode(setup.path, FORMAT);
        let mut features =
            FgbWriter::create_with_options("objects", GeometryType::MultiPolygon, options).map_err(error)?;
        for field in setup.fields {
            let column_type = match field.value_type {
                ValueType::Text => ColumnType::String,
                ValueType::Integer => ColumnType::Long,
                ValueType::Float => ColumnType::Double,
                ValueType::Bool => ColumnType::Bool,
                ValueType::Date => ColumnType::DateTime,
            };
            features.add_column(&field.name, column_type, |builder, column| {
                column.description = field.unit.as_ref().map(|unit| builder.create_string(unit));
            });
        }
        Ok(Self { features, file, fields: setup.fields, path: setup.path.to_owned() })
    }
}

impl RecordWriter for Writer<'_> {
    fn write(&mut self, record: &Record) -> Result<Option<&'static str>, ExportError> {
        let polygons = record.polygons();
        if polygons.is_empty() {
            return Ok(Some("it covers no area on the map, and FlatGeobuf finds objects by their area"));
        }
        let values = record.values(self.fields);
        let mut failure = None;
        let mut add_values = |feature: &mut dyn PropertyProcessor| {
            for (index, (field, value)) in self.fields.iter().zip(&values).enumerate() {
                let Some(value) = value.as_deref() else { continue };
                failure = failure.take().or(add_value(feature, index, &field.name, value).err());
            }
        };
        let added = self.features.add_feature_geom(MultiPolygon(polygons), |feature| add_values(feature));
        match added.err().or(failure) {
            Some(error) => Err(ExportError::encode(&self.path, FORMAT)(error)),
            None => Ok(None),
        }
    }

    fn finish(self: Box<Self>) -> Result<File, ExportError> {
        let mut out = BufWriter::new(self.file);
        self.features.write(&mut out).map_err(ExportError::encode(&self.path, FORMAT))?;
        out.flush().map_err(ExportError::write(&self.path))?;
        out.into_inner().map_err(|error| ExportError::write(&self.path)(error.into_error()))
    }
}

/// Dates are `YYYY-MM-DD`, which ISO 8601 allows without a time.
fn add_value(feature: &mut dyn PropertyProcessor, index: usize, name: &str, value: &Value) -> GeozeroResult<bool> {
    match value {
        Value::Text(text) => feature.property(index, name, &ColumnValue::String(text)),
        Value::Integer(value) => feature.property(index, name, &ColumnValue::Long(*value)),
        Value::Float(value) => feature.property(index, name, &ColumnValue::Double(*value)),
        Value::Bool(value) => feature.property(index, name, &ColumnValue::Bool(*value)),
        date @ Value::Date(_) => feature.property(index, name, &ColumnValue::DateTime(&date.to_string())),
    }
}

/// Polygons for the writer of the crate.
struct MultiPolygon<'a>(&'a [Vec<Vec<[f64; 2]>>]);

impl GeozeroGeometry for MultiPolygon<'_> {
    fn process_geom<P: GeomProcessor>(&self, processor: &mut P) -> GeozeroResult<()> {
        processor.multipolygon_begin(self.0.len(), 0)?;
        for (number, rings) in self.0.iter().enumerate() {
            processor.polygon_begin(false, rings.len(), number)?;
            for (index, ring) in rings.iter().enumerate() {
                processor.linestring_begin(false, ring.len(), index)?;
                for (i, [x, y]) in ring.iter().enumerate() {
                    processor.xy(*x, *y, i)?;
                }
                processor.linestring_end(false, index)?;
            }
            processor.polygon_end(false, number)?;
        }
        processor.multipolygon_end(0)
    }
}
