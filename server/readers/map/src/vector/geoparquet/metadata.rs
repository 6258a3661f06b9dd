//! The geometry column, its encoding and coordinate system, and the boxes of row groups.

use crate::vector::csv::GEOMETRY_NAMES;
use crate::vector::feature::{DEGREES, are_apart};
use arrow_schema::{DataType, Schema};
use parquet::basic::LogicalType;
use parquet::file::metadata::{ParquetMetaData, RowGroupMetaData};
use parquet::file::statistics::Statistics;
use serde_json::Value;

/// Names of geometry columns of files without metadata, in lower case, the most certain first. Columns of texts have those of CSV.
const USUAL_NAMES: [&str; 5] = ["geometry", "geom", "wkb_geometry", "wkb", "the_geom"];
/// Before the key of a system's PROJJSON in the metadata of the file, as the type of geometries of Parquet has it.
const KEY_OF_SYSTEM: &str = "projjson:";
/// Columns that a message names.
const NAMED_COLUMNS: usize = 12;
/// Names of columns of boxes: `bbox.xmin` and so on, as Overture has.
const BOX_COLUMN: &str = "bbox";
/// Names of members of boxes in the order west, south, east, north.
const BOX_MEMBERS: [[&str; 4]; 2] = [["xmin", "ymin", "xmax", "ymax"], ["minx", "miny", "maxx", "maxy"]];

pub(super) struct GeoColumn {
    pub(super) name: String,
    pub(super) encoding: GeometryEncoding,
    /// Name, WKT or PROJJSON; `None` if the file says that it is not known.
    pub(super) crs: Option<String>,
    /// Paths of the columns of the features' boxes: west, south, east, north.
    pub(super) covering: Option<[String; 4]>,
}

pub(super) enum GeometryEncoding {
    Wkb,
    /// WKT or GeoJSON, as tables of databases are exported.
    Text,
    /// Nested lists of positions.
    Nested(NestedKind),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NestedKind {
    Point,
    /// Also several points.
    Line,
    MultiLine,
    Polygon,
    MultiPolygon,
    MultiPoint,
}

/// A text about the whole file.
pub(super) fn text_of<'m>(metadata: &'m ParquetMetaData, key: &str) -> Option<&'m str> {
    let pairs = metadata.file_metadata().key_value_metadata();
    pairs.into_iter().flatten().find(|pair| pair.key == key).and_then(|pair| pair.value.as_deref())
}

/// Finds the geometry column. Fails with what is not supported.
pub(super) fn find(metadata: &ParquetMetaData, schema: &Schema) -> Result<GeoColumn, String> {
    let geo: Option<Value> = text_of(metadata, "geo").and_then(|text| serde_json::from_str(text).ok());
    let found = match &geo {
        Some(geo) => of_metadata(geo, schema)?,
        None => of_types(metadata, schema).ok_or_else(|| {
            let names: Vec<&str> =
                schema.fields().iter().take(NAMED_COLUMNS).map(|field| field.name().as_str()).collect();
            let names = names.join(", ");
            format!("a parquet file without a column geometry or geom of WKB, or wkt of WKT (its columns: {names})")
        })?,
    };
    let covering = found.covering.or_else(|| box_column(schema));
    Ok(GeoColumn { covering, ..found })
}

/// The primary column of GeoParquet's metadata.
fn of_metadata(geo: &Value, schema: &Schema) -> Result<GeoColumn, String> {
    let columns = geo["columns"].as_object().ok_or("a parquet file whose metadata name no geometry column")?;
    let primary = geo["primary_column"].as_str().filter(|name| schema.field_with_name(name).is_ok());
    let first = || columns.keys().map(String::as_str).find(|name| schema.field_with_name(name).is_ok());
    let name = primary.or_else(first).ok_or("a parquet file without the geometry column that its metadata name")?;
    let column = columns.get(name).unwrap_or(&Value::Null);
    let encoding = column["encoding"].as_str().unwrap_or("WKB");
    let encoding =
        encoding_of(encoding).ok_or_else(|| format!("GeoParquet with geometries encoded as {encoding:?}"))?;
    let crs = match column.get("crs") {
        None => Some(DEGREES.to_owned()),
        Some(Value::Null) => None,
        Some(Value::String(text)) => Some(text.clone()),
        Some(json) => Some(name_of_projjson(json)),
    };
    let path = |member: &str| {
        let parts = column["covering"]["bbox"][member].as_array()?;
        let parts: Option<Vec<&str>> = parts.iter().map(Value::as_str).collect();
        parts.map(|parts| parts.join("."))
    };
    let covering = || Some([path("xmin")?, path("ymin")?, path("xmax")?, path("ymax")?]);
    Ok(GeoColumn { name: name.to_owned(), encoding, crs, covering: covering() })
}

/// `EPSG:n` if the system has a code of EPSG, else its whole text.
fn name_of_projjson(json: &Value) -> String {
    let authority = json["id"]["authority"].as_str().unwrap_or_default();
    let code = match &json["id"]["code"] {
        Value::Number(code) => code.to_string(),
        Value::String(code) => code.clone(),
        _ => String::new(),
    };
    match (authority, code.as_str()) {
        ("OGC", "CRS84") => DEGREES.to_owned(),
        ("EPSG", code) if !code.is_empty() => format!("EPSG:{code}"),
        _ => json.to_string(),
    }
}

fn encoding_of(name: &str) -> Option<GeometryEncoding> {
    let name = name.to_ascii_lowercase();
    let kind = match name.strip_prefix("geoarrow.").unwrap_or(&name) {
        "wkb" => return Some(GeometryEncoding::Wkb),
        "wkt" => return Some(GeometryEncoding::Text),
        "point" => NestedKind::Point,
        "linestring" => NestedKind::Line,
        "polygon" => NestedKind::Polygon,
        "multipoint" => NestedKind::MultiPoint,
        "multilinestring" => NestedKind::MultiLine,
        "multipolygon" => NestedKind::MultiPolygon,
        _ => return None,
    };
    Some(GeometryEncoding::Nested(kind))
}

/// The first column of parquet's own geometry type, else the one of bytes, or else of texts, with the most certain of the usual names.
fn of_types(metadata: &ParquetMetaData, schema: &Schema) -> Option<GeoColumn> {
    let named = |name: &str, encoding: GeometryEncoding, crs: Option<String>| GeoColumn {
        name: name.to_owned(),
        encoding,
        crs,
        covering: None,
    };
    for column in metadata.file_metadata().schema_descr().root_schema().get_fields() {
        let crs = match column.get_basic_info().logical_type_ref() {
            Some(LogicalType::Geometry(kind)) => kind.crs.clone(),
            Some(LogicalType::Geography(kind)) => kind.crs.clone(),
            _ => continue,
        };
        // The text may be that of a key of the file.
        let by_key = |text: &String| Some(text_of(metadata, text.strip_prefix(KEY_OF_SYSTEM)?)?.to_owned());
        let crs = crs.map(|text| by_key(&text).unwrap_or(text)).filter(|text| !text.trim().is_empty());
        let crs = crs.map(|text| serde_json::from_str(&text).map_or(text, |json: Value| name_of_projjson(&json)));
        let crs = crs.unwrap_or_else(|| DEGREES.to_owned());
        return Some(named(column.name(), GeometryEncoding::Wkb, Some(crs)));
    }
    let usual = |names: &[&str], kind: &DataType| {
        let named = |usual: &&str| {
            let mut columns = schema.fields().iter().filter(|field| field.data_type() == kind);
            columns.find(|field| field.name().eq_ignore_ascii_case(usual)).map(|field| field.name().clone())
        };
        names.iter().find_map(named)
    };
    let of_bytes = usual(&USUAL_NAMES, &DataType::Binary).map(|name| named(&name, GeometryEncoding::Wkb, None));
    let of_texts = || usual(&GEOMETRY_NAMES, &DataType::Utf8).map(|name| named(&name, GeometryEncoding::Text, None));
    of_bytes.or_else(of_texts)
}

/// A column of boxes that the metadata do not name.
fn box_column(schema: &Schema) -> Option<[String; 4]> {
    let DataType::Struct(members) = schema.field_with_name(BOX_COLUMN).ok()?.data_type() else { return None };
    let has = |name: &str| members.iter().any(|member| member.name() == name);
    let names = BOX_MEMBERS.iter().find(|names| names.iter().all(|name| has(name)))?;
    Some(names.map(|name| format!("{BOX_COLUMN}.{name}")))
}

/// Row groups that may have features in an area (west, south, east, north).
pub(super) fn groups_within(
    metadata: &ParquetMetaData,
    covering: &Option<[String; 4]>,
    wanted: [f64; 4],
) -> Vec<usize> {
    let is_near = |group: &RowGroupMetaData| {
        let Some(covering) = covering else { return true };
        let range = |path: &String| statistics_range(group, path);
        let [Some(west), Some(south), Some(east), Some(north)] = covering.each_ref().map(range) else { return true };
        // Boxes over the antimeridian have their west east of their east.
        west.0 > east.0 || !are_apart([west.0, south.0, east.1, north.1], wanted)
    };
    metadata.row_groups().iter().enumerate().filter(|(_, group)| is_near(group)).map(|(index, _)| index).collect()
}

/// Lowest and highest value of a column in a row group; `None` if it is not known.
fn statistics_range(group: &RowGroupMetaData, path: &str) -> Option<(f64, f64)> {
    let column = group.columns().iter().find(|column| column.column_path().string() == path)?;
    let (low, high) = match column.statistics()? {
        Statistics::Double(values) => (*values.min_opt()?, *values.max_opt()?),
        Statistics::Float(values) => (f64::from(*values.min_opt()?), f64::from(*values.max_opt()?)),
        _ => return None,
    };
    (low <= high).then_some((low, high))
}
