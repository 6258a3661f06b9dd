//! Whole GeoJSON files: what is read, repaired and skipped.

mod geometries;

use super::{ids, range, volume_m3};
use crate::read::{DuplicateOption, InputError, Palette, ReadOptions, ReadReport, SourceFormat, read_embedded};
use crate::scene::Scene;
use insula_source::problems::EITHER_ORDER;
use std::collections::BTreeMap;

fn try_read(files: &[(&str, &[u8])]) -> Result<(Scene, ReadReport), InputError> {
    // Also objects that stand in the same place.
    let options = ReadOptions { duplicates: DuplicateOption::KeepAll, ..ReadOptions::default() };
    read_embedded(files, &options, &|_| {})
}

fn read(text: &str) -> (Scene, ReadReport) {
    try_read(&[("a.geojson", text.as_bytes())]).unwrap()
}

/// A document in a projected system, so that coordinates are metres.
fn collection(features: &str) -> String {
    let crs = r#"{"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::6677"}}"#;
    format!(r#"{{"type": "FeatureCollection", "crs": {crs}, "features": [{features}]}}"#)
}

fn feature(id: &str, properties: &str, geometry: &str) -> String {
    format!(r#"{{"type": "Feature", "id": "{id}", "properties": {properties}, "geometry": {geometry}}}"#)
}

fn polygon(rings: &str) -> String {
    format!(r#"{{"type": "Polygon", "coordinates": [{rings}]}}"#)
}

/// A square of 10 m.
const SQUARE: &str = "[[0,0],[10,0],[10,10],[0,10],[0,0]]";
const TEN: &str = r#"{"height": 10}"#;

fn square_feature(id: &str) -> String {
    feature(id, TEN, &polygon(SQUARE))
}

/// Whether every edge occurs once in each direction.
fn is_closed(scene: &Scene) -> bool {
    let mut edges = BTreeMap::new();
    for triangle in &scene.triangles {
        let corners = triangle.corners.map(|corner| corner.map(|c| (c * 1000.0).round() as i64));
        for i in 0..3 {
            let (from, to) = (corners[i], corners[(i + 1) % 3]);
            *edges.entry((from.min(to), from.max(to))).or_insert(0) += if from < to { 1 } else { -1 };
        }
    }
    edges.values().all(|&balance| balance == 0)
}

const FLAT_ROOF: [u8; 3] = [230, 229, 225];
const GROUND: [u8; 3] = [190, 190, 186];

#[test]
fn footprint_becomes_a_closed_prism_coloured_by_its_surfaces() {
    let (scene, report) =
        read(&collection(&feature("h", r#"{"height": "14.5 m", "min_height": 2}"#, &polygon(SQUARE))));
    assert_eq!((scene.objects.len(), scene.triangles.len()), (1, 12));
    assert!(is_closed(&scene) && (volume_m3(&scene) - 1250.0).abs() < 1e-3);
    assert_eq!((scene.origin[2], scene.objects[0].base_z_m), (2.0, -2.0), "the ground is at 0");
    let colours: Vec<_> = scene.materials.iter().map(|material| material.rgb).collect();
    assert_eq!((colours.len(), colours[0], colours[2]), (3, FLAT_ROOF, GROUND));
    let source = &report.sources[0];
    assert_eq!((source.format, source.objects, report.crs.as_deref()), (SourceFormat::GeoJson, 1, Some("EPSG:6677")));
    assert!(source.problems.is_empty() && source.skipped.is_empty());
}

#[test]
fn colours_and_materials_of_properties_are_used() {
    let colours = |properties: &str| {
        let (scene, report) = read(&collection(&feature("h", properties, &polygon(SQUARE))));
        let colours: Vec<_> = scene.materials.iter().map(|material| material.rgb).collect();
        (colours, report.sources[0].problems.keys().cloned().collect::<Vec<_>>())
    };
    let [roof, wall, ground] = colours(r#"{"height": 3}"#).0[..] else { panic!("not three colours") };
    let own_colours = r##"{"height": 3, "building:colour": "#102030", "roof:color": "brown; white"}"##;
    assert_eq!(colours(own_colours), (vec![[165, 42, 42], [16, 32, 48], ground], vec![]));
    let primary = colours(r#"{"height": 3, "roof:colour": "red", "building:colour": "white"}"#).0;
    assert!(primary[0][1] > 100 && primary[0][0] < 210 && primary[1] == wall, "{primary:?}");
    let materials = r#"{"height": 3, "building:material": "Brick", "roof:material": "slate"}"#;
    let palette = Palette::default();
    let [slate, brick] = ["slate", "brick"].map(|name| palette.material(name).unwrap());
    assert_eq!(colours(materials).0, [slate, brick, ground]);
    let plain = r#"{"height": 3, "colour": "tan", "roof:material": "unheard of"}"#;
    assert_eq!(colours(plain).0, [roof, [210, 180, 140], ground]);
    let odd = r#"{"height": 3, "building:colour": "stripy", "roof:colour": 7}"#;
    assert_eq!(colours(odd), (vec![roof, wall, ground], vec!["colour not understood".to_owned()]));
}

#[test]
fn holes_and_parts_of_either_orientation_are_extruded() {
    let hole = "[[2,2],[4,2],[4,4],[2,4],[2,2]]";
    let turned = "[[2,2],[2,4],[4,4],[4,2],[2,2]]";
    let clockwise = "[[0,0],[0,10],[10,10],[10,0],[0,0]]";
    for (outer, hole) in [(SQUARE, hole), (SQUARE, turned), (clockwise, hole), (clockwise, turned)] {
        let (scene, _) = read(&collection(&feature("h", TEN, &polygon(&format!("{outer}, {hole}")))));
        assert!(is_closed(&scene) && (volume_m3(&scene) - 960.0).abs() < 1e-3, "{}", volume_m3(&scene));
    }
    let far = "[[20,0,7],[30,0,8],[30,10,9],[20,10],[20,0]]";
    let multi = format!(r#"{{"type": "MultiPolygon", "coordinates": [[{SQUARE}, {hole}], [{far}]]}}"#);
    let collected = format!(
        r#"{{"type": "GeometryCollection", "geometries": [{}, {{"type": "Point", "coordinates": [1, 2]}}, {}]}}"#,
        polygon(&format!("{SQUARE}, {hole}")),
        polygon(far)
    );
    for geometry in [multi, collected] {
        let (scene, report) = read(&collection(&feature("m", TEN, &geometry)));
        assert_eq!(report.objects, 1);
        assert!(is_closed(&scene) && (volume_m3(&scene) - 1960.0).abs() < 1e-3);
    }
}

#[test]
fn bad_rings_are_repaired_or_skipped_and_reported() {
    let nan = "[[0,0],[10,0],[NaN,10],[0,10],[0,0]]";
    let huge = "[[0,0],[10,0],[1e12,10],[0,10],[0,0]]";
    let cases = [
        (polygon("[[0,0],[10,0],[10,10],[0,10]]"), Some("ring not closed, closed")),
        (polygon("[[0,0],[0,0],[10,0],[10,0],[10,10],[0,10],[0,0],[0,0]]"), None),
        (polygon(&format!("{SQUARE}, [[1,1],[2,2]]")), Some("hole filled, its ring is no ring")),
        (polygon(&format!("{SQUARE}, {nan}")), Some("hole filled, its ring is no ring")),
        (
            format!(r#"{{"type": "MultiPolygon", "coordinates": [[{SQUARE}], [{nan}]]}}"#),
            Some("coordinate not a number or out of range"),
        ),
    ];
    for (geometry, problem) in cases {
        let (scene, report) = read(&collection(&feature("a", TEN, &geometry)));
        assert!(is_closed(&scene) && (volume_m3(&scene) - 1000.0).abs() < 1e-3, "{geometry}");
        let problems: Vec<_> = report.sources[0].problems.keys().map(String::as_str).collect();
        assert_eq!(problems, Vec::from_iter(problem), "{geometry}");
    }
    let skipped = [
        (polygon("[[0,0],[10,0],[0,0]]"), "ring of fewer than three corners"),
        (polygon("[[0,0],[5,0],[10,0],[0,0]]"), "ring without area"),
        (polygon(nan), "coordinate not a number or out of range"),
        (polygon(huge), "coordinate not a number or out of range"),
        (polygon(""), "empty geometry"),
        (polygon("7"), "malformed coordinates"),
        (polygon(r#"[["a", 1]]"#), "malformed coordinates"),
        (r#"{"type": "Polygon"}"#.to_owned(), "empty geometry"),
        (
            r#"{"type": "LineString", "coordinates": [[0,0],[1,1]]}"#.to_owned(),
            "line without a width that is no road, railway or water",
        ),
        ("null".to_owned(), "no geometry"),
        ("7".to_owned(), "malformed feature"),
    ];
    for (geometry, reason) in skipped {
        let text = collection(&format!("{}, {}", feature("bad", TEN, &geometry), square_feature("good")));
        let (scene, report) = read(&text);
        assert_eq!(scene.objects[0].id, "good", "{geometry}");
        let reasons: Vec<_> =
            report.sources[0].skipped.iter().map(|(why, tally)| (why.as_str(), tally.count)).collect();
        assert_eq!(reasons, [(reason, 1)], "{geometry}");
    }
}

#[test]
fn ring_that_crosses_itself_is_reported() {
    let uneven = "[[0,0],[10,0],[10,10],[4,-5],[0,10],[0,0]]";
    let bow = "[[0,0],[10,10],[10,0],[0,10],[0,0]]";
    let hole = "[[1,1],[3,3],[3,1],[1,3],[1,1]]";
    for (rings, m3) in
        [(uneven.to_owned(), 1250.0 / 3.0), (bow.to_owned(), 500.0), (format!("{SQUARE}, {hole}"), 1000.0 - 20.0)]
    {
        let (scene, report) = read(&collection(&feature("x", TEN, &polygon(&rings))));
        assert!((volume_m3(&scene) - m3).abs() < 0.5, "{rings}: {} m3", volume_m3(&scene));
        // The roof around holes that touch in a corner has other edges than their walls.
        assert!(is_closed(&scene) || rings.contains(hole), "{rings}");
        let problems: Vec<_> =
            report.sources[0].problems.iter().map(|(kind, tally)| (kind.as_str(), &tally.first)).collect();
        assert_eq!(problems, [("ring crosses itself or another", &vec!["x".to_owned()])], "{rings}");
    }
}

#[test]
fn degrees_become_metres_in_the_zone_of_the_first_position() {
    // A ten-thousandth of a degree is about 10 m.
    let ring = "[[139.75,35.69],[139.7501,35.69],[139.7501,35.6901],[139.75,35.6901],[139.75,35.69]]";
    let text = format!(r#"{{"features": [{}], "type": "FeatureCollection"}}"#, feature("t", TEN, &polygon(ring)));
    let (scene, report) = read(&text);
    assert_eq!(scene.crs.as_deref(), Some("EPSG:32654"));
    assert_eq!(report.sources[0].crs.as_deref(), Some("OGC:CRS84"));
    // 9.05 m by 11.09 m there, times the zone's scale of 0.9997.
    assert!((volume_m3(&scene) - 1003.7).abs() < 2.0, "{}", volume_m3(&scene));
    // A second file in the neighbouring zone is projected to the zone of the first.
    let [west, east] = ["143.95", "144.1"].map(|degrees| text.replace("139.75", degrees));
    let (scene, _) = try_read(&[("a.geojson", west.as_bytes()), ("b.json", east.as_bytes())]).unwrap();
    assert_eq!((scene.crs.as_deref(), scene.objects.len()), (Some("EPSG:32654"), 2));
    // With a source in a projected system, both are in that. Its square is at the system's origin, far away.
    let metres = collection(&square_feature("a")).replace("6677", "32654");
    let error = try_read(&[("a.geojson", metres.as_bytes()), ("b.geojson", text.as_bytes())]).unwrap_err();
    assert!(matches!(error, InputError::NothingLeft { .. }), "{error}");
}

#[test]
fn degrees_that_are_declared_as_metres_are_named() {
    let ring = "[[4.36,52.01],[4.3602,52.01],[4.3602,52.0101],[4.36,52.0101],[4.36,52.01]]";
    let text = collection(&feature("a", TEN, &polygon(ring)));
    let error = try_read(&[("a.geojson", text.as_bytes())]).unwrap_err().to_string();
    assert!(error.contains("degrees that are declared as metres"), "{error}");
}

#[test]
fn a_system_behind_the_features_is_theirs() {
    let member = r#""crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::6677"}}"#;
    let own = feature("a", r#"{"height": 10, "crs": {"properties": {"name": "EPSG:4326"}}}"#, &polygon(SQUARE));
    let document = |end: &str| format!(r#"{{"type": "FeatureCollection", "features": [{own}]{end}}}"#);
    let late = document(&format!(", {member}, \"bbox\": [0, 1]"));
    let packed = insula_source::testing::gzip(late.as_bytes());
    for (name, bytes) in [("a.geojson", late.as_bytes()), ("a.geojson.gz", &packed[..])] {
        let (scene, report) = try_read(&[(name, bytes)]).unwrap();
        assert_eq!((scene.objects.len(), report.crs.as_deref()), (1, Some("EPSG:6677")), "{name}");
    }
    let degrees = document(r#", "crs": null"#).replace(SQUARE, &SQUARE.replace("10", "0.0001"));
    assert_eq!(read(&degrees).1.sources[0].crs.as_deref(), Some("OGC:CRS84"));
    // Too far from the end to be found before.
    let far = document(&format!(r#", {member}, "note": "{}""#, "x".repeat(1 << 15)));
    let error = try_read(&[("a.geojson", far.as_bytes())]).unwrap_err();
    assert!(error.to_string().contains("comes after its features"), "{error}");
}

#[test]
fn rings_across_the_antimeridian_are_one_piece() {
    let text = |[west, east]: [&str; 2]| {
        let ring = format!("[[{west},-16.8],[{east},-16.8],[{east},-16.7999],[{west},-16.7999],[{west},-16.8]]");
        format!(r#"{{"type": "FeatureCollection", "features": [{}]}}"#, feature("t", TEN, &polygon(&ring)))
    };
    for sides in [["179.99995", "-179.99995"], ["179.99995", "180.00005"]] {
        let (scene, _) = read(&text(sides));
        // 10.66 m by 11.07 m, times the scale at the border of a zone.
        assert!((volume_m3(&scene) - 1182.0).abs() < 5.0, "{sides:?}: {}", volume_m3(&scene));
    }
}

#[test]
fn features_are_read_line_by_line() {
    let (a, b) = (square_feature("a"), square_feature("b").replace("[10,0]", "[10,NaN]"));
    let degrees = |text: &str| text.replace("10]", "0.0001]").replace("[10", "[0.0001");
    let text = format!("\u{1e}{}\n\n{{\n\u{1e}{}\r\n[]\n{}", degrees(&a), degrees(&b), degrees(&a));
    for name in ["a.geojsonl", "a.geojsons", "a.geojsonseq", "a.geojson", "a.json", "a.ndjson", "a.jsonl", "a.csv"] {
        let (scene, report) = try_read(&[(name, text.as_bytes())]).unwrap();
        assert_eq!((scene.objects.len(), scene.crs.as_deref()), (2, Some("EPSG:32631")));
        let skipped = &report.sources[0].skipped;
        assert_eq!((skipped["malformed feature"].count, skipped["no feature"].count), (1, 1));
        assert!(skipped["malformed feature"].first[0].starts_with("feature 2: "));
        assert_eq!(skipped["coordinate not a number or out of range"].first, ["b"]);
    }
}

#[test]
fn metadata_and_feature_identifiers_are_read() {
    let plain = square_feature("x").replace(r#""id": "x", "#, "");
    let named = plain.replace(r#"{"height""#, r#"{"id": "13101-bldg-7347", "height""#);
    let numbered = plain.replace(r#""type""#, r#""id": 77, "type""#).replace(TEN, "null");
    let text = collection(&format!("{plain}, {named}, {numbered}"));
    let text =
        text.replacen('{', r#"{"title": "Tokyo", "copyright": "PLATEAU", "bbox": [1, NaN], "license": "CC BY", "#, 1);
    let (scene, report) = read(&text);
    assert_eq!(ids(&scene), ["feature 1", "13101-bldg-7347", "77"]);
    let source = &report.sources[0];
    assert_eq!((&source.titles[..], &source.attributions[..]), (&["Tokyo".into()][..], &["PLATEAU".into()][..]));
    assert_eq!(source.licences, ["CC BY"]);
    assert_eq!(source.problems["height guessed"].first, ["77: 6 m"]);
    assert_eq!(source.footprints, 3);
    assert_eq!(source.objects_by_type["a"], 3);
}

#[test]
fn truncated_or_foreign_document_is_an_error() {
    let text = collection(&format!("{}, {}", square_feature("a"), square_feature("b")));
    for end in 0..text.len() {
        for name in ["a.geojson", "a.json"] {
            assert!(try_read(&[(name, &text.as_bytes()[..end])]).is_err(), "cut at {end}");
        }
    }
    for (text, part) in [
        (r#"{"type": "CityJSON"}"#, r#"its type is "CityJSON", not "FeatureCollection""#),
        (r#"{"features": []}"#, "not GeoJSON"),
        (r#"{"type": "FeatureCollection", "features": 7}"#, "line 1, column 44: invalid type"),
        (r#"{"type": "FeatureCollection", "features": []}"#, "the city is empty"),
        (r#"{"type": "FeatureCollection", "features": []} x"#, "trailing characters"),
        ("[]", "a GeoJSON document"),
    ] {
        let error = try_read(&[("a.geojson", text.as_bytes())]).unwrap_err().to_string();
        assert!(error.starts_with("a.geojson: ") && error.contains(part) && !error.contains('\n'), "{error}");
    }
}

#[test]
fn documents_beyond_the_limits_are_refused() {
    let options = ReadOptions { max_source_bytes: 1 << 16, max_line_bytes: 1 << 12, ..ReadOptions::default() };
    let too_large = |text: &str| {
        let error = read_embedded(&[("a.geojson", text.as_bytes())], &options, &|_| {}).unwrap_err();
        let InputError::TooLarge { limit, .. } = error else { panic!("{error}") };
        limit
    };
    let many = vec![square_feature("a"); 1000].join(",");
    assert_eq!(too_large(&collection(&many)), 1 << 16);
    assert_eq!(too_large(&collection(&feature("a", TEN, &polygon(&"[[0,0],[1,0]],".repeat(1000))))), 1 << 12);
    assert_eq!(too_large(&format!(r#"{{"bbox": {}"#, "[".repeat(1 << 20))), 1 << 12);
    assert_eq!(too_large(&" ".repeat(1 << 20)), 1 << 12);
    let lines = format!("{}\n{}", " ".repeat(5000), square_feature("a").replace("10", "0.001"));
    let (scene, report) = read_embedded(&[("a.geojsonl", lines.as_bytes())], &options, &|_| {}).unwrap();
    assert_eq!((scene.objects.len(), report.sources[0].skipped["line too long"].count), (1, 1));
}

#[test]
fn areas_of_water_are_level_surfaces_at_the_ground() {
    for (properties, is_water) in [
        (r#"{"natural": "water", "height": 9}"#, true),
        (r#"{"water": "pond"}"#, true),
        (r#"{"waterway": "riverbank"}"#, true),
        (r#"{"natural": "water", "building": "yes"}"#, false),
        (r#"{"water": "no"}"#, false),
        (r#"{"building": "yes", "building:material": "glass"}"#, false),
    ] {
        let (scene, report) = read(&collection(&feature("a", properties, &polygon(SQUARE))));
        assert_eq!(scene.triangles.len(), if is_water { 2 } else { 12 }, "{properties}");
        assert_eq!(scene.objects[0].kind.is_terrain(), is_water);
        let reflective = scene.triangles.iter().filter(|t| scene.materials[t.material as usize].is_reflective).count();
        let is_glass = properties.contains("glass");
        assert_eq!(
            reflective,
            if is_water {
                2
            } else if is_glass {
                8
            } else {
                0
            },
            "{properties}"
        );
        assert_eq!(report.sources[0].objects, 1);
    }
}

#[test]
fn single_features_and_places_of_json_fg_are_read() {
    let (scene, _) = read(&feature("one", TEN, &polygon(&SQUARE.replace("10", "0.0001"))));
    assert_eq!((scene.objects[0].id.as_str(), scene.crs.as_deref()), ("one", Some("EPSG:32631")));
    let square = "[[[500000,5700000,1],[500010,5700000,1],[500010,5700010,1],[500000,5700000,1]]]";
    let body = format!(r#"{{"type": "Polyhedron", "coordinates": [[{square}, {}]]}}"#, square.replace(",1]", ",9]"));
    let crs = r#""coordRefSys": "http://www.opengis.net/def/crs/EPSG/0/5555""#;
    let text =
        format!(r#"{{"type": "Feature", "id": "b", {crs}, "place": {body}, "geometry": null, "properties": null}}"#);
    let (scene, report) = read(&text);
    assert_eq!((range(&scene, 2), report.crs.as_deref()), ([1.0, 9.0], Some("EPSG:5555")));
    let one = text.replace(&format!("{crs}, "), "");
    let (scene, _) = read(&format!(r#"{{"type": "FeatureCollection", {crs}, "features": [{one}]}}"#));
    assert_eq!(range(&scene, 2), [1.0, 9.0]);
}

#[test]
fn coordinates_without_a_system_are_degrees_or_those_of_the_option() {
    let metres = "[[84477,447346],[84497,447346],[84497,447356],[84477,447356],[84477,447346]]";
    let text = format!(r#"{{"type": "FeatureCollection", "features": [{}]}}"#, feature("a", TEN, &polygon(metres)));
    let (scene, report) = read(&text);
    assert_eq!(scene.crs, None);
    assert!(
        report
            .guess_warnings()
            .any(|warning| warning.contains("84477, 447346 are taken as metres of an unknown place"))
    );
    let mut options = ReadOptions::default();
    options.placing.crs = Some("EPSG:28992".to_owned());
    let (scene, report) = read_embedded(&[("a.geojson", text.as_bytes())], &options, &|_| {}).unwrap();
    assert_eq!((scene.crs.as_deref(), report.sources[0].crs.as_deref()), (Some("EPSG:28992"), Some("EPSG:28992")));
    assert!((scene.origin[0] - 84_477.0).abs() < 100.0, "{:?}", scene.origin);
    assert_eq!(report.sources[0].problems["coordinate system not given"].count, 1);
    // A plan around its own origin.
    let (scene, report) = read(&text.replace(metres, SQUARE));
    assert!((volume_m3(&scene) - 1000.0).abs() < 1e-3 && scene.crs.is_none());
    assert!(report.guess_warnings().any(|warning| warning.contains("0, 0 are taken as metres of an unknown place")));
    // A system that says that it is none.
    let none = r#"LOCAL_CS[\"Undefined SRS\",UNIT[\"unknown\",0]]"#;
    let named = format!(r#"{{"crs": {{"type": "name", "properties": {{"name": "{none}"}}}}, "#);
    let (scene, report) = read(&text.replacen('{', &named, 1));
    assert_eq!(scene.crs, None);
    assert!(report.guess_warnings().any(|warning| warning.contains("metres of an unknown place")));
    // Latitude first.
    let turned = "[[35.68,139.76],[35.6801,139.76],[35.6801,139.7601],[35.68,139.76]]";
    let (scene, report) = read(&text.replace(metres, turned));
    assert_eq!(scene.crs.as_deref(), Some("EPSG:32654"));
    assert!(report.guess_warnings().any(|warning| warning.contains("139.7600, 35.6800")));
    // In Vienna this can be a place in Arabia.
    let either = "[[48.21,16.37],[48.2101,16.37],[48.2101,16.3701],[48.21,16.37]]";
    let (_, report) = read(&text.replace(metres, either));
    assert!(report.sources[0].problems.contains_key(EITHER_ORDER));
}

#[test]
fn a_city_far_from_its_first_object_is_named() {
    let at = |id: &str, lon: f64, lat: f64| {
        let (east, north) = (lon + 1e-4, lat + 1e-4);
        let square = format!("[[{lon},{lat}],[{east},{lat}],[{east},{north}],[{lon},{north}],[{lon},{lat}]]");
        feature(id, TEN, &polygon(&square))
    };
    let degrees = |features: &str| format!(r#"{{"type": "FeatureCollection", "features": [{features}]}}"#);
    let (delft, tokyo) = (at("delft", 4.36, 52.01), [at("a", 139.76, 35.68), at("b", 139.761, 35.68)]);
    let (scene, report) = read(&degrees(&format!("{delft},{},{}", tokyo[0], tokyo[1])));
    assert_eq!(scene.objects.len(), 2);
    let warnings: Vec<String> = report.warnings().collect();
    let has = |words: &[&str]| warnings.iter().any(|text| words.iter().all(|word| text.contains(word)));
    assert!(has(&["delft: ", "km away", "2 objects are baked"]), "{warnings:?}");
    assert!(has(&["far outside of EPSG:32631", "EPSG:32654", "--crs"]), "{warnings:?}");
    // Of two, that of the first object is baked, in its own system.
    let (scene, report) = read(&degrees(&format!("{delft},{}", tokyo[0])));
    assert_eq!(scene.objects[0].id, "delft");
    let warnings: Vec<String> = report.warnings().collect();
    assert!(
        warnings.len() == 1 && warnings[0].contains("a: ") && warnings[0].contains("1 object is baked"),
        "{warnings:?}"
    );
}

#[test]
fn houses_outside_of_the_wanted_area_are_not_counted() {
    let house = |id: &str, west: u32| {
        let east = west + 10;
        feature(id, "{}", &polygon(&format!("[[{west},0],[{east},0],[{east},10],[{west},10],[{west},0]]")))
    };
    let text = collection(&format!("{}, {}", house("near", 0), house("far", 200)));
    let mut options = ReadOptions::default();
    options.placing.bbox_m = Some([-5.0, -5.0, 100.0, 100.0]);
    let (scene, report) = read_embedded(&[("a.geojson", text.as_bytes())], &options, &|_| {}).unwrap();
    let source = &report.sources[0];
    assert_eq!((scene.objects.len(), source.footprints, source.outside_bbox), (1, 1, 1));
    assert_eq!(source.problems["height guessed"].count, 1);
    assert_eq!(source.unaccounted(), 0);
}
