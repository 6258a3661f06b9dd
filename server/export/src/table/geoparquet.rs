//! GeoParquet 1.1: typed columns, WKB, and a box of each row (`bbox`), by which readers skip row groups.
//!
//! Coordinates are world metres. `attribution` is in the metadata of the file.

use super::record::{Field, Record};
use super::{ExportError, RecordWriter, TableSetup, projjson, wkb};
use arrow_array::builder::{ArrayBuilder, BinaryBuilder, Float64Builder, StructBuilder};
use arrow_array::{ArrayRef, BooleanArray, Date32Array, Float64Array, Int64Array, RecordBatch, StringArray};
use arrow_schema::{DataType, Field as ArrowField, Fields, Schema, SchemaRef};
use insula_objects::{Value, ValueType};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, ZstdLevel};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use serde_json::json;
use std::borrow::Cow;
use std::collections::HashMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use std::sync::Arc;

const FORMAT: &str = "GeoParquet";
/// Rows that are passed on together.
const BATCH_ROWS: usize = 1024;
/// A row group ends at this many rows, or bytes of memory.
const GROUP_ROWS: usize = 1 << 16;
const GROUP_BYTES: usize = 64 << 20;
/// Members of `bbox`.
const BOX: [&str; 4] = ["xmin", "ymin", "xmax", "ymax"];

pub(super) struct Writer<'a> {
    rows: ArrowWriter<BufWriter<File>>,
    schema: SchemaRef,
    fields: &'a [Field],
    /// Of each column, the values of the rows that are collected.
    columns: Vec<Vec<Option<Value>>>,
    geometry: BinaryBuilder,
    boxes: StructBuilder,
    path: PathBuf,
}

impl<'a> Writer<'a> {
    pub(super) fn new(setup: &TableSetup<'a>, file: File) -> Result<Self, ExportError> {
        let schema = Arc::new(schema(setup.fields));
        let mut pairs = vec![KeyValue::new("geo".to_owned(), geo_metadata(setup).to_string())];
        if !setup.attribution.is_empty() {
            pairs.push(KeyValue::new("attribution".to_owned(), setup.attribution.to_owned()));
        }
        let properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .set_max_row_group_row_count(Some(GROUP_ROWS))
            .set_created_by("Insula".to_owned())
            .set_key_value_metadata(Some(pairs))
            .build();
        let rows = ArrowWriter::try_new(BufWriter::new(file), Arc::clone(&schema), Some(properties))
            .map_err(ExportError::encode(setup.path, FORMAT))?;
        Ok(Self {
            rows,
            schema,
            fields: setup.fields,
            columns: vec![Vec::new(); setup.fields.len()],
            geometry: BinaryBuilder::new(),
            boxes: StructBuilder::from_fields(box_fields(), 0),
            path: setup.path.to_owned(),
        })
    }

    fn add_box(&mut self, bounds: Option<[f64; 4]>) {
        for k in 0..BOX.len() {
            if let Some(member) = self.boxes.field_builder::<Float64Builder>(k) {
                member.append_option(bounds.map(|bounds| bounds[k]));
            }
        }
        self.boxes.append(bounds.is_some());
    }

    /// Passes the collected rows on.
    fn flush(&mut self) -> Result<(), ExportError> {
        let columns = self.fields.iter().zip(&self.columns);
        let mut arrays: Vec<ArrayRef> = columns.map(|(field, values)| array(field.value_type, values)).collect();
        self.columns.iter_mut().for_each(Vec::clear);
        arrays.push(Arc::new(self.geometry.finish()));
        arrays.push(Arc::new(self.boxes.finish()));
        let error = ExportError::encode(&self.path, FORMAT);
        let batch =
            RecordBatch::try_new(Arc::clone(&self.schema), arrays).map_err(ExportError::encode(&self.path, FORMAT))?;
        self.rows.write(&batch).map_err(&error)?;
        if self.rows.memory_size() > GROUP_BYTES {
            self.rows.flush().map_err(error)?;
        }
        Ok(())
    }
}

impl RecordWriter for Writer<'_> {
    fn write(&mut self, record: &Record) -> Result<Option<&'static str>, ExportError> {
        for (column, value) in self.columns.iter_mut().zip(record.values(self.fields)) {
            column.push(value.map(Cow::into_owned));
        }
        let polygons = record.polygons();
        self.geometry.append_option(wkb::well_known_binary(polygons));
        self.add_box(wkb::bounds(polygons));
        if self.geometry.len() >= BATCH_ROWS {
            self.flush()?;
        }
        Ok(None)
    }

    fn finish(mut self: Box<Self>) -> Result<File, ExportError> {
        self.flush()?;
        let path = self.path;
        let buffered = self.rows.into_inner().map_err(ExportError::encode(&path, FORMAT))?;
        buffered.into_inner().map_err(|error| ExportError::write(&path)(error.into_error()))
    }
}

/// A column of one type. Values of another one are null.
fn array(value_type: ValueType, values: &[Option<Value>]) -> ArrayRef {
    let values = values.iter().map(Option::as_ref);
    match value_type {
        ValueType::Text => {
            let texts = values.map(|value| if let Value::Text(text) = value? { Some(text) } else { None });
            Arc::new(texts.collect::<StringArray>())
        }
        ValueType::Integer => {
            let integers = values.map(|value| if let Value::Integer(integer) = value? { Some(*integer) } else { None });
            Arc::new(integers.collect::<Int64Array>())
        }
        ValueType::Float => {
            let floats = values.map(|value| if let Value::Float(float) = value? { Some(*float) } else { None });
            Arc::new(floats.collect::<Float64Array>())
        }
        ValueType::Bool => {
            let bools = values.map(|value| if let Value::Bool(is_true) = value? { Some(*is_true) } else { None });
            Arc::new(bools.collect::<BooleanArray>())
        }
        ValueType::Date => {
            let dates = values.map(|value| if let Value::Date(day) = value? { Some(*day) } else { None });
            Arc::new(dates.collect::<Date32Array>())
        }
    }
}

fn box_fields() -> Fields {
    BOX.iter().map(|name| ArrowField::new(*name, DataType::Float64, true)).collect()
}

fn schema(fields: &[Field]) -> Schema {
    let mut columns: Vec<ArrowField> = fields
        .iter()
        .map(|field| {
            let data_type = match field.value_type {
                ValueType::Text => DataType::Utf8,
                ValueType::Integer => DataType::Int64,
                ValueType::Float => DataType::Float64,
                ValueType::Bool => DataType::Boolean,
                ValueType::Date => DataType::Date32,
            };
            let unit = field.unit.iter().map(|unit| ("unit".to_owned(), unit.clone()));
            ArrowField::new(&field.name, data_type, true).with_metadata(unit.collect::<HashMap<_, _>>())
        })
        .collect();
    columns.push(ArrowField::new("geometry", DataType::Binary, true));
    columns.push(ArrowField::new("bbox", DataType::Struct(box_fields()), true));
    Schema::new(columns)
}

/// The member `geo` of the file's metadata.
fn geo_metadata(setup: &TableSetup<'_>) -> serde_json::Value {
    let projections = setup.projections;
    let crs = projections.epsg.zip(projections.definition);
    let crs = crs.and_then(|(epsg, definition)| projjson::projected(epsg, definition));
    let path = |member: &str| json!(["bbox", member]);
    json!({
        "version": "1.1.0",
        "primary_column": "geometry",
        "columns": {
            "geometry": {
                "encoding": "WKB",
                "geometry_types": ["Polygon", "MultiPolygon"],
                "orientation": "counterclockwise",
                // Null says that the system is not known; without the member it would be longitude and latitude.
                "crs": crs,
                "covering": { "bbox": { "xmin": path("xmin"), "ymin": path("ymin"), "xmax": path("xmax"), "ymax": path("ymax") } },
            }
        }
    })
}
