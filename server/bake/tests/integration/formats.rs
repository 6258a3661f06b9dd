//! The same block of buildings in every format gives the same city. The files were made by `tests/tools/formats/make_block.py`
//! with other programs' writers.

use glam::DVec3;
use insula_bake::read::{FeatureKind, KindFilter, ReadOptions, ReadReport, read};
use insula_bake::scene::Scene;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Files of degrees have them to 1e-7, which is a centimetre.
const EXACT_M: f64 = 0.002;
const DEGREES_M: f64 = 0.02;

fn data(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/formats").join(name)
}

fn read_file(name: &str, options: &ReadOptions) -> (Scene, ReadReport) {
    read(&[data(name)], options, &|_| {}).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Volume, and world bounds `[min, max]`.
#[derive(Debug, Clone, Copy)]
struct Body {
    volume_m3: f64,
    bounds: [DVec3; 2],
}

/// The bodies of a scene by their objects' height, which tells them apart in every format.
fn bodies(scene: &Scene) -> Vec<Body> {
    let origin = DVec3::from_array(scene.origin);
    let mut found: BTreeMap<u32, Body> = BTreeMap::new();
    for triangle in &scene.triangles {
        let corners = triangle.corners.map(|c| DVec3::from_array(c.map(f64::from)));
        let body = found.entry(triangle.object).or_insert(Body { volume_m3: 0.0, bounds: [DVec3::MAX, DVec3::MIN] });
        body.volume_m3 += corners[0].dot(corners[1].cross(corners[2])) / 6.0;
        for corner in corners {
            body.bounds = [body.bounds[0].min(corner + origin), body.bounds[1].max(corner + origin)];
        }
    }
    let mut bodies: Vec<Body> = found.into_values().collect();
    bodies.sort_by(|a, b| a.bounds[1].z.total_cmp(&b.bounds[1].z));
    bodies
}

#[test]
fn a_block_is_the_same_in_every_format() {
    let formats = [
        ("block.geojson", EXACT_M),
        ("block.fgb", EXACT_M),
        ("block.gpkg.gz", EXACT_M),
        ("block.shp", EXACT_M),
        ("block.parquet", EXACT_M),
        ("block.csv", EXACT_M),
        ("block.gml", EXACT_M),
        ("block.city.json", EXACT_M),
        ("block.osm", DEGREES_M),
    ];
    // halls, court, tower: 2 x 30 x 20 x 9.25, (40 x 30 - 20 x 10) x 18.5, 12 x 12 x 64.
    let expected = [
        (11_100.0, [60.0, 0.0, 90.0, 50.0]),
        (18_500.0, [0.0, 0.0, 40.0, 30.0]),
        (9_216.0, [110.0, 10.0, 122.0, 22.0]),
    ];
    let mut options = ReadOptions::default();
    options.placing.crs = Some("EPSG:25832".to_owned());
    for (name, tolerance_m) in formats {
        let (scene, report) = read_file(name, &options);
        assert_eq!(report.crs.as_deref(), Some("EPSG:25832"), "{name}");
        let bodies = bodies(&scene);
        assert_eq!(bodies.len(), 3, "{name}: {:?}", report.sources[0]);
        for (body, (volume_m3, [x0, y0, x1, y1])) in bodies.iter().zip(expected) {
            assert!((body.volume_m3 / volume_m3 - 1.0).abs() < 0.1 * tolerance_m, "{name}: {body:?}");
            let [min, max] = body.bounds;
            let sides = [min.x - x0, min.y - y0, max.x - x1, max.y - y1];
            for (side, origin) in sides.into_iter().zip([500_000.0, 5_400_000.0, 500_000.0, 5_400_000.0]) {
                assert!((side - origin).abs() < tolerance_m, "{name}: {body:?}");
            }
            assert!(min.z.abs() < 1e-6, "{name}: {body:?}");
        }
        let source = &report.sources[0];
        assert_eq!(source.objects_by_kind[&FeatureKind::Building], 3, "{name}");
        let usage = if name.ends_with(".osm") { "building" } else { "usage" };
        let mut uses = source.attributes[usage].examples.clone();
        uses.sort();
        assert_eq!(uses, ["industrial", "office", "residential"], "{name}");
    }
}

#[test]
fn the_same_block_in_two_formats_is_one() {
    let inputs = ["block.gml", "block.fgb", "block.geojson"].map(data);
    let (scene, report) = read(&inputs, &ReadOptions::default(), &|_| {}).unwrap();
    assert_eq!((scene.objects.len(), report.duplicates()), (3, 6));
    assert!(report.sources[1].duplicates.first[0].contains("same "), "{:?}", report.sources[1].duplicates);
    assert_eq!(report.sources[1].unaccounted(), 0);
    let keep = ReadOptions { duplicates: insula_bake::read::DuplicateOption::KeepAll, ..ReadOptions::default() };
    assert_eq!(read(&inputs, &keep, &|_| {}).unwrap().0.objects.len(), 9);
}

#[test]
fn kinds_and_an_area_choose_objects() {
    let only_roads =
        ReadOptions { kinds: KindFilter { only: vec![FeatureKind::Road], skip: Vec::new() }, ..ReadOptions::default() };
    assert!(read(&[data("block.gml")], &only_roads, &|_| {}).is_err(), "nothing is left");
    // The tower alone: 110 m and more east of the origin, at 9 degrees east on the zone's central meridian.
    let mut options = ReadOptions::default();
    options.placing.bbox_deg = Some([9.0014, 48.0, 9.1, 49.0]);
    let (scene, report) = read_file("block.gml", &options);
    assert_eq!((scene.objects.len(), report.sources[0].outside_bbox), (1, 2));
    options.placing.bbox_deg = None;
    options.placing.bbox_m = Some([500_104.5, 5.2e6, 507_000.0, 5.5e6]);
    let (in_metres, report) = read_file("block.gml", &options);
    assert_eq!((in_metres.objects.len(), report.sources[0].outside_bbox), (1, 2));
    options.placing.bbox_m = Some([0.0, 0.0, 9.0, 9.0]);
    let error = read(&[data("block.gml")], &options, &|_| {}).unwrap_err().to_string();
    assert!(error.contains("in --bbox-metres 0,0,9,9; check"), "{error}");
    assert!((scene.triangles.iter().flat_map(|t| t.corners).map(|c| c[2]).fold(0.0, f32::max) - 64.0).abs() < 0.01);
}

/// Real buildings of Project PLATEAU, in degrees: see NOTICE.
#[test]
fn real_citygml_is_placed_and_textured() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/yokosuka");
    let (scene, report) = read(&[path], &ReadOptions::default(), &|_| {}).unwrap();
    let source = &report.sources[0];
    assert_eq!((report.crs.as_deref(), report.vertical_datum.as_deref()), (Some("EPSG:32654"), Some("EPSG:6695")));
    assert_eq!((source.found, source.objects, source.unaccounted()), (15, 14, 0));
    assert_eq!((source.objects_by_kind[&FeatureKind::BuildingPart], source.textures), (2, 3));
    assert_eq!((source.objects_by_level["1"], source.objects_by_level["2"]), (11, 3));
    assert_eq!(source.attributes["measuredHeight"].count, 14);
    assert!(source.colours.textured > 300, "{:?}", source.colours);
    // The corners of the file's envelope by pyproj (EPSG:6697 to EPSG:32654), whose boxes differ by the meridian's convergence.
    let [x, y, z] = scene.origin;
    assert!((x - 385_284.0).abs() < 5.0 && (y - 3_902_596.0).abs() < 5.0 && z == 2.0, "{x} {y} {z}");
}
