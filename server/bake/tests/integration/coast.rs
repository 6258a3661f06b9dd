//! A made coast: which points of the city are sea, what is painted on level ground, and that steps give the same city.

use super::steps::{assert_same, bake_in_steps, options, plain};
use super::support::files;
use insula_bake::BakeOptions;
use insula_bake::read::{ReadOptions, read_embedded};
use insula_bake::scene::Scene;
use insula_protocol::manifest::Manifest;
use insula_test_support::folder::TestFolder;
use insula_test_support::rng::Rng;
use std::fmt::Write;
use std::fs;
use std::path::PathBuf;

/// Metres of UTM zone 32 in a degree, at the equator and its central meridian.
const METRES: [f64; 2] = [0.9996 * 111_319.49, 0.9996 * 110_574.3];
/// The map, in thousandths of a degree east of 9 and north of 0: from 0 to this.
const EXTENT: [f64; 2] = [20.0, 16.0];
/// West, south, east and north end.
const BAY: [f64; 4] = [8.0, 8.0, 12.0, 12.0];
const ISLAND: [f64; 4] = [3.0, 2.0, 5.0, 4.0];
/// The land is north of it.
const COAST: f64 = 8.0;

/// The map as XML: a coast with a bay, an island and a missing piece, which leaves the map, and a small town.
fn map() -> String {
    let mut text = format!(
        "<osm version=\"0.6\"><bounds minlat=\"0\" minlon=\"9\" maxlat=\"{}\" maxlon=\"{}\"/>",
        EXTENT[1] / 1e3,
        9.0 + EXTENT[0] / 1e3
    );
    let (mut nodes, mut ways) = (0, String::new());
    let mut way = |points: &[[f64; 2]], tags: &[(&str, &str)]| {
        let first = nodes;
        for [x, y] in points {
            nodes += 1;
            write!(text, "<node id=\"{nodes}\" lat=\"{:.7}\" lon=\"{:.7}\"/>", y / 1e3, 9.0 + x / 1e3).unwrap();
        }
        write!(ways, "<way id=\"{nodes}\">").unwrap();
        let is_closed = points.first() == points.last();
        for number in first + 1..=nodes {
            let number = if is_closed && number == nodes { first + 1 } else { number };
            write!(ways, "<nd ref=\"{number}\"/>").unwrap();
        }
        for (key, value) in tags {
            write!(ways, "<tag k=\"{key}\" v=\"{value}\"/>").unwrap();
        }
        ways += "</way>";
    };
    let coast = &[("natural", "coastline")];
    way(&[[15.8, COAST], [30.0, COAST]], coast);
    way(&[[-10.0, COAST], [BAY[0], COAST], [BAY[0], BAY[3]], [BAY[2], BAY[3]], [BAY[2], COAST], [15.0, COAST]], coast);
    let ring = |[west, south, east, north]: [f64; 4]| {
        [[west, south], [east, south], [east, north], [west, north], [west, south]]
    };
    way(&ring(ISLAND), coast);
    way(&ring([BAY[0], COAST - 1.0, BAY[2], BAY[3] + 0.5]), &[("leisure", "marina")]);
    way(&[[0.5, 13.0], [19.5, 13.0]], &[("highway", "residential")]);
    way(&[[9.0, 12.5], [9.0, 15.0]], &[("barrier", "hedge")]);
    way(&ring([13.0, 9.0, 15.0, 11.0]), &[("leisure", "park")]);
    way(&[[10.0, 12.2], [10.0, 9.0]], &[("man_made", "pier")]);
    for i in 0..4 {
        let west = 1.0 + 5.0 * f64::from(i);
        way(&ring([west, 14.0, west + 0.4, 14.3]), &[("building", "yes"), ("height", "12")]);
    }
    text + "<node id=\"900\" lat=\"0.0135\" lon=\"9.0035\"><tag k=\"natural\" v=\"tree\"/></node>" + &ways + "</osm>"
}

/// Whether a point is in a box with a distance from its border, in thousandths of a degree.
fn is_in([west, south, east, north]: [f64; 4], [x, y]: [f64; 2], distance: f64) -> bool {
    x > west + distance && x < east - distance && y > south + distance && y < north - distance
}

/// Whether the highest surface over a point reflects; `None` without any.
fn is_water(scene: &Scene, point: [f64; 2]) -> Option<bool> {
    let world = [500_000.0 + point[0] / 1e3 * METRES[0], point[1] / 1e3 * METRES[1]];
    let [x, y] = [0, 1].map(|axis| world[axis] - scene.origin[axis]);
    let mut highest: Option<(f64, bool)> = None;
    for triangle in &scene.triangles {
        let [a, b, c] = triangle.corners.map(|corner| corner.map(f64::from));
        let cross = |p: [f64; 3], q: [f64; 3]| (p[0] - x) * (q[1] - y) - (p[1] - y) * (q[0] - x);
        let weights = [cross(b, c), cross(c, a), cross(a, b)];
        let whole: f64 = weights.iter().sum();
        if whole == 0.0 || weights.iter().any(|weight| weight * whole < 0.0) {
            continue;
        }
        let z = (weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2]) / whole;
        if highest.is_none_or(|(known, _)| z > known) {
            highest = Some((z, scene.materials[triangle.material as usize].is_reflective));
        }
    }
    highest.map(|(_, is_reflective)| is_reflective)
}

#[test]
fn random_points_are_sea_or_land_as_the_coast_says() {
    let map = map();
    let read = ReadOptions { level_ground: true, ..ReadOptions::default() };
    let (scene, report) = read_embedded(&[("coast.osm", map.as_bytes())], &read, &|_| {}).unwrap();
    let warnings: Vec<String> = report.coast_warnings().collect();
    assert!(warnings.len() == 1 && warnings[0].contains("gap in the coastline"), "{warnings:?}");
    assert!(warnings[0].contains("near 0.00800, 9.01500, 89 m"), "{warnings:?}");
    // The road and the park; the pier stands in water, the marina is left to the coast.
    assert_eq!(report.sources[0].painted, 2, "{report:?}");
    let mut rng = Rng::new(5);
    let mut random = |end: f64| rng.below(1 << 20) as f64 / f64::from(1 << 20) * end;
    let (mut sea, mut land) = (0, 0);
    while sea + land < 200 {
        let point = [random(EXTENT[0]), random(EXTENT[1])];
        let [x, y] = point;
        let shores = [(y - COAST).abs() < 0.05, (x - 10.0).abs() < 0.1];
        let is_near = |square| is_in(square, point, -0.05) && !is_in(square, point, 0.05);
        if shores.contains(&true) || is_near(BAY) || is_near(ISLAND) {
            continue;
        }
        let expected = (y < COAST || is_in(BAY, point, 0.0)) && !is_in(ISLAND, point, 0.0);
        // Where nothing is painted, land is left to the generated ground.
        assert_eq!(is_water(&scene, point).unwrap_or(false), expected, "{point:?}");
        *(if expected { &mut sea } else { &mut land }) += 1;
    }
    assert!(sea > 60 && land > 60, "{sea} {land}");
    assert_eq!(is_water(&scene, [10.0, 10.0]), Some(false), "a pier above the water");
}

#[test]
fn an_area_in_metres_has_what_the_same_in_degrees_has() {
    let map = map();
    // Two of the four houses, and a part of the sea.
    let [west, south, east, north] = [0.8, 7.0, 7.0, 15.0].map(|thousandths| thousandths / 1e3);
    let x_m = |east: f64| 500_000.0 + east * METRES[0];
    let bbox_m = [x_m(west), south * METRES[1], x_m(east), north * METRES[1]];
    let read_area = |bbox_deg, bbox_m| {
        let mut options = ReadOptions { level_ground: true, ..ReadOptions::default() };
        (options.placing.bbox_deg, options.placing.bbox_m) = (bbox_deg, bbox_m);
        let (scene, report) = read_embedded(&[("coast.osm", map.as_bytes())], &options, &|_| {}).unwrap();
        let mut size = [0.0; 2];
        for (axis, size) in size.iter_mut().enumerate() {
            let corners = scene.triangles.iter().flat_map(|triangle| triangle.corners).map(|corner| corner[axis]);
            *size = corners.clone().fold(f32::MIN, f32::max) - corners.fold(f32::MAX, f32::min);
        }
        (report.sources[0].footprints, size)
    };
    let (houses, size) = read_area(Some([9.0 + west, south, 9.0 + east, north]), None);
    let (houses_in_metres, size_in_metres) = read_area(None, Some(bbox_m));
    assert_eq!((houses, houses_in_metres), (2, 2));
    for axis in 0..2 {
        assert!((size[axis] - size_in_metres[axis]).abs() < 5.0, "{size:?} {size_in_metres:?}");
    }
}

#[test]
fn level_ground_lies_only_around_what_is_painted() {
    let mut map = "<osm version=\"0.6\">".to_owned();
    // A road of 4.7 km between two houses, and their corners.
    let houses =
        [[0.0, 0.0], [0.2, 0.0], [0.2, 0.2], [0.0, 0.2], [29.8, 29.8], [30.0, 29.8], [30.0, 30.0], [29.8, 30.0]];
    for (number, [x, y]) in (1..).zip(houses) {
        write!(map, "<node id=\"{number}\" lat=\"{:.7}\" lon=\"{:.7}\"/>", y / 1e3, 9.0 + x / 1e3).unwrap();
    }
    for (corners, tag) in
        [([1, 2, 3, 4, 1].as_slice(), "building"), (&[5, 6, 7, 8, 5], "building"), (&[3, 5], "highway")]
    {
        let nodes: String = corners.iter().map(|number| format!("<nd ref=\"{number}\"/>")).collect();
        let value = if tag == "highway" { "residential" } else { "yes" };
        write!(map, "<way id=\"{}\">{nodes}<tag k=\"{tag}\" v=\"{value}\"/></way>", corners[0] + corners[1]).unwrap();
    }
    map += "</osm>";
    let read = ReadOptions { level_ground: true, ..ReadOptions::default() };
    let (scene, report) = read_embedded(&[("road.osm", map.as_bytes())], &read, &|_| {}).unwrap();
    assert_eq!(report.sources[0].painted, 1, "{report:?}");
    let ground = scene.triangles.iter().filter(|triangle| scene.objects[triangle.object as usize].kind.is_terrain());
    let ground: Vec<_> = ground.collect();
    let area_m2 = |[a, b, c]: [[f32; 3]; 3]| ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2.0;
    let all_m2: f32 = ground.iter().map(|triangle| area_m2(triangle.corners)).sum();
    // Of its bounds, 11 square kilometres: three squares of 128 m where it crosses from one column of them to the next.
    assert!((0.4e6..1.6e6).contains(&all_m2), "{all_m2}");
    let corners = ground.iter().flat_map(|triangle| triangle.corners);
    let [lowest, highest] = [f32::min, f32::max].map(|of| corners.clone().map(|corner| corner[0]).reduce(of).unwrap());
    assert!(highest - lowest > 3250.0, "from house to house: {lowest} {highest}");
}

#[test]
fn a_coast_and_painted_streets_are_the_same_in_steps() {
    let folder = TestFolder::new("steps-coast");
    let file = |name: &str, text: &str| -> PathBuf {
        let path = folder.path.join(name);
        fs::write(&path, text).unwrap();
        path
    };
    let inputs = vec![file("coast.osm", &map())];
    let streets = vec![file("streets.osm", &map().replace("residential", "primary"))];
    for (name, streets) in [("coast", Vec::new()), ("streets", streets)] {
        let mut options = BakeOptions { cell_m: 8.0, ..options(inputs.clone()) };
        options.read.streets = streets;
        let folder = folder.path.join(name);
        let plain = plain(&folder, &options);
        let work = folder.join("work");
        bake_in_steps(&work, &options, 1, 4).unwrap();
        assert_same(&files(&work.join("city")), &plain, name);
        // As high as the level land, at whose end a step would throw a shadow.
        let manifest: Manifest = serde_json::from_slice(&fs::read(work.join("city/city.json")).unwrap()).unwrap();
        assert!((manifest.ground_z_m - 1.6).abs() < 0.1, "{name}: {}", manifest.ground_z_m);
        // The sea goes on in the south, and beside the southern half.
        let sea = manifest.sea.unwrap();
        let [west, south, east, north] = sea.sides().unwrap();
        let is_sea = |parts: &[u8]| parts.iter().all(|steps| *steps > 0);
        let is_land = |parts: &[u8]| parts.iter().all(|steps| *steps == 0);
        assert!(is_sea(&south) && is_land(&north), "{name}: {sea:?}");
        for side in [west, east] {
            assert!(is_sea(&side[..24]) && is_land(&side[44..]), "{name}: {sea:?}");
        }
        assert!(sea.rgb[2] > sea.rgb[0], "{name}: {sea:?}");
    }
}
