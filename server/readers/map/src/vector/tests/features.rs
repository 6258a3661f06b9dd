//! What becomes of features, whatever their format. The CSV reader is the shortest way to make them.

use super::{read, rings, run};
use crate::vector::{read_csv, read_geojson};
use insula_source::attributes::AttributeValue;
use insula_source::object::{FeatureKind, Shape};
use insula_source::problems::{KIND_AGAINST_NAME, KIND_BY_NAME, NO_SEA, OUTLINES_AND_PARTS, TREES_BY_COLUMN};
use insula_source::testing::TestSink;

fn features(name: &str, header: &str, lines: &[&str]) -> TestSink {
    read(read_csv, &[(name, format!("{header}\n{}\n", lines.join("\n")).as_bytes())])
}

fn kinds(sink: &TestSink) -> Vec<FeatureKind> {
    sink.objects.iter().map(|object| object.kind).collect()
}

const LEVEL: &str = "POLYGON Z((0 0 5,1 0 5,1 1 5,0 1 5,0 0 5))";
const WALL: &str = "POLYGON Z((0 0 0,1 0 0,1 0 3,0 0 3,0 0 0))";
const SLOPE: &str = "POLYGON Z((0 0 0,1 0 0,1 1 2,0 1 2,0 0 0))";

#[test]
fn level_polygons_are_plans_and_others_surfaces() {
    let line = |wkt: &str, height: &str| format!("\"{wkt}\";{height}");
    let lines = [line(LEVEL, ""), line(SLOPE, ""), line(SLOPE, ""), line(SLOPE, "9")];
    let sink = features("town.csv", "wkt;height", &lines.each_ref().map(String::as_str));
    // The level polygon waits for walls until the end.
    let sink = TestSink { objects: [&sink.objects[3..], &sink.objects[..3]].concat(), ..sink };
    assert_eq!(rings(&sink.objects[0].shape)[0].rings[0].len(), 5);
    assert_eq!(rings(&sink.objects[0].shape)[0].ground, Some(5.0));
    for object in &sink.objects[1..3] {
        let Shape::Surfaces { polygons, meshes } = &object.shape else { panic!("{object:?}") };
        assert_eq!((polygons.len(), meshes.len(), polygons[0].points.len()), (1, 0, 4), "without the repeated point");
    }
    assert!(matches!(sink.objects[3].shape, Shape::Footprints(_)), "a plan on uneven ground");
    assert!(kinds(&sink).iter().all(|kind| *kind == FeatureKind::Building));
}

#[test]
fn outlines_beside_their_parts_are_named_once() {
    let line = |building: &str, part: &str| format!("\"POLYGON((0 0,9 0,9 9,0 9,0 0))\";{building};{part};9");
    let named = |lines: &[String]| {
        let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
        let sink = features("town.csv", "wkt;building;building:part;height", &lines);
        assert_eq!(sink.objects.len(), lines.len());
        sink.problems.iter().filter(|(kind, _)| *kind == OUTLINES_AND_PARTS).count()
    };
    assert_eq!(named(&[line("yes", ""), line("", "yes"), line("yes", ""), line("", "yes")]), 1);
    assert_eq!([named(&[line("yes", ""), line("house", "")]), named(&[line("", "yes"), line("", "roof")])], [0, 0]);
}

#[test]
fn geometries_of_json_may_tell_their_own_system() {
    // As PostGIS has it.
    let crs = |name: &str| format!(r#""crs": {{"type": "name", "properties": {{"name": "{name}"}}}}"#);
    let ring = r#""coordinates": [[[500, 600], [510, 600], [510, 620], [500, 600]]]"#;
    let of_geometry = |name: &str| format!(r#"{{"type": "Polygon", {}, {ring}}}"#, crs(name));
    let plain = format!(r#"{{"type": "Polygon", {ring}}}"#);
    let geometry = of_geometry("EPSG:28992");
    let features = [
        format!(r#"{{"type": "Feature", "properties": {{}}, "geometry": {geometry}}}"#),
        format!(
            r#"{{"type": "Feature", {}, "properties": {{}}, "geometry": {plain}}}"#,
            crs("urn:ogc:def:crs:EPSG::25832")
        ),
    ];
    let collection = format!(r#"{{"type": "FeatureCollection", "features": [{}]}}"#, features.join(","));
    let sink = read(read_geojson, &[("a.geojson", collection.as_bytes())]);
    let names: Vec<&str> = sink.crs.iter().map(|crs| crs.name.as_str()).collect();
    assert_eq!((names, sink.objects.len()), (vec!["EPSG:28992", "urn:ogc:def:crs:EPSG::25832"], 2));
    let faulty = format!(r#"{{"type": "Feature", "crs": {{}}, "properties": {{}}, "geometry": {plain}}}"#);
    let faulty = format!(r#"{{"type": "FeatureCollection", "features": [{faulty}]}}"#);
    let sink = read(read_geojson, &[("a.geojson", faulty.as_bytes())]);
    assert_eq!(sink.skipped[0].0, "coordinate system without a name");
    let cell = of_geometry("urn:ogc:def:crs:EPSG::28992").replace('"', "\"\"");
    let sink = read(read_csv, &[("a.csv", format!("geom,n\n\"{cell}\",1\n").as_bytes())]);
    assert_eq!((sink.crs[0].name.as_str(), sink.objects.len()), ("EPSG:28992", 1));
}

#[test]
fn a_column_of_zeros_identifies_nothing() {
    let lines = [format!("\"{LEVEL}\";0;7"), format!("\"{LEVEL}\";0;8"), format!("\"{LEVEL}\";5;9")];
    let sink = features("town.csv", "wkt;Id;OBJECTID", &lines.each_ref().map(String::as_str));
    assert_eq!(sink.objects.iter().map(|object| object.id.as_str()).collect::<Vec<_>>(), ["7", "8", "5"]);
}

#[test]
fn sloping_parts_of_a_plan_are_plans() {
    let part = |x: u32| format!("(({x} 0 0,{0} 0 0,{0} 9 2,{x} 9 2,{x} 0 0))", x + 9);
    let lines = [[0, 20], [0, 9]].map(|[a, b]| format!("\"MULTIPOLYGON Z({},{})\";9", part(a), part(b)));
    let sink = features("town.csv", "wkt;height", &lines.each_ref().map(String::as_str));
    assert_eq!(rings(&sink.objects[0].shape).len(), 2);
    assert!(matches!(sink.objects[1].shape, Shape::Surfaces { .. }), "faces of a roof touch");
    assert!(
        sink.problems.iter().any(|(kind, id)| kind.contains("taken as surfaces") && id == "line 3"),
        "{:?}",
        sink.problems
    );
}

#[test]
fn level_polygons_among_walls_are_faces() {
    let lines = [LEVEL, WALL, LEVEL].map(|wkt| format!("\"{wkt}\";1"));
    let sink = features("town.csv", "wkt;n", &lines.each_ref().map(String::as_str));
    let is_surface = |shape: &Shape| matches!(shape, Shape::Surfaces { .. });
    assert_eq!(sink.objects.iter().filter(|object| is_surface(&object.shape)).count(), 3);
    let flat = "POLYGON((0 0,1 0,1 1,0 1,0 0))";
    let lines = [flat, WALL, flat].map(|wkt| format!("\"{wkt}\";1"));
    let sink = features("town.csv", "wkt;n", &lines.each_ref().map(String::as_str));
    assert_eq!(sink.objects.iter().filter(|object| is_surface(&object.shape)).count(), 1, "those have no heights");
    let many = vec![format!("\"{LEVEL}\";1"); 300];
    let sink = features("town.csv", "wkt;n", &many.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(sink.objects.len() == 300 && sink.objects.iter().all(|object| !is_surface(&object.shape)));
}

#[test]
fn points_with_columns_of_trees_are_trees() {
    for (header, line, is_guess) in [
        ("tree_id,species,height,lon,lat", "1,Tilia,5,11,48", false),
        ("Nr;Baumhoehe;Rechtswert;Hochwert", "1;5;691000;5335000", false),
        ("genus,lon,lat", "Tilia,11,48", true),
        ("Art,Hoehe,lon,lat", "Linde,5,11,48", true),
    ] {
        let sink = features("points.csv", header, &[line]);
        assert_eq!(kinds(&sink), [FeatureKind::Vegetation], "{header}");
        assert_eq!(sink.problems.iter().any(|(kind, _)| *kind == TREES_BY_COLUMN), is_guess, "{header}");
    }
    assert_eq!(kinds(&features("points.csv", "id,lon,lat", &["1,11,48"])), [FeatureKind::Generic]);
}

#[test]
fn polygons_within_others_of_a_feature_are_holes_or_named() {
    let outer = "((0 0,30 0,30 30,0 30,0 0))";
    let inner = |ring: &str| format!("m;\"MULTIPOLYGON({outer},(({ring})))\"");
    let sink = features("town.csv", "id;wkt", &[&inner("10 10,10 20,20 20,20 10,10 10")]);
    let Shape::Footprints(plans) = &sink.objects[0].shape else { panic!() };
    assert_eq!((plans.len(), plans[0].rings.len()), (1, 2));
    assert!(sink.problems[0].0.contains("taken as a hole"), "{:?}", sink.problems);
    let sink = features("town.csv", "id;wkt", &[&inner("10 10,20 10,20 20,10 20,10 10")]);
    let Shape::Footprints(plans) = &sink.objects[0].shape else { panic!() };
    assert_eq!(plans.len(), 2);
    assert!(sink.problems[0].0.contains("taken as a part"), "{:?}", sink.problems);
}

#[test]
fn holes_of_surfaces_are_numbered() {
    let wall =
        "POLYGON Z((0 0 0,9 0 0,9 0 9,0 0 9,0 0 0),(1 0 1,1 0 2,2 0 2,1 0 1),(5 0 5,5 0 5),(3 0 3,3 0 4,4 0 4,3 0 3))";
    let sink = features("town.csv", "id|wkt", &[&format!("w|{wall}")]);
    let Shape::Surfaces { polygons, .. } = &sink.objects[0].shape else { panic!() };
    assert_eq!((polygons[0].points.len(), polygons[0].hole_starts.as_slice()), (10, &[4, 7][..]));
    assert_eq!(sink.problems[0], ("ring has fewer than three points", "w".to_owned()));
    let broken = features("town.csv", "id|wkt", &["b|TIN Z(((0 0 0,1 1 1)))"]);
    assert_eq!(broken.skipped, [("no ring with three points", "b".to_owned())]);
}

#[test]
fn lines_have_a_width_or_are_left_out() {
    let header = "id;wkt;highway;width;lanes";
    let lines = [
        "a;LINESTRING(0 0,99 0);residential;;",
        "b;LINESTRING(0 0,99 0);residential;3.5 m;",
        "c;LINESTRING(0 0,99 0);primary;;4",
        "d;LINESTRING(0 0,99 0);;;",
        "e;LINESTRING(0 0,99 0);;7;",
        "f;LINESTRING(0 0,99 0);footway;-1;",
    ];
    let sink = features("lines.csv", header, &lines);
    let width = |shape: &Shape| match shape {
        Shape::Strips(strips) => strips[0].width_m,
        other => panic!("{other:?}"),
    };
    let widths: Vec<f64> = sink.objects.iter().map(|object| width(&object.shape)).collect();
    assert_eq!(widths, [5.5, 3.5, 12.0, 7.0, 2.0]);
    assert_eq!(sink.skipped, [("line without a width that is no road, railway or water", "d".to_owned())]);
    assert_eq!(kinds(&sink)[3], FeatureKind::Generic);
    let rivers = features("rivers.csv", "wkt;n", &["LINESTRING(0 0,99 0);1"]);
    assert_eq!((kinds(&rivers), width(&rivers.objects[0].shape)), (vec![FeatureKind::Water], 4.0));
}

#[test]
fn kinds_by_tags_and_by_the_layer() {
    let header = "osm_id;wkt;building;landuse;other_tags";
    let lines = [
        "1;POLYGON((0 0,9 0,9 9,0 0));yes;;\"\"\"height\"\"=>\"\"12.5\"\",\"\"name:ja\"\"=>\"\"\\\\\"\"A\"\"\"",
        "2;POLYGON((0 0,9 0,9 9,0 0));;forest;",
        "3;POLYGON((0 0,9 0,9 9,0 0));;;",
        "4;POINT(5 5);;;\"{\"\"natural\"\": \"\"tree\"\"}\"",
    ];
    let sink = features("multipolygons.csv", header, &lines);
    let (building, green) = (FeatureKind::Building, FeatureKind::Vegetation);
    assert_eq!(kinds(&sink), [building, green, green], "only some areas of a mixed table are buildings");
    assert_eq!(sink.skipped, [("no object of a city by its tags", "3".to_owned())]);
    assert_eq!(sink.objects[0].attributes.get("height").and_then(|value| value.as_f64()), Some(12.5));
    assert!(matches!(sink.objects[2].shape, Shape::Points(_)));
    assert_eq!(sink.objects[0].source_type, "multipolygons");
}

#[test]
fn kinds_by_the_name_of_the_layer_are_named_once() {
    let area = "POLYGON((85000 446000,85010 446000,85000 446010,85000 446000))";
    let lines = [format!("{area};20"), format!("{area};"), format!("{area};")];
    let sink = features("park_avenue.csv", "wkt;height", &lines.each_ref().map(String::as_str));
    let green = FeatureKind::Vegetation;
    assert_eq!(kinds(&sink), [FeatureKind::Building, green, green]);
    let named: Vec<&str> = sink.problems.iter().map(|(kind, _)| *kind).collect();
    assert_eq!(named, [KIND_AGAINST_NAME, KIND_BY_NAME]);
    assert!(sink.problems[1].1.starts_with("park_avenue: taken as vegetation"), "{:?}", sink.problems);
}

#[test]
fn tags_within_an_attribute_are_tags() {
    let area = "POLYGON((0 0,9 0,9 9,0 0))";
    for tags in ["\"\"building\"\"=>\"\"yes\"\"", "{\"\"building\"\": \"\"yes\"\"}"] {
        let sink = features("export.csv", "osm_id;tags;wkt", &[&format!("7;\"{tags}\";{area}")]);
        assert_eq!(kinds(&sink), [FeatureKind::Building], "{tags}");
    }
    let members = r#"{"type": "Feature", "id": "way/7", "properties": {"tags": {"building": "roof", "height": "5"}},
        "geometry": {"type": "Polygon", "coordinates": [[[0,0],[9,0],[9,9],[0,0]]]}}"#;
    let sink = read(read_geojson, &[("export.geojson", members.as_bytes())]);
    assert_eq!(kinds(&sink), [FeatureKind::Building]);
    assert_eq!(sink.objects[0].attributes.get("height"), Some(&AttributeValue::Integer(5)));
}

#[test]
fn identifiers_in_order_of_trust() {
    let sink =
        features("t.csv", "name;OBJECTID;gml_id;wkt", &["x;7;BLD_1;POINT(9 9)", "y;8;;POINT(9 9)", "z;;;POINT(9 9)"]);
    let ids: Vec<&str> = sink.objects.iter().map(|object| object.id.as_str()).collect();
    assert_eq!(ids, ["BLD_1", "8", "line 4"]);
}

#[test]
fn degrees_are_recognised_and_metres_are_not() {
    let degrees = features("t.csv", "wkt;n", &["POLYGON((139.7 35.6,139.701 35.6,139.7 35.601,139.7 35.6));1"]);
    assert_eq!((degrees.crs.len(), degrees.crs[0].name.as_str()), (1, "OGC:CRS84"));
    assert_eq!(degrees.problems[0].0, "coordinate system not given");
    for metres in
        ["POLYGON((10 10,20 10,20 20,10 10))", "POLYGON((85000 446000,85010 446000,85000 446010,85000 446000))"]
    {
        let sink = features("t.csv", "wkt;n", &[&format!("{metres};1")]);
        assert_eq!((sink.crs.len(), sink.problems.len()), (0, 0), "{metres}");
    }
}

#[test]
fn features_outside_of_the_wanted_area_are_left_out() {
    let lines = "wkt,n\nSRID=4326;POINT(4 52),1\nSRID=4326;POINT(5 52),2\nSRID=28992;POINT(85000 446000),3\n";
    let (result, sink) = run(read_csv, &[("t.csv", lines.as_bytes())], Some([4.5, 51.0, 6.0, 53.0]));
    result.unwrap();
    assert_eq!((sink.objects.len(), sink.skipped.len()), (2, 0), "those in metres are left to the sink");
    let names: Vec<&str> = sink.crs.iter().map(|crs| crs.name.as_str()).collect();
    assert_eq!(names, ["EPSG:4326", "EPSG:28992"]);
}

#[test]
fn what_cannot_be_seen_is_left_out() {
    let area = "POLYGON((0 0,9 0,9 9,0 0))";
    let lines = [
        format!("a;{area};yes;;;"),
        format!("b;{area};yes;true;;"),
        format!("c;{area};yes;;-1;"),
        "d;LINESTRING(0 0,99 0);;;;T".to_owned(),
        "e;POLYGON Z((0 0 0,1 0 0,1 0 3,0 0 3,0 0 0));yes;true;;".to_owned(),
    ];
    let sink =
        features("town.csv", "id;wkt;building;is_underground;LEVEL;tunnel", &lines.each_ref().map(String::as_str));
    let ids: Vec<&str> = sink.objects.iter().map(|object| object.id.as_str()).collect();
    assert_eq!(ids, ["a", "e"], "surfaces in space have their own heights");
    let reasons: Vec<(&str, &str)> = sink.skipped.iter().map(|(reason, id)| (*reason, id.as_str())).collect();
    let no_width = "line without a width that is no road, railway or water";
    assert_eq!(reasons, [("underground", "b"), ("underground", "c"), (no_width, "d")]);
    let roads = features("roads.csv", "id;wkt;tunnel", &["a;LINESTRING(0 0,99 0);T", "b;LINESTRING(0 0,99 0);F"]);
    assert_eq!((roads.objects.len(), &roads.skipped[..]), (1, &[("in a tunnel", "a".to_owned())][..]));
    let tunnels = features("tunnels.csv", "id;wkt", &["a;LINESTRING(0 0,99 0)"]);
    assert_eq!(tunnels.skipped, [("in a tunnel", "a".to_owned())]);
}

#[test]
fn coastlines_of_which_no_sea_is_made_are_named() {
    let lines = ["a;LINESTRING(0 0,99 0);coastline", "b;POLYGON((0 0,9 0,9 9,0 0));coastline"];
    let sink = features("town.csv", "id;wkt;natural", &lines);
    let named = |id: &str| (NO_SEA, id.to_owned());
    assert_eq!((sink.objects.len(), sink.skipped), (0, vec![named("a"), named("b")]));
}

#[test]
fn longitudes_of_a_whole_turn_are_within_a_wanted_area() {
    let line = "wkt,n\nSRID=4326;POINT(181.5 -18),1\nSRID=4326;POINT(178.5 -18),2\n";
    let (result, sink) = run(read_csv, &[("t.csv", line.as_bytes())], Some([-179.0, -19.0, -178.0, -17.0]));
    result.unwrap();
    assert_eq!(sink.objects.len(), 1);
}

#[test]
fn plans_keep_the_height_of_the_ground() {
    let lines = [
        "\"POLYGON Z((0 0 512.3,1 0 512.3,1 1 512.3,0 0 512.3))\";9",
        "\"POLYGON Z((0 0 513,1 0 512,1 1 515,0 0 513))\";9",
        "\"POLYGON Z((0 0 0,1 0 0,1 1 0,0 0 0))\";9",
        "\"POLYGON((0 0,1 0,1 1,0 0))\";9",
    ];
    let sink = features("town.csv", "wkt;height", &lines);
    let mut ground: Vec<Option<f64>> = sink.objects.iter().map(|object| rings(&object.shape)[0].ground).collect();
    ground.sort_by(|a, b| a.partial_cmp(b).unwrap());
    assert_eq!(ground, [None, None, Some(512.0), Some(512.3)]);
}
