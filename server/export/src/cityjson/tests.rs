//! Sequences of a small city, read back.

use crate::file::export;
use crate::format::{Format, Projections};
use crate::selection::ObjectSelection;
use crate::table::test_city::{BUILDING, COURT, HOUSE, ORIGIN, PARTS, TestCity};
use crate::table::{ExportReport, TableOptions};
use serde_json::{Value, json};
use std::collections::BTreeSet;

fn lines(has_meshes: bool, selection: &ObjectSelection) -> (Vec<Value>, ExportReport) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.city.jsonl");
    let city = TestCity::new(has_meshes);
    let report =
        export(&city, Format::CityJsonSeq, selection, &Projections::default(), TableOptions::default(), &path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    (text.lines().map(|line| serde_json::from_str(line).unwrap()).collect(), report)
}

fn feature<'a>(lines: &'a [Value], id: &str) -> &'a Value {
    lines.iter().find(|line| line["id"] == id).unwrap()
}

/// Area of all surfaces in square metres, without holes.
fn area_m2(feature: &Value, object: &str) -> f64 {
    let vertex = |index: &Value| -> [f64; 3] {
        let vertex = &feature["vertices"][index.as_u64().unwrap() as usize];
        [0, 1, 2].map(|k| vertex[k].as_f64().unwrap() / 1000.0)
    };
    let ring_area = |ring: &Value| {
        let points: Vec<[f64; 3]> = ring.as_array().unwrap().iter().map(vertex).collect();
        let mut sum = [0.0; 3];
        for (a, b) in points.iter().zip(points.iter().cycle().skip(1)) {
            (0..3).for_each(|k| sum[k] += 0.5 * (a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3]));
        }
        sum.iter().map(|v| v * v).sum::<f64>().sqrt()
    };
    let surface_area = |rings: &Value| {
        let areas: Vec<f64> = rings.as_array().unwrap().iter().map(ring_area).collect();
        2.0 * areas[0] - areas.iter().sum::<f64>()
    };
    let geometry = &feature["CityObjects"][object]["geometry"][0];
    geometry["boundaries"].as_array().unwrap().iter().map(surface_area).sum()
}

#[test]
fn the_first_line_has_the_metadata() {
    let (lines, report) = lines(true, &ObjectSelection::default());
    let head = &lines[0];
    assert_eq!((&head["type"], &head["version"]), (&json!("CityJSON"), &json!("2.0")));
    assert_eq!(head["metadata"]["referenceSystem"], "https://www.opengis.net/def/crs/EPSG/0/7415");
    assert!(head["metadata"]["title"].as_str().unwrap().contains(&report.attribution));
    assert_eq!(head["transform"], json!({ "scale": [0.001, 0.001, 0.001], "translate": ORIGIN }));
    assert_eq!((report.objects, report.without_geometry, report.skipped.len()), (8, 2, 0));
    assert!(lines[1..].iter().all(|line| line["type"] == "CityJSONFeature"));
}

#[test]
fn a_building_and_its_parts_are_one_feature() {
    let (lines, _) = lines(true, &ObjectSelection::default());
    let building = feature(&lines, "b-b");
    let objects = &building["CityObjects"];
    assert_eq!(
        objects["b-b"],
        json!({ "type": "Building", "attributes": { "year": 2001 }, "children": ["b-b-1", "b-b-2"] })
    );
    assert_eq!((&objects["b-b-1"]["type"], &objects["b-b-1"]["parents"]), (&json!("BuildingPart"), &json!(["b-b"])));
    // Roof and four walls, of which the leaves' border cuts three.
    assert!((area_m2(building, "b-b-1") - (64.0 + 4.0 * 8.0 * 6.0)).abs() < 0.05);
    assert_eq!(objects["b-b-1"]["geometry"][0]["boundaries"].as_array().unwrap().len(), 5);
    let house = feature(&lines, "b-a");
    assert_eq!(house["CityObjects"]["b-a"]["attributes"]["built"], "1894-07-01");
    assert_eq!((house["vertices"].as_array().unwrap().len(), house["vertices"][0][2].as_i64().unwrap() % 1000), (8, 0));
    // Without an identifier it has its number.
    let court = feature(&lines, &format!("object-{COURT}"));
    let expected = 720.0 + (4.0 * 28.0 + 2.0 * (10.0 + 8.0 + 10.0 + 8.0)) * 15.0;
    assert!(area_m2(court, &format!("object-{COURT}")) > 0.99 * expected);
    let used: BTreeSet<u64> = court["CityObjects"][format!("object-{COURT}")]["geometry"][0]["boundaries"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|rings| rings.as_array().unwrap())
        .flat_map(|ring| ring.as_array().unwrap())
        .map(|vertex| vertex.as_u64().unwrap())
        .collect();
    assert_eq!(used.len(), court["vertices"].as_array().unwrap().len());
}

#[test]
fn a_selected_part_comes_with_its_parent_and_a_parent_with_its_parts() {
    let of = |objects: &[u32]| {
        let selection =
            ObjectSelection { objects: Some(objects.iter().copied().collect()), ..ObjectSelection::default() };
        let (lines, report) = lines(true, &selection);
        let keys: Vec<String> =
            lines[1..].iter().flat_map(|line| line["CityObjects"].as_object().unwrap().keys().cloned()).collect();
        (keys, report.objects)
    };
    assert_eq!(of(&[PARTS[0]]), (vec!["b-b".to_owned(), "b-b-1".to_owned()], 2));
    assert_eq!(of(&[BUILDING]).0, ["b-b", "b-b-1", "b-b-2"]);
    assert_eq!(of(&[HOUSE]).0, ["b-a"]);
}

#[test]
fn a_city_without_meshes_has_objects_without_geometry() {
    let (lines, report) = lines(false, &ObjectSelection::default());
    assert_eq!((report.objects, report.without_geometry, report.warnings.len()), (8, 8, 1));
    assert!(lines[1..].iter().all(|line| line["vertices"] == json!([])));
    // The parts come with their parent once.
    assert_eq!(feature(&lines, "b-b")["CityObjects"].as_object().unwrap().len(), 3);
}

#[test]
fn houses_across_leaves_have_the_surfaces_of_their_source() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.city.jsonl");
    let city = TestCity::of_rotated_houses();
    export(
        &city,
        Format::CityJsonSeq,
        &ObjectSelection::default(),
        &Projections::default(),
        TableOptions::default(),
        &path,
    )
    .unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let features: Vec<Value> = text.lines().skip(1).map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(features.len(), 36);
    // Floor, two long walls, two gable walls, and two slopes 5 m long.
    let expected = 96.0 + 2.0 * 48.0 + 2.0 * (32.0 + 12.0) + 2.0 * 60.0;
    for feature in &features {
        let id = feature["id"].as_str().unwrap();
        let surfaces = feature["CityObjects"][id]["geometry"][0]["boundaries"].as_array().unwrap().len();
        assert!(surfaces == 7, "{id}: {surfaces}");
        assert!((area_m2(feature, id) - expected).abs() < 0.3, "{id}: {}", area_m2(feature, id));
    }
}

#[test]
fn level_areas_of_plain_nodes_are_not_lost() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.city.jsonl");
    let (all, projections, options) = (ObjectSelection::default(), Projections::default(), TableOptions::default());
    let report = export(&TestCity::of_a_pond(), Format::CityJsonSeq, &all, &projections, options, &path).unwrap();
    assert_eq!((report.objects, report.without_geometry, report.warnings.len()), (1, 0, 0));
    let text = std::fs::read_to_string(&path).unwrap();
    let feature: Value = serde_json::from_str(text.lines().nth(1).unwrap()).unwrap();
    let found = area_m2(&feature, "pond");
    assert!((found - 64.0 * 68.0).abs() < 0.5, "{found} m2");
}
