//! FlatGeobuf.

use super::{assert_shares_are_the_whole, attack, attack_share, attributes, read, rings, run, run_share, square, text};
use crate::vector::read_flatgeobuf;
use flatgeobuf::geozero::error::Result as GeozeroResult;
use flatgeobuf::geozero::{ColumnValue, GeomProcessor, GeozeroGeometry, PropertyProcessor};
use flatgeobuf::{ColumnType, FgbCrs, FgbWriter, FgbWriterOptions, GeometryType};
use insula_source::attributes::AttributeValue;
use insula_source::input::Share;
use insula_source::object::{FeatureKind, Shape};

/// A polygon for the writer of the crate.
struct Polygon(Vec<Vec<[f64; 2]>>);

impl GeozeroGeometry for Polygon {
    fn process_geom<P: GeomProcessor>(&self, processor: &mut P) -> GeozeroResult<()> {
        processor.polygon_begin(true, self.0.len(), 0)?;
        for (index, ring) in self.0.iter().enumerate() {
            processor.linestring_begin(false, ring.len(), index)?;
            for (number, [x, y]) in ring.iter().enumerate() {
                processor.xy(*x, *y, number)?;
            }
            processor.linestring_end(false, index)?;
        }
        processor.polygon_end(true, 0)
    }
}

fn file(crs: FgbCrs<'_>, has_index: bool, plans: &[Vec<Vec<[f64; 2]>>]) -> Vec<u8> {
    let options = FgbWriterOptions { write_index: has_index, crs, ..FgbWriterOptions::default() };
    let mut writer = FgbWriter::create_with_options("roofs", GeometryType::Polygon, options).unwrap();
    for (name, kind) in [("name", ColumnType::String), ("h", ColumnType::Double), ("n", ColumnType::ULong)] {
        writer.add_column(name, kind, |_, _| {});
    }
    for plan in plans {
        writer
            .add_feature_geom(Polygon(plan.clone()), |feature| {
                feature.property(0, "name", &ColumnValue::String("Ä")).unwrap();
                feature.property(1, "h", &ColumnValue::Double(2.5)).unwrap();
                feature.property(2, "n", &ColumnValue::ULong(u64::MAX)).unwrap();
            })
            .unwrap();
    }
    let mut bytes = Vec::new();
    writer.write(&mut bytes).unwrap();
    bytes
}

fn plans(count: u32) -> Vec<Vec<Vec<[f64; 2]>>> {
    (0..count).map(|n| vec![square(f64::from(n), 50.0, 0.9), square(f64::from(n) + 0.1, 50.1, 0.1)]).collect()
}

#[test]
fn features_with_and_without_an_index() {
    for has_index in [false, true] {
        let bytes = file(FgbCrs { code: 28992, ..FgbCrs::default() }, has_index, &plans(3));
        let sink = read(read_flatgeobuf, &[("a.fgb", &bytes)]);
        assert_eq!((sink.objects.len(), sink.crs[0].name.as_str()), (3, "EPSG:28992"));
        let mut found: Vec<_> = sink.objects.iter().map(|object| rings(&object.shape)[0].rings.clone()).collect();
        found.sort_by(|a, b| a[0][0][0].total_cmp(&b[0][0][0]));
        assert_eq!(found, plans(3));
        let expected = [("name", text("Ä")), ("h", AttributeValue::Float(2.5)), ("n", text("18446744073709551615"))];
        assert_eq!(sink.objects[0].attributes, attributes(&expected));
        assert_eq!((sink.objects[0].kind, sink.objects[0].source_type.as_str()), (FeatureKind::Building, "roofs"));
        assert_eq!(sink.bytes_done, bytes.len() as u64);
    }
}

#[test]
fn the_index_finds_features_in_an_area() {
    for has_index in [false, true] {
        let bytes = file(FgbCrs { code: 4326, ..FgbCrs::default() }, has_index, &plans(100));
        let (result, sink) = run(read_flatgeobuf, &[("a.fgb", &bytes)], Some([20.5, 50.0, 22.5, 51.0]));
        result.unwrap();
        assert_eq!(sink.objects.len(), 3);
    }
}

#[test]
fn systems_without_a_code_are_text() {
    let wkt = FgbCrs { wkt: Some("PROJCS[\"x\"]"), ..FgbCrs::default() };
    assert_eq!(read(read_flatgeobuf, &[("a.fgb", &file(wkt, false, &plans(1)))]).crs[0].name, "PROJCS[\"x\"]");
    let esri = FgbCrs { org: Some("ESRI"), code: 102100, wkt: Some("PROJCS[\"y\"]"), ..FgbCrs::default() };
    assert_eq!(read(read_flatgeobuf, &[("a.fgb", &file(esri, false, &plans(1)))]).crs[0].name, "PROJCS[\"y\"]");
}

#[test]
fn hostile_files() {
    let bytes = file(FgbCrs { code: 28992, ..FgbCrs::default() }, true, &plans(3));
    attack(read_flatgeobuf, &[("a.fgb", &bytes)], 1, 200);
    for end in [0, 7, 11, 60, bytes.len() - 1] {
        assert!(run(read_flatgeobuf, &[("a.fgb", &bytes[..end])], None).0.is_err(), "{end} bytes");
    }
    let mut newer = bytes.clone();
    newer[3] = 9;
    assert!(run(read_flatgeobuf, &[("a.fgb", &newer)], None).0.is_err());
    // A whole feature is missing at the end.
    let header = 12 + u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize;
    let first = header + 4 * 40;
    let size = 4 + u32::from_le_bytes(bytes[first..first + 4].try_into().unwrap()) as usize;
    let (result, sink) = run(read_flatgeobuf, &[("a.fgb", &bytes[..first + size])], None);
    assert!(result.is_err());
    assert!(matches!(sink.objects[..], [ref only] if matches!(only.shape, Shape::Footprints(_))));
}

#[test]
fn shares_are_the_whole() {
    for (has_index, count) in [(true, 5), (true, 6000), (false, 6000)] {
        let bytes = file(FgbCrs { code: 28992, ..FgbCrs::default() }, has_index, &plans(count));
        assert_shares_are_the_whole(read_flatgeobuf, ("a.fgb", &bytes), None);
        let last = run_share(read_flatgeobuf, &[("a.fgb", &bytes)], None, Share { number: 1, count: 2 }).1;
        assert_eq!(last.objects.is_empty(), !has_index || count == 5, "the last share reads a part");
    }
    let bytes = file(FgbCrs { code: 4326, ..FgbCrs::default() }, true, &plans(100));
    assert_shares_are_the_whole(read_flatgeobuf, ("a.fgb", &bytes), Some([20.5, 50.0, 22.5, 51.0]));
}

#[test]
fn hostile_shares() {
    let bytes = file(FgbCrs { code: 28992, ..FgbCrs::default() }, true, &plans(4200));
    attack_share(read_flatgeobuf, &[("a.fgb", &bytes)], 19_997, 4200, Share { number: 1, count: 2 });
    // The offset of the feature behind the first share.
    let mut elsewhere = bytes.clone();
    let header = 12 + u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize;
    let nodes = 4200 + 263 + 17 + 2 + 1;
    let offset = header + (nodes - 4200 + 4096) * 40 + 32;
    for change in [1, 0xff] {
        elsewhere[offset..offset + 8].fill(change);
        for number in [0, 1] {
            let share = Share { number, count: 2 };
            assert!(run_share(read_flatgeobuf, &[("a.fgb", &elsewhere)], None, share).0.is_err(), "{number}");
        }
    }
}
