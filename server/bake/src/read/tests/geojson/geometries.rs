//! Documents and geometries of all kinds: single features, lines, points, heights, and JSON-FG.

use super::{SQUARE, TEN, collection, feature, is_closed, polygon, range, read, try_read, volume_m3};
use crate::read::{AxisOrders, FeatureKind, InputError, ReadOptions, ReadReport, read_embedded};
use insula_source::problems::{EITHER_ORDER, NO_GROUND_HEIGHT, SWAPPED};

fn kinds(report: &ReadReport) -> Vec<(FeatureKind, u64)> {
    report.sources[0].objects_by_kind.iter().map(|(kind, count)| (*kind, *count)).collect()
}

#[test]
fn footprints_stand_at_the_height_of_their_lowest_corner() {
    let level = "[[0,0,512.3],[10,0,512.3],[10,10,512.3],[0,10,512.3],[0,0,512.3]]";
    let slope = "[[0,0,512.3],[10,0,513],[10,10,515],[0,10,514],[0,0,512.3]]";
    let zero = "[[0,0,0],[10,0,0],[10,10,0],[0,10,0],[0,0,0]]";
    let partly = "[[0,0,512.3],[10,0],[10,10,512.3],[0,10,512.3],[0,0,512.3]]";
    let mark = "[[0,0,512.3],[10,0,-9999],[10,10,514],[0,10,512.3],[0,0,512.3]]";
    let missing = "[[0,0,-1e38],[10,0,-1e38],[10,10,-1e38],[0,10,-1e38],[0,0,-1e38]]";
    for (ring, base_m) in [(level, 512.3), (slope, 512.3), (zero, 0.0), (partly, 512.3), (mark, 512.3), (missing, 0.0)]
    {
        let (scene, report) = read(&collection(&feature("h", TEN, &polygon(ring))));
        let [low, high] = range(&scene, 2);
        assert!((low - base_m).abs() < 1e-3 && (high - base_m - 10.0).abs() < 1e-3, "{ring}: {low} to {high}");
        assert!(is_closed(&scene));
        assert_eq!(report.guess_warnings().any(|warning| warning.contains("-9999")), ring == mark, "{ring}");
    }
}

#[test]
fn tops_above_sea_level_are_less_the_ground_of_the_plan() {
    let level = "[[0,0,512.3],[10,0,512.3],[10,10,512.3],[0,10,512.3],[0,0,512.3]]";
    for attributes in [r#"{"roof_elev": 524.3}"#, r#"{"h_dak_max": 524.3, "h_maaiveld": 512.3}"#] {
        let (scene, report) = read(&collection(&feature("h", attributes, &polygon(level))));
        let [low, high] = range(&scene, 2);
        assert!((low - 512.3).abs() < 1e-3 && (high - 524.3).abs() < 1e-3, "{attributes}: {low} to {high}");
        assert!(!report.sources[0].problems.contains_key(NO_GROUND_HEIGHT), "{attributes}");
    }
}

#[test]
fn trees_stand_at_their_own_height() {
    let tree = r#"{"type": "Point", "coordinates": [5, 30, 512.3]}"#;
    let (scene, _) = read(&collection(&feature("t", r#"{"natural": "tree", "height": 9}"#, tree)));
    let [low, high] = range(&scene, 2);
    assert!((low - 512.3).abs() < 1e-3 && (high - 521.3).abs() < 0.1, "{low} to {high}");
    let (_, report) = read(&collection(&feature("t", r#"{"natural": "tree", "height": 1200}"#, tree)));
    assert_eq!(report.sources[0].problems["height of a tree out of range, taken as unknown"].first, ["t is 1200 m"]);
    let (_, report) = read(&collection(&feature("t", r#"{"natural": "tree", "height": "tall"}"#, tree)));
    let odd = &report.sources[0].problems["height of a plant not understood, taken as unknown"];
    assert_eq!(odd.first, ["t: height is tall"]);
}

#[test]
fn sloping_plans_with_the_height_that_the_user_names_are_extruded() {
    let slope = "[[0,0,5],[10,0,5],[10,10,7],[0,10,7],[0,0,5]]";
    let text = collection(&feature("h", r#"{"WERT_7": 12}"#, &polygon(slope)));
    let options = ReadOptions { height_field: Some("WERT_7".to_owned()), ..ReadOptions::default() };
    let (scene, _) = read_embedded(&[("a.geojson", text.as_bytes())], &options, &|_| {}).unwrap();
    assert!(is_closed(&scene) && (volume_m3(&scene) - 1200.0).abs() < 1e-2, "{}", volume_m3(&scene));
    assert_eq!(read(&text).0.triangles.len(), 2, "a surface without it");
}

#[test]
fn bodies_of_upright_polygons_stay_bodies() {
    let faces = [
        "[[0,0,5],[0,9,5],[9,9,5],[9,0,5],[0,0,5]]",
        "[[0,0,9],[9,0,9],[9,9,9],[0,9,9],[0,0,9]]",
        "[[0,0,5],[9,0,5],[9,0,9],[0,0,9],[0,0,5]]",
        "[[9,0,5],[9,9,5],[9,9,9],[9,0,9],[9,0,5]]",
        "[[9,9,5],[0,9,5],[0,9,9],[9,9,9],[9,9,5]]",
        "[[0,9,5],[0,0,5],[0,0,9],[0,9,9],[0,9,5]]",
    ];
    let body = format!(r#"{{"type": "MultiPolygon", "coordinates": [[{}]]}}"#, faces.join("],["));
    let (scene, _) = read(&collection(&feature("b", "{}", &body)));
    assert!(is_closed(&scene) && (volume_m3(&scene) - 324.0).abs() < 1e-2, "{}", volume_m3(&scene));
    assert_eq!(range(&scene, 2), [5.0, 9.0]);
}

#[test]
fn lines_and_points_are_read() {
    let road = r#"{"type": "LineString", "coordinates": [[0,20],[50,20]]}"#;
    let tree = r#"{"type": "MultiPoint", "coordinates": [[5,30],[25,30]]}"#;
    let features = [
        feature("h", TEN, &polygon(SQUARE)),
        feature("r", r#"{"highway": "residential"}"#, road),
        feature("t", r#"{"natural": "tree"}"#, tree),
    ];
    let (_, report) = read(&collection(&features.join(",")));
    let expected = [(FeatureKind::Building, 1), (FeatureKind::Road, 1), (FeatureKind::Vegetation, 1)];
    let mut found = kinds(&report);
    found.sort_by_key(|(kind, _)| expected.iter().position(|(known, _)| known == kind));
    assert_eq!(found, expected);
    // In a table of all kinds, and in a file of trees.
    let table = r#"{"building": null, "landuse": null, "highway": null}"#;
    let (_, report) =
        read(&collection(&[feature("x", table, &polygon(SQUARE)), feature("h", TEN, &polygon(SQUARE))].join(",")));
    assert_eq!(kinds(&report), [(FeatureKind::Building, 1)]);
    assert_eq!(report.sources[0].skipped["no object of a city by its tags"].first, ["x"]);
    let text = collection(&feature("t", "{}", tree));
    let (_, report) = try_read(&[("trees.geojson", text.as_bytes())]).unwrap();
    assert_eq!(kinds(&report), [(FeatureKind::Vegetation, 1)]);
}

#[test]
fn single_features_and_geometries_are_documents() {
    let ring = "[[4.36,52.01],[4.3602,52.01],[4.3602,52.0101],[4.36,52.0101],[4.36,52.01]]";
    let (single, geometry) = (feature("s", TEN, &polygon(ring)), polygon(ring));
    let collected = format!(r#"{{"geometries": [{geometry}], "type": "GeometryCollection"}}"#);
    for (text, id) in [(single.as_str(), "s"), (&geometry, "feature 1"), (&collected, "feature 1")] {
        for name in ["a.geojson", "a.json"] {
            let (scene, report) = try_read(&[(name, text.as_bytes())]).unwrap();
            assert_eq!((scene.objects[0].id.as_str(), scene.crs.as_deref()), (id, Some("EPSG:32631")), "{text}");
            assert!(is_closed(&scene) && report.sources[0].skipped.is_empty());
        }
    }
    let point = r#"{"type": "Feature", "geometry": {"type": "Point", "coordinates": [125.6, 10.1]}, "properties": {}}"#;
    let error = try_read(&[("a.json", point.as_bytes())]).unwrap_err();
    assert!(
        matches!(error, InputError::Empty { .. }) && error.to_string().contains("point of unknown kind"),
        "{error}"
    );
    let options = ReadOptions { max_line_bytes: 1 << 10, ..ReadOptions::default() };
    let long = feature("s", &format!(r#"{{"a": "{}"}}"#, "x".repeat(900)), &polygon(&["[[0,0],[1,0]]"; 40].join(",")));
    let error = read_embedded(&[("a.geojson", long.as_bytes())], &options, &|_| {}).unwrap_err();
    assert!(matches!(error, InputError::TooLarge { limit: 1024, .. }), "{error}");
}

/// A prism of 9 by 9 by 4 m of JSON-FG.
fn place(kind: &str) -> String {
    let ring = "[[100,9000],[109,9000],[109,9009],[100,9009],[100,9000]]";
    format!(r#"{{"type": "{kind}", "lower": 5, "upper": 9, "base": {}}}"#, polygon(ring))
}

#[test]
fn places_of_json_fg_have_their_own_system() {
    let plan = polygon("[[8.7,51.5],[8.7001,51.5],[8.7001,51.5001],[8.7,51.5]]");
    let text = |members: &str, place: &str| {
        let feature =
            format!(r#"{{"type": "Feature", "id": "f", "place": {place}, "geometry": {plan}, "properties": {TEN}}}"#);
        format!(r#"{{"type": "FeatureCollection", {members} "features": [{feature}]}}"#)
    };
    let system = r#""coordRefSys": "http://www.opengis.net/def/crs/EPSG/0/6677","#;
    let (scene, report) = read(&text(system, &place("Prism")));
    // North comes first in this system, where the place is.
    assert!((scene.origin[0] - 9000.0).abs() < 200.0 && (scene.origin[1] - 100.0).abs() < 200.0, "{:?}", scene.origin);
    assert!((volume_m3(&scene) - 324.0).abs() < 1e-2, "{}", volume_m3(&scene));
    assert_eq!((range(&scene, 2), scene.crs.as_deref()), ([5.0, 9.0], Some("EPSG:6677")));
    let problems = &report.sources[0].problems;
    assert_eq!(problems.keys().collect::<Vec<_>>(), [EITHER_ORDER], "both are places in Japan");
    // The option acts on the coordinates as they are written.
    let mut options = ReadOptions::default();
    options.placing.axis_orders = AxisOrders::new(["en".parse().unwrap()]);
    let by_hand = text(system, &place("Prism"));
    let (scene, _) = read_embedded(&[("a.geojson", by_hand.as_bytes())], &options, &|_| {}).unwrap();
    assert!((scene.origin[0] - 100.0).abs() < 200.0 && (scene.origin[1] - 9000.0).abs() < 200.0, "{:?}", scene.origin);
    assert!((volume_m3(&scene) - 324.0).abs() < 1e-2, "{}", volume_m3(&scene));
    // A type that is not known yields to the geometry, and an empty place, too.
    for (place, problem) in [(place("Klein"), Some("geometry of unknown type")), ("null".to_owned(), None)] {
        let (scene, report) = read(&text("", &place));
        assert_eq!(scene.crs.as_deref(), Some("EPSG:32632"));
        let problems = report.sources[0].problems.keys().map(String::as_str);
        assert_eq!(problems.collect::<Vec<_>>(), Vec::from_iter(problem));
    }
    let late = text("", &place("Prism")).replace("}]}", &format!("}}], {}}}", system.trim_end_matches(',')));
    let inside = text("", &place("Prism").replacen('{', &format!("{{{system}"), 1));
    for text in [late, inside] {
        let (scene, report) = read(&text);
        assert_eq!((range(&scene, 2), report.crs.as_deref()), ([5.0, 9.0], Some("EPSG:6677")), "{text}");
    }
    let error = try_read(&[("a.geojson", text("", &place("Prism")).as_bytes())]).unwrap_err();
    assert!(error.to_string().contains("its first coordinates are 100, 9000, as in metres"), "{error}");
}

#[test]
fn longitudes_may_reach_a_whole_turn() {
    let text = |west: f64| {
        let east = west + 0.0001;
        let ring = format!("[[{west},-18],[{east},-18],[{east},-17.9999],[{west},-17.9999],[{west},-18]]");
        format!(r#"{{"type": "FeatureCollection", "features": [{}]}}"#, feature("f", TEN, &polygon(&ring)))
    };
    let [(west, _), (turned, report)] = [-178.5, 181.5].map(|west| read(&text(west)));
    assert_eq!((turned.crs.as_deref(), report.sources[0].problems.len()), (west.crs.as_deref(), 0));
    let distance_m = (0..3).map(|axis| (west.origin[axis] - turned.origin[axis]).abs()).fold(0.0, f64::max);
    assert!(distance_m < 0.1, "{:?} {:?}", west.origin, turned.origin);
}

#[test]
fn roofs_without_walls_are_slabs_on_posts() {
    let roof = |tags: &str| read(&collection(&feature("r", tags, &polygon(SQUARE)))).0;
    let slab = roof(r#"{"building": "roof", "height": 5}"#);
    // Eight posts of 0.2 by 0.2 m.
    let posts_m3 = 8.0 * 0.04 * 4.7;
    assert!((volume_m3(&slab) - 30.0 - posts_m3).abs() < 1e-2, "{}", volume_m3(&slab));
    assert!(is_closed(&slab) && range(&slab, 2) == [0.0, 5.0]);
    let gabled = roof(r#"{"building": "carport", "height": 5, "roof:shape": "gabled", "roof:height": 2}"#);
    let posts_m3 = 8.0 * 0.04 * 2.7;
    assert!((volume_m3(&gabled) - 30.0 - 100.0 - posts_m3).abs() < 1e-1, "{}", volume_m3(&gabled));
    let house = roof(r#"{"building": "yes", "height": 5}"#);
    assert!((volume_m3(&house) - 500.0).abs() < 1e-2);
}

#[test]
fn holes_that_touch_walls_are_cut_out() {
    let volume = |holes: &str| {
        let outer = "[[0,0],[30,0],[30,30],[0,30],[0,0]]";
        let (scene, report) = read(&collection(&feature("h", TEN, &polygon(&format!("{outer}, {holes}")))));
        let problems: Vec<String> = report.sources[0].problems.keys().cloned().collect();
        (volume_m3(&scene), problems)
    };
    let touching = "hole that touches another ring, cut out";
    let crossing = "ring crosses itself or another";
    for (hole, m3, expected) in [
        ("[[0,10],[10,5],[10,15],[0,10]]", 8500.0, &[touching][..]),
        ("[[-0.001,10],[10,5],[10,15],[-0.001,10]]", 8500.0, &[touching]),
        ("[[0,5],[0,15],[10,15],[10,5],[0,5]]", 8000.0, &[touching]),
        ("[[0,15],[15,20],[30,15],[15,10],[0,15]]", 7500.0, &[touching]),
        ("[[10,10],[20,10],[20,20],[10,10]], [[20,20],[25,20],[25,25],[20,20]]", 8375.0, &[]),
        ("[[-5,10],[5,10],[5,20],[-5,20],[-5,10]]", 8500.0, &[touching, crossing]),
    ] {
        let (found, problems) = volume(hole);
        assert!((found - m3).abs() < 2.0, "{hole}: {found}");
        assert_eq!(problems, expected, "{hole}");
    }
}

/// The faces of a box of 10 m on a map, each a polygon, with the coordinates in either order.
fn body(is_north_first: bool, is_inward: bool) -> String {
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [3, 2, 6, 7], [2, 0, 4, 6], [1, 3, 7, 5]];
    let corner = |i: usize| {
        let [x, y, z] = [0, 1, 2].map(|bit| if i >> bit & 1 == 0 { 0 } else { 10 });
        let (east, north) = (565_000 + x, 5_934_000 + y);
        let [first, second] = if is_north_first { [north, east] } else { [east, north] };
        format!("[{first},{second},{z}]")
    };
    let face = |mut corners: [usize; 4]| {
        if is_inward {
            corners.reverse();
        }
        let ring: Vec<String> = corners.iter().chain(&corners[..1]).map(|i| corner(*i)).collect();
        format!("[[{}]]", ring.join(","))
    };
    format!(r#"{{"type": "MultiPolygon", "coordinates": [{}]}}"#, faces.map(face).join(","))
}

#[test]
fn bodies_look_outward_where_the_order_of_coordinates_is_corrected() {
    for (is_north_first, is_inward) in [(false, false), (false, true), (true, false), (true, true)] {
        let text = collection(&feature("b", "{}", &body(is_north_first, is_inward))).replace("6677", "25832");
        let (scene, report) = read(&text);
        assert!((volume_m3(&scene) - 1000.0).abs() < 1e-3, "{is_north_first} {is_inward}: {}", volume_m3(&scene));
        assert_eq!(report.sources[0].problems.contains_key(SWAPPED), is_north_first);
        assert!((scene.origin[0] - 565_005.0).abs() < 1.0, "{:?}", scene.origin);
    }
}

#[test]
fn lines_follow_their_own_heights() {
    let line = |z: [f64; 3]| {
        let [a, b, c] = z;
        let text = format!(r#"{{"type": "LineString", "coordinates": [[0,0,{a}],[50,0,{b}],[100,0,{c}]]}}"#);
        let (scene, _) = read(&collection(&feature("r", r#"{"highway": "service"}"#, &text)));
        range(&scene, 2)
    };
    let [low, high] = line([30.0, 34.0, 31.0]);
    assert!((low - 30.05).abs() < 1e-3 && (high - 34.05).abs() < 1e-3, "{low} to {high}");
    let [low, high] = line([0.0; 3]);
    assert!((low - 0.05).abs() < 1e-3 && (high - 0.05).abs() < 1e-3, "{low} to {high}");
}
