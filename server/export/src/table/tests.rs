//! Exports of a small city, read back.

use super::test_city::{BRIDGE, BUILDING, COURT, GHOST, HEDGE, HOUSE, ORIGIN, PARTS, TestCity};
use super::{AddedValues, ExportError, ExportReport, TableOptions};
use crate::file::{export, export_values};
use crate::format::{Format, PlaneDefinition, Projections};
use crate::selection::{ObjectSelection, SelectedArea};
use arrow_array::{Array, BinaryArray, BooleanArray, Date32Array, Float64Array, Int64Array, StringArray, StructArray};
use flatgeobuf::{FallibleStreamingIterator, FeatureProperties, FgbReader};
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;

struct Exported {
    report: ExportReport,
    path: PathBuf,
    _folder: tempfile::TempDir,
}

fn plane() -> PlaneDefinition {
    PlaneDefinition {
        base_epsg: 4289,
        proj: "+proj=sterea +lat_0=52".into(),
        ellipsoid: [6_377_397.155, 299.152_812_8],
        is_north_first: false,
    }
}

fn try_export(city: &TestCity, format: Format, selection: &ObjectSelection) -> Result<Exported, ExportError> {
    export_with(city, format, selection, WITH_PARTS)
}

fn export_with(
    city: &TestCity,
    format: Format,
    selection: &ObjectSelection,
    options: TableOptions,
) -> Result<Exported, ExportError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.out");
    let to_lon_lat = |[x, y]: [f64; 2]| Some([(x - ORIGIN[0]) / 1000.0, 50.0 + (y - ORIGIN[1]) / 1000.0]);
    let definition = plane();
    let projections = Projections { to_lon_lat: Some(&to_lon_lat), epsg: Some(28992), definition: Some(&definition) };
    let report = export(city, format, selection, &projections, options, &path)?;
    Ok(Exported { report, path, _folder: folder })
}

fn run(format: Format) -> Exported {
    try_export(&TestCity::new(true), format, &ObjectSelection::default()).unwrap()
}

const WITH_PARTS: TableOptions = TableOptions { keeps_formulas: false, keeps_parts: true };

type Row = BTreeMap<String, String>;

/// Rows of a CSV file by object.
fn rows(exported: &Exported) -> BTreeMap<u32, Row> {
    let mut reader = csv::Reader::from_path(&exported.path).unwrap();
    let rows: Vec<Row> = reader.deserialize().collect::<Result<_, _>>().unwrap();
    rows.into_iter().map(|row| (row["object"].parse().unwrap(), row)).collect()
}

fn csv_of(selection: &ObjectSelection) -> BTreeMap<u32, Row> {
    rows(&try_export(&TestCity::new(true), Format::Csv, selection).unwrap())
}

const ALL: [u32; 8] = [HOUSE, BUILDING, PARTS[0], PARTS[1], COURT, GHOST, BRIDGE, HEDGE];

#[test]
fn csv_has_a_row_for_each_object() {
    let exported = run(Format::Csv);
    let rows = rows(&exported);
    assert_eq!(rows.keys().copied().collect::<Vec<_>>(), ALL);
    let house = &rows[&HOUSE];
    let expected = [
        ("identifier", "b-a"),
        ("parent", ""),
        ("kind", "building"),
        ("ground_z_m", "0"),
        ("roof_z_m", "9"),
        ("height_m", "9"),
        ("area_m2", "80"),
        ("year", "1894"),
        ("eaves", "7.25"),
        ("name", "Huis \"Ä\", oud\n东京"),
        ("listed", "true"),
        ("built", "1894-07-01"),
        ("Height_M_2", ""),
        ("wkt", "POLYGON ((84004 446004,84014 446004,84014 446012,84004 446012,84004 446004))"),
    ];
    for (name, value) in expected {
        assert_eq!(house[name], value, "{name}");
    }
    let report = &exported.report;
    assert_eq!((report.objects, report.without_geometry, report.skipped.len()), (8, 1, 0));
    assert_eq!(report.attribution, "Gemeente \"Ä\", licence: CC BY 4.0, https://example.org");
    assert_eq!(report.files.len(), 2);
    let sidecar = std::fs::read_to_string(&report.files[1]).unwrap();
    assert_eq!(sidecar, format!("{}\n", report.attribution));
    let sizes: u64 = report.files.iter().map(|file| std::fs::metadata(file).unwrap().len()).sum();
    assert_eq!(report.bytes, sizes);
}

#[test]
fn no_cell_of_a_csv_file_is_a_formula_unless_formulas_are_kept() {
    let cells = |keeps_formulas| {
        let options = TableOptions { keeps_formulas, keeps_parts: true };
        let exported = export_with(&TestCity::new(true), Format::Csv, &ObjectSelection::default(), options).unwrap();
        let rows = rows(&exported);
        [(BRIDGE, "name"), (BRIDGE, "eaves"), (HEDGE, "name")].map(|(object, column)| rows[&object][column].clone())
    };
    assert_eq!(cells(false), ["'=HYPERLINK(\"http://a\")", "-3.5", "-3.5"]);
    assert_eq!(cells(true), ["=HYPERLINK(\"http://a\")", "-3.5", "-3.5"]);
}

#[test]
fn a_building_and_its_parts_are_one_row_unless_parts_are_kept() {
    let of = |selection: &ObjectSelection| {
        rows(&export_with(&TestCity::new(true), Format::Csv, selection, TableOptions::default()).unwrap())
    };
    let all = of(&ObjectSelection::default());
    assert_eq!(all.keys().copied().collect::<Vec<_>>(), [HOUSE, BUILDING, COURT, GHOST, BRIDGE, HEDGE]);
    // The year is its own, the height of the eaves that of a part.
    let building = &all[&BUILDING];
    let expected = [
        ("identifier", "b-b"),
        ("parent", ""),
        ("year", "2001"),
        ("eaves", "12"),
        ("roof_z_m", "12"),
        ("area_m2", "128"),
    ];
    for (name, value) in expected {
        assert_eq!(building[name], value, "{name}");
    }
    // A part stands for its building, whose footprint is whole.
    let [x, y, _] = ORIGIN;
    let bbox = Some([[x + 36.0, y], [x + 46.0, y + 20.0]]);
    let by_place = of(&ObjectSelection { bbox, ..ObjectSelection::default() });
    let objects = Some([PARTS[1]].into_iter().collect());
    let by_number = of(&ObjectSelection { objects, ..ObjectSelection::default() });
    for rows in [by_place, by_number] {
        assert_eq!(rows.keys().copied().collect::<Vec<_>>(), [BUILDING]);
        assert_eq!((rows[&BUILDING]["area_m2"].as_str(), rows[&BUILDING]["eaves"].as_str()), ("128", "12"));
    }
    // With parts, these have what their building has.
    let with_parts = csv_of(&ObjectSelection::default());
    let years = PARTS.map(|part| (with_parts[&part]["year"].as_str(), with_parts[&part]["eaves"].as_str()));
    assert_eq!((years, with_parts[&BUILDING]["eaves"].as_str()), ([("2001", ""), ("2001", "12")], ""));
}

#[test]
fn columns_have_the_telling_attributes_first() {
    let exported = run(Format::Csv);
    let mut reader = csv::Reader::from_path(&exported.path).unwrap();
    let names: Vec<String> = reader.headers().unwrap().iter().skip(8).map(str::to_owned).collect();
    assert_eq!(names, ["name", "year", "eaves", "listed", "built", "Height_M_2", "wkt"]);
}

#[test]
fn footprints_are_whole_across_leaves_and_include_parts() {
    let rows = rows(&run(Format::Csv));
    let areas: Vec<&str> = ALL.iter().map(|object| rows[object]["area_m2"].as_str()).collect();
    assert_eq!(areas, ["80", "128", "64", "64", "720", "", "120", "16"]);
    assert_eq!((rows[&PARTS[0]]["parent"].as_str(), rows[&BUILDING]["roof_z_m"].as_str()), ("b-b", "12"));
    assert_eq!(rows[&BUILDING]["wkt"], "POLYGON ((84028 446004,84044 446004,84044 446012,84028 446012,84028 446004))");
    // Outer ring and hole, across four leaves, of four points each.
    let court = &rows[&COURT]["wkt"];
    assert_eq!((court.matches(',').count(), court.matches("),(").count()), (9, 1), "{court}");
    assert!(court.starts_with("POLYGON"));
    assert_eq!(rows[&GHOST]["wkt"], "");
    assert_eq!(rows[&BRIDGE]["Height_M_2"], "1");
}

#[test]
fn columns_stand_in_for_meshes() {
    let with_meshes = csv_of(&ObjectSelection::default());
    let exported = try_export(&TestCity::new(false), Format::Csv, &ObjectSelection::default()).unwrap();
    for (object, row) in rows(&exported) {
        for name in ["area_m2", "height_m", "ground_z_m"] {
            assert_eq!(row[name], with_meshes[&object][name], "{name} of {object}");
        }
    }
}

#[test]
fn selections_have_objects_by_their_middle() {
    let [x, y, _] = ORIGIN;
    let bbox = Some([[x, y], [x + 33.0, y + 70.0]]);
    let of = |selection: &ObjectSelection| csv_of(selection).into_keys().collect::<Vec<_>>();
    // The building is where its parts are, of which one is in the box. Its footprint is whole.
    let rows = csv_of(&ObjectSelection { bbox, ..ObjectSelection::default() });
    assert_eq!(rows.keys().copied().collect::<Vec<_>>(), [HOUSE, BUILDING, PARTS[0]]);
    assert_eq!(rows[&BUILDING]["area_m2"], "128");
    let ring = vec![[x + 45.0, y], [x + 128.0, y], [x + 128.0, y + 80.0], [x + 45.0, y + 80.0]];
    let polygons = Some(SelectedArea::new(vec![vec![ring]]));
    assert_eq!(of(&ObjectSelection { polygons, ..ObjectSelection::default() }), [COURT, HEDGE]);
    let objects = Some([PARTS[1], HEDGE, 77].into_iter().collect());
    assert_eq!(of(&ObjectSelection { objects, ..ObjectSelection::default() }), [PARTS[1], HEDGE]);
    let nowhere = Some([[x - 50.0, y], [x - 40.0, y + 1.0]]);
    assert!(of(&ObjectSelection { bbox: nowhere, ..ObjectSelection::default() }).is_empty());
}

#[test]
fn invalid_selections_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let selections = [
        ObjectSelection { bbox: Some([[1.0, 0.0], [0.0, 1.0]]), ..ObjectSelection::default() },
        ObjectSelection {
            polygons: Some(SelectedArea::new(vec![vec![vec![[0.0, 0.0], [1.0, 1.0]]]])),
            ..ObjectSelection::default()
        },
        ObjectSelection { polygons: Some(SelectedArea::new(Vec::new())), ..ObjectSelection::default() },
    ];
    for selection in selections {
        let out = folder.path().join("x");
        let result = export(&TestCity::new(true), Format::Csv, &selection, &Projections::default(), WITH_PARTS, &out);
        assert!(matches!(result, Err(ExportError::ObjectSelection(_))));
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn geojson_has_longitude_and_latitude() {
    let exported = run(Format::GeoJson);
    let json: serde_json::Value = serde_json::from_reader(File::open(&exported.path).unwrap()).unwrap();
    assert_eq!(json["attribution"], exported.report.attribution.as_str());
    let features = json["features"].as_array().unwrap();
    let of = |object: u32| features.iter().find(|feature| feature["id"] == object).unwrap();
    assert_eq!(features.len(), 8);
    let house = of(HOUSE);
    let coordinates =
        serde_json::json!([[[0.004, 50.004], [0.014, 50.004], [0.014, 50.012], [0.004, 50.012], [0.004, 50.004]]]);
    assert_eq!(house["geometry"], serde_json::json!({ "type": "Polygon", "coordinates": coordinates }));
    assert_eq!(house["properties"]["year"], 1894);
    assert_eq!(house["properties"]["listed"], true);
    assert_eq!(house["properties"]["built"], "1894-07-01");
    assert!(house["properties"].get("Height_M_2").is_none());
    assert!(of(GHOST)["geometry"].is_null());
    assert!(exported.report.warnings.is_empty());

    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("plain.json");
    let write = |projections| {
        export(&TestCity::new(true), Format::GeoJson, &ObjectSelection::default(), &projections, WITH_PARTS, &out)
            .unwrap()
    };
    assert_eq!(write(Projections::default()).warnings.len(), 1);
    let nowhere = |_| None;
    let report = write(Projections { to_lon_lat: Some(&nowhere), ..Projections::default() });
    assert_eq!((report.objects, report.skipped.into_values().collect::<Vec<_>>()), (1, vec![7]));
    serde_json::from_reader::<_, serde_json::Value>(File::open(&out).unwrap()).unwrap();
}

#[test]
fn geoparquet_has_types_boxes_and_a_coordinate_system() {
    let exported = run(Format::GeoParquet);
    let builder = ParquetRecordBatchReaderBuilder::try_new(File::open(&exported.path).unwrap()).unwrap();
    let pairs = builder.metadata().file_metadata().key_value_metadata().unwrap().clone();
    let pair = |key: &str| pairs.iter().find(|pair| pair.key == key).unwrap().value.clone().unwrap();
    let geo: serde_json::Value = serde_json::from_str(&pair("geo")).unwrap();
    assert_eq!((&geo["version"], &geo["columns"]["geometry"]["crs"]["id"]["code"]), (&"1.1.0".into(), &28992.into()));
    assert_eq!(pair("attribution"), exported.report.attribution);
    assert_eq!(builder.schema().field_with_name("eaves").unwrap().metadata()["unit"], "m");
    let batches: Vec<_> = builder.build().unwrap().map(Result::unwrap).collect();
    let [batch] = &batches[..] else { panic!("{} batches", batches.len()) };
    assert_eq!(batch.num_rows(), 8);
    fn column<'a, T: 'static>(batch: &'a arrow_array::RecordBatch, name: &str) -> &'a T {
        batch.column_by_name(name).unwrap().as_any().downcast_ref().unwrap()
    }
    let objects: &Int64Array = column(batch, "object");
    let row = |object: u32| objects.iter().position(|other| other == Some(i64::from(object))).unwrap();
    let house = row(HOUSE);
    assert_eq!(column::<StringArray>(batch, "identifier").value(house), "b-a");
    assert_eq!(column::<Int64Array>(batch, "year").value(house), 1894);
    assert_eq!(column::<Float64Array>(batch, "area_m2").value(house), 80.0);
    assert_eq!(column::<Date32Array>(batch, "built").value(house), -27_577);
    let listed: &BooleanArray = column(batch, "listed");
    assert!(listed.value(house) && !listed.value(row(COURT)) && listed.is_null(row(HEDGE)));
    let geometry: &BinaryArray = column(batch, "geometry");
    assert_eq!((geometry.value(house).len(), geometry.is_null(row(GHOST))), (13 + 5 * 16, true));
    let boxes: &StructArray = column(batch, "bbox");
    let member =
        |name: &str| boxes.column_by_name(name).unwrap().as_any().downcast_ref::<Float64Array>().unwrap().value(house);
    assert_eq!(["xmin", "ymin", "xmax", "ymax"].map(member), [84_004.0, 446_004.0, 84_014.0, 446_012.0]);
}

#[test]
fn flatgeobuf_has_an_index_and_types() {
    let exported = run(Format::FlatGeobuf);
    assert_eq!((exported.report.objects, exported.report.skipped.values().sum::<u64>()), (7, 1));
    let open = || FgbReader::open(BufReader::new(File::open(&exported.path).unwrap())).unwrap();
    let reader = open();
    let header = reader.header();
    assert_eq!((header.features_count(), header.crs().unwrap().code()), (7, 28992));
    assert!(header.metadata().unwrap().contains("CC BY 4.0"));
    let mut features = open().select_bbox(84_000.0, 446_000.0, 84_020.0, 446_020.0).unwrap();
    let feature = features.next().unwrap().unwrap();
    let text = |name: &str| feature.property::<String>(name).unwrap();
    assert_eq!((text("identifier").as_str(), text("built").as_str()), ("b-a", "1894-07-01"));
    assert_eq!(feature.property::<i64>("year").unwrap(), 1894);
    assert_eq!(feature.property::<f64>("area_m2").unwrap(), 80.0);
    assert!(feature.property::<bool>("listed").unwrap());
    assert!(features.next().unwrap().is_none());
}

#[test]
fn values_of_an_analysis_are_columns_beside_the_attributes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sun.fgb");
    let values = HashMap::from([(HOUSE, vec![Some(2.5), None])]);
    let added = AddedValues { names: vec!["sun_hours".to_owned(), "share".to_owned()], values };
    let city = TestCity::new(true);
    let report = export_values(&city, Format::FlatGeobuf, &added, &Projections::default(), &path).unwrap();
    assert_eq!(report.objects, 1);
    let reader = FgbReader::open(BufReader::new(File::open(&path).unwrap())).unwrap();
    let mut features = reader.select_all().unwrap();
    let feature = features.next().unwrap().unwrap();
    assert_eq!(feature.property::<String>("identifier").unwrap(), "b-a");
    assert_eq!(feature.property::<f64>("sun_hours").unwrap(), 2.5);
    assert!(feature.property::<f64>("share").is_err() && feature.property::<i64>("year").unwrap() == 1894);
}

#[test]
fn houses_at_any_angle_keep_their_corners_across_leaves() {
    let exported = try_export(&TestCity::of_rotated_houses(), Format::Csv, &ObjectSelection::default()).unwrap();
    let rows = rows(&exported);
    assert_eq!(rows.len(), 36);
    for row in rows.values() {
        let area: f64 = row["area_m2"].parse().unwrap();
        assert_eq!((row["wkt"].matches(',').count(), row["height_m"].as_str()), (4, "7"), "{}", row["wkt"]);
        assert!((area - 96.0).abs() < 0.05, "{area}");
    }
}
