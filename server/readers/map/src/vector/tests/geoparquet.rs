//! GeoParquet.

use super::{
    assert_shares_are_the_whole, attack, attack_share, attributes, polygon_wkb, read, rings, run, run_share, square,
    text,
};
use crate::vector::read_geoparquet;
use arrow_array::builder::{BinaryBuilder, ListBuilder, MapBuilder, StringBuilder, StructBuilder};
use arrow_array::{
    ArrayRef, BinaryArray, BooleanArray, Date32Array, Float32Array, Float64Array, Int32Array, RecordBatch, StringArray,
    StructArray, Time32MillisecondArray, TimestampMillisecondArray,
};
use arrow_schema::{DataType, Field};
use insula_source::attributes::AttributeValue;
use insula_source::input::Share;
use insula_source::object::{Description, FeatureKind, Shape, SourceObject};
use insula_source::problems::NO_COLUMN;
use parquet::arrow::ArrowWriter;
use parquet::basic::Compression;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use std::sync::Arc;

const WKB: &str = r#"{"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": {"encoding": "WKB"}}}"#;

/// A file of columns, with metadata, in row groups of two.
fn file(columns: Vec<(&str, ArrayRef)>, geo: Option<&str>, compression: Compression) -> Vec<u8> {
    file_in_groups(columns, geo, compression, 2)
}

/// As [`file`], in row groups of `rows`.
fn file_in_groups(columns: Vec<(&str, ArrayRef)>, geo: Option<&str>, compression: Compression, rows: usize) -> Vec<u8> {
    let batch = RecordBatch::try_from_iter(columns).unwrap();
    let pairs = geo.map(|geo| vec![KeyValue::new("geo".to_owned(), geo.to_owned())]);
    let properties = WriterProperties::builder()
        .set_compression(compression)
        .set_max_row_group_row_count(Some(rows))
        .set_key_value_metadata(pairs)
        .build();
    let mut bytes = Vec::new();
    let mut writer = ArrowWriter::try_new(&mut bytes, batch.schema(), Some(properties)).unwrap();
    writer.write(&batch).unwrap();
    writer.close().unwrap();
    bytes
}

fn plan(n: u32) -> Vec<Vec<[f64; 2]>> {
    vec![square(f64::from(n), 50.0, 0.5)]
}

fn geometries(count: u32) -> ArrayRef {
    Arc::new((0..count).map(|n| Some(polygon_wkb(&plan(n), None))).collect::<BinaryArray>())
}

fn boxes(count: u32) -> ArrayRef {
    let values = |start: f64, step: f64| -> ArrayRef {
        Arc::new((0..count).map(|n| (start + step * f64::from(n)) as f32).collect::<Float32Array>())
    };
    let field = |name: &str| Arc::new(Field::new(name, DataType::Float32, false));
    Arc::new(StructArray::from(vec![
        (field("xmin"), values(0.0, 1.0)),
        (field("xmax"), values(0.5, 1.0)),
        (field("ymin"), values(50.0, 0.0)),
        (field("ymax"), values(50.5, 0.0)),
    ]))
}

/// Two rows as Overture has them: `names` with a text and a map, and a list of `sources`.
fn overture_columns() -> Vec<(&'static str, ArrayRef)> {
    let text_field = |name: &str| Field::new(name, DataType::Utf8, true);
    let mut map = MapBuilder::new(None, StringBuilder::new(), StringBuilder::new());
    map.keys().append_value("ja");
    map.values().append_value("東京");
    map.append(true).unwrap();
    map.append(false).unwrap();
    let common: ArrayRef = Arc::new(map.finish());
    let primary: ArrayRef = Arc::new(StringArray::from(vec![Some("Tokyo"), None]));
    let common_field = Arc::new(Field::new("common", common.data_type().clone(), true));
    let names = StructArray::from(vec![(Arc::new(text_field("primary")), primary), (common_field, common)]);
    let source = StructBuilder::from_fields(vec![text_field("dataset")], 2);
    let mut sources = ListBuilder::new(source);
    for _ in 0..2 {
        let builder = sources.values().field_builder::<StringBuilder>(0).unwrap();
        builder.append_value("OpenStreetMap");
        sources.values().append(true);
        sources.append(true);
    }
    vec![
        ("id", Arc::new(StringArray::from(vec!["p1", "p2"]))),
        ("geometry", geometries(2)),
        ("bbox", boxes(2)),
        ("names", Arc::new(names)),
        ("sources", Arc::new(sources.finish())),
        ("building_id", Arc::new(StringArray::from(vec![Some("b1"), None]))),
        ("height", Arc::new(Float64Array::from(vec![Some(12.5), None]))),
        ("level", Arc::new(Int32Array::from(vec![3, 4]))),
        ("is_underground", Arc::new(BooleanArray::from(vec![false, false]))),
        ("day", Arc::new(Date32Array::from(vec![0, 1]))),
        ("time", Arc::new(TimestampMillisecondArray::from(vec![86_400_000, -1]))),
        ("raw", Arc::new(BinaryArray::from(vec![&b"\x01\x00"[..], b"\xffy"]))),
    ]
}

#[test]
fn parts_of_overture() {
    let sink = read(read_geoparquet, &[("part-0.parquet", &file(overture_columns(), Some(WKB), Compression::SNAPPY))]);
    let object = &sink.objects[0];
    assert_eq!(
        (object.id.as_str(), object.parent.as_deref(), object.kind),
        ("p1", Some("b1"), FeatureKind::BuildingPart)
    );
    assert_eq!(rings(&object.shape)[0].rings, plan(0));
    let date = |day: u8| AttributeValue::Date { year: 1970, month: 1, day };
    let expected = [
        ("id", text("p1")),
        ("names.primary", text("Tokyo")),
        ("names.common.ja", text("東京")),
        ("sources.0.dataset", text("OpenStreetMap")),
        ("building_id", text("b1")),
        ("height", AttributeValue::Float(12.5)),
        ("level", AttributeValue::Integer(3)),
        ("is_underground", AttributeValue::Bool(false)),
        ("day", date(1)),
        ("time", date(2)),
    ];
    assert_eq!(object.attributes, attributes(&expected));
    assert_eq!((sink.objects[1].kind, sink.objects[1].parent.clone()), (FeatureKind::Building, None));
    assert_eq!(sink.crs[0].name, "OGC:CRS84");
    assert_eq!(sink.described, [(Description::Attribution, "OpenStreetMap".to_owned())]);
}

#[test]
fn texts_that_are_not_declared_are_read_and_columns_that_are_lost_named() {
    let columns: Vec<(&str, ArrayRef)> = vec![
        ("geometry", geometries(2)),
        ("street", Arc::new(BinaryArray::from(vec!["Straße 1".as_bytes(), b""]))),
        ("opens", Arc::new(Time32MillisecondArray::from(vec![1, 2]))),
    ];
    let sink = read(read_geoparquet, &[("a.parquet", &file(columns, Some(WKB), Compression::SNAPPY))]);
    assert_eq!(sink.objects[0].attributes, attributes(&[("street", text("Straße 1"))]));
    assert_eq!(sink.objects[1].attributes, attributes(&[]));
    assert_eq!(sink.problems, [(NO_COLUMN, "opens".to_owned())]);
}

#[test]
fn row_groups_and_rows_outside_of_the_area_are_not_read() {
    let mut columns = vec![("geometry", geometries(20)), ("bbox", boxes(20))];
    let with_boxes = file(columns.clone(), Some(WKB), Compression::UNCOMPRESSED);
    columns.pop();
    let without = file(columns, Some(WKB), Compression::UNCOMPRESSED);
    for bytes in [&with_boxes, &without] {
        let (result, sink) = run(read_geoparquet, &[("a.parquet", bytes)], Some([5.2, 50.0, 6.2, 51.0]));
        result.unwrap();
        let found: Vec<_> = sink.objects.iter().map(|object| rings(&object.shape)[0].rings.clone()).collect();
        assert_eq!(found, [plan(5), plan(6)]);
    }
    // The geometries of the first rows are damaged: they are not looked at.
    let damaged: ArrayRef = Arc::new(
        (0..4_u32).map(|n| Some(if n < 2 { vec![9] } else { polygon_wkb(&plan(n), None) })).collect::<BinaryArray>(),
    );
    let bytes = file(vec![("geometry", damaged), ("bbox", boxes(4))], Some(WKB), Compression::UNCOMPRESSED);
    let (result, sink) = run(read_geoparquet, &[("a.parquet", &bytes)], Some([2.0, 50.0, 6.0, 51.0]));
    result.unwrap();
    assert_eq!((sink.objects.len(), sink.skipped.len()), (2, 0));
    assert_eq!(
        read(read_geoparquet, &[("a.parquet", &bytes)]).skipped[0],
        ("malformed geometry", "feature 1".to_owned())
    );
}

#[test]
fn systems_and_compressions() {
    let geo = |crs: &str| WKB.replace("\"WKB\"", &format!("\"WKB\", \"crs\": {crs}"));
    let crs = |geo: Option<&str>| {
        let sink =
            read(read_geoparquet, &[("a.parquet", &file(vec![("geometry", geometries(1))], geo, Compression::SNAPPY))]);
        sink.crs.first().map(|crs| crs.name.clone())
    };
    let coded = geo(r#"{"type": "ProjectedCRS", "id": {"authority": "EPSG", "code": 6677}}"#);
    assert_eq!(crs(Some(&coded)).as_deref(), Some("EPSG:6677"));
    let own = geo(r#"{"type": "ProjectedCRS", "name": "own"}"#);
    assert!(crs(Some(&own)).is_some_and(|name| name.starts_with('{') && name.contains("own")));
    assert_eq!(crs(Some(WKB)).as_deref(), Some("OGC:CRS84"));
    assert_eq!(crs(Some(&geo("null"))), None);
    assert_eq!(crs(None), None, "not named");
    let packed = [
        Compression::ZSTD(Default::default()),
        Compression::GZIP(Default::default()),
        Compression::BROTLI(Default::default()),
        Compression::LZ4_RAW,
    ];
    for compression in packed {
        let bytes = file(vec![("geometry", geometries(5))], Some(WKB), compression);
        assert_eq!(read(read_geoparquet, &[("a.parquet", &bytes)]).objects.len(), 5, "{compression}");
    }
}

#[test]
fn geometries_may_tell_their_own_system() {
    // As PostGIS has it: a flag in the type, and the number behind it.
    let mut wkb = polygon_wkb(&plan(500), None);
    wkb[4] |= 0x20;
    wkb.splice(5..5, 28992_u32.to_le_bytes()).for_each(drop);
    let binary: ArrayRef = Arc::new(BinaryArray::from(vec![&wkb[..]]));
    let text: ArrayRef = Arc::new(StringArray::from(vec!["SRID=28992;POLYGON((500 600,510 600,510 620,500 600))"]));
    let null = WKB.replace("\"WKB\"", "\"WKB\", \"crs\": null");
    for (name, column, geo) in [
        ("geom", &binary, None),
        ("geometry", &binary, Some(&*null)),
        ("wkt", &text, None),
        ("geometry", &binary, Some(WKB)),
    ] {
        let bytes = file(vec![(name, Arc::clone(column))], geo, Compression::SNAPPY);
        let sink = read(read_geoparquet, &[("a.parquet", &bytes)]);
        let expected = if geo == Some(WKB) { "OGC:CRS84" } else { "EPSG:28992" };
        assert_eq!((sink.crs[0].name.as_str(), sink.objects.len()), (expected, 1), "{name} {geo:?}");
    }
}

#[test]
fn columns_of_texts_are_geometries() {
    for (name, value) in [
        ("WKT", "POLYGON((500 600, 510 600, 510 620, 500 600))"),
        ("geometry", r#"{"type":"Polygon","coordinates":[[[500,600],[510,600],[510,620],[500,600]]]}"#),
    ] {
        let columns = |name| vec![(name, Arc::new(StringArray::from(vec![Some(value), None])) as ArrayRef)];
        let sink = read(read_geoparquet, &[("a.parquet", &file(columns(name), None, Compression::SNAPPY))]);
        assert_eq!((sink.objects.len(), sink.skipped.len()), (1, 1), "{name}");
        assert_eq!(rings(&sink.objects[0].shape)[0].rings[0][1], [510.0, 600.0]);
        assert!(sink.objects[0].attributes.get(name).is_none());
        let other = file(columns("note"), None, Compression::SNAPPY);
        let refused = run(read_geoparquet, &[("a.parquet", &other)], None).0.unwrap_err();
        assert!(refused.to_string().contains("its columns: note"), "{refused}");
    }
    let texts = |value: &str| Arc::new(StringArray::from(vec![value])) as ArrayRef;
    let columns = vec![("shape", texts("gabled")), ("wkt", texts("POLYGON((500 600, 510 600, 510 620, 500 600))"))];
    let sink = read(read_geoparquet, &[("a.parquet", &file(columns, None, Compression::SNAPPY))]);
    assert_eq!(sink.objects.len(), 1, "the most certain name counts, not the first column");
}

#[test]
fn nested_lists_are_polygons() {
    let axis = |name: &str| Field::new(name, DataType::Float64, false);
    let position = StructBuilder::from_fields(vec![axis("x"), axis("y")], 8);
    let mut polygons = ListBuilder::new(ListBuilder::new(position));
    for ring in plan(7).iter().chain(&plan(8)) {
        let positions = polygons.values().values();
        for corner in ring {
            for (index, value) in corner.iter().enumerate() {
                positions.field_builder::<arrow_array::builder::Float64Builder>(index).unwrap().append_value(*value);
            }
            positions.append(true);
        }
        polygons.values().append(true);
    }
    polygons.append(true);
    let geo = WKB.replace("\"WKB\"", "\"polygon\"");
    let bytes = file(vec![("geometry", Arc::new(polygons.finish()) as ArrayRef)], Some(&geo), Compression::SNAPPY);
    let sink = read(read_geoparquet, &[("a.parquet", &bytes)]);
    // The second ring is no hole of the first one.
    let found: Vec<_> = rings(&sink.objects[0].shape).iter().map(|polygon| polygon.rings.clone()).collect();
    assert_eq!(found, [plan(7), plan(8)]);
    let wrong = WKB.replace("\"WKB\"", "\"multipolygon\"");
    let bytes = file(vec![("geometry", geometries(1))], Some(&wrong), Compression::SNAPPY);
    assert_eq!(read(read_geoparquet, &[("a.parquet", &bytes)]).skipped[0].0, "geometry of unknown type");
}

#[test]
fn files_that_are_not_read() {
    let plain = file(vec![("n", Arc::new(Int32Array::from(vec![1])))], None, Compression::SNAPPY);
    assert!(run(read_geoparquet, &[("a.parquet", &plain)], None).0.is_err());
    let missing = file(vec![("n", Arc::new(Int32Array::from(vec![1])))], Some(WKB), Compression::SNAPPY);
    assert!(run(read_geoparquet, &[("a.parquet", &missing)], None).0.is_err());
    let mut empty = BinaryBuilder::new();
    empty.append_null();
    let nulls = file(vec![("geometry", Arc::new(empty.finish()) as ArrayRef)], Some("{"), Compression::SNAPPY);
    assert_eq!(read(read_geoparquet, &[("a.parquet", &nulls)]).skipped, [("no geometry", "feature 1".to_owned())]);
}

#[test]
fn equal_rows_that_take_no_bytes_are_few() {
    let rows = (1 << 20) + 1;
    let nothing: ArrayRef = Arc::new(BinaryArray::from(vec![None::<&[u8]>; rows]));
    let bytes = file_in_groups(vec![("geometry", nothing)], Some(WKB), Compression::SNAPPY, rows);
    assert!(bytes.len() < 100_000, "{}", bytes.len());
    let error = run(read_geoparquet, &[("a.parquet", &bytes)], None).0.unwrap_err().to_string();
    assert!(error.contains("1048577 in") && error.contains("exceeds the limit of 1048576"), "{error}");
}

#[test]
fn hostile_files() {
    for compression in [Compression::UNCOMPRESSED, Compression::SNAPPY] {
        let bytes = file(overture_columns(), Some(WKB), compression);
        attack(read_geoparquet, &[("a.parquet", &bytes)], 23, 4);
    }
}

/// Plans, every 50th with heights, a wall in the row of this number, and a row without a geometry.
fn bodies(count: u32, wall: Option<u32>) -> ArrayRef {
    let upright = |n: u32| {
        let x = f64::from(n);
        let corners = [[x, 0.0, 0.0], [x, 5.0, 0.0], [x, 5.0, 5.0], [x, 0.0, 5.0], [x, 0.0, 0.0]];
        let head =
            [vec![1], 1003_u32.to_le_bytes().to_vec(), 1_u32.to_le_bytes().to_vec(), 5_u32.to_le_bytes().to_vec()];
        head.concat().into_iter().chain(corners.concat().into_iter().flat_map(f64::to_le_bytes)).collect()
    };
    let body = |n: u32| match n {
        _ if Some(n) == wall => upright(n),
        _ => polygon_wkb(&plan(n), n.is_multiple_of(50).then_some(5.0)),
    };
    Arc::new((0..count).map(|n| (n != 7).then(|| body(n))).collect::<BinaryArray>())
}

#[test]
fn shares_are_the_whole() {
    // A wall among the first 4096 rows makes faces of all level polygons; one behind them does not.
    let cases = [
        (9, 2, None),
        (6000, 500, None),
        (6000, 500, Some(101)),
        (7000, 1024, Some(4095)),
        (7000, 1024, Some(4096)),
        (6000, 5000, Some(5501)),
    ];
    for (count, rows, wall) in cases {
        let columns = vec![("geometry", bodies(count, wall)), ("bbox", boxes(count))];
        let bytes = file_in_groups(columns, Some(WKB), Compression::SNAPPY, rows);
        assert_shares_are_the_whole(read_geoparquet, ("a.parquet", &bytes), None);
        assert_shares_are_the_whole(read_geoparquet, ("a.parquet", &bytes), Some([5.2, 50.0, 6.2, 51.0]));
        let last = run_share(read_geoparquet, &[("a.parquet", &bytes)], None, Share { number: 1, count: 2 }).1;
        assert_eq!(last.objects.is_empty(), count == 9, "the last share reads a part");
        let is_face = |object: &SourceObject| matches!(object.shape, Shape::Surfaces { .. });
        let is_early = wall.is_some_and(|wall| wall < 4096);
        // The wall itself is a face in any case.
        let faces = last.objects.iter().filter(|object| is_face(object)).count();
        assert_eq!(faces > 1, is_early, "{rows} rows, {wall:?}");
    }
}

#[test]
fn hostile_shares() {
    let columns = vec![("geometry", geometries(4200))];
    let bytes = file_in_groups(columns, Some(WKB), Compression::SNAPPY, 1500);
    attack_share(read_geoparquet, &[("a.parquet", &bytes)], 9_973, 4200, Share { number: 1, count: 2 });
}
