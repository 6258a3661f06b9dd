//! Whole CityJSON documents.

use super::{embedded, ids, range, volume_m3};
use crate::read::texture::tests::png;
use crate::read::{DuplicateOption, InputError, ReadOptions, ReadReport, read_embedded};
use crate::scene::{ObjectKind, Scene};
use insula_source::affine::TRANSPOSED;
use insula_source::problems::{EITHER_ORDER, INTERIOR, MIRRORED, NO_CRS, NO_TRANSFORM, ZERO_HEIGHTS};

/// The corners of a cube of 2 m: below, then above, each counter-clockwise seen from above.
const CUBE: &str = "[0,0,0],[2,0,0],[2,2,0],[0,2,0],[0,0,2],[2,0,2],[2,2,2],[0,2,2]";
/// The cube's six faces, facing outwards: ground, roof, walls.
const FACES: &str = "[[0,3,2,1]],[[4,5,6,7]],[[0,1,5,4]],[[1,2,6,5]],[[2,3,7,6]],[[3,0,4,7]]";

fn document(objects: &str, more: &str) -> String {
    format!(r#"{{"type": "CityJSON", "version": "2.0", "CityObjects": {{{objects}}}, "vertices": [{CUBE}]{more}}}"#)
}

fn object(id: &str, geometry: &str) -> String {
    format!(r#""{id}": {{"type": "Building", "geometry": [{geometry}]}}"#)
}

fn solid(lod: &str) -> String {
    format!(r#"{{"type": "Solid", "lod": "{lod}", "boundaries": [[{FACES}]]}}"#)
}

/// Also those that stand in the same place.
fn all_objects() -> ReadOptions {
    ReadOptions { duplicates: DuplicateOption::KeepAll, ..ReadOptions::default() }
}

fn read(text: &str) -> (Scene, ReadReport) {
    read_embedded(&[("a.city.json", text.as_bytes())], &all_objects(), &|_| {}).unwrap()
}

#[test]
fn every_type_of_surface_geometry_faces_outwards() {
    let bodies = [
        ("MultiSurface", format!("[{FACES}]")),
        ("CompositeSurface", format!("[{FACES}]")),
        ("Solid", format!("[[{FACES}]]")),
        ("MultiSolid", format!("[[[{FACES}]]]")),
        ("CompositeSolid", format!("[[[{FACES}]]]")),
    ];
    for (kind, boundaries) in bodies {
        let geometry = format!(r#"{{"lod": "1", "boundaries": {boundaries}, "type": "{kind}"}}"#);
        let (scene, _) = read(&document(&object("a", &geometry), ""));
        assert_eq!(scene.triangles.len(), 12, "{kind}");
        assert!((volume_m3(&scene) - 8.0).abs() < 1e-4, "{kind}");
    }
    let geometry = format!(r#"{{"type": "MultiPoint", "boundaries": [0, 1]}}, {}"#, solid("1"));
    let (_, report) =
        read(&document(&object("a", &geometry.replace("MultiPoint\"", "MultiPoint\", \"lod\": \"1\"")), ""));
    assert_eq!(report.sources[0].problems["geometry without surfaces"].first, ["a: MultiPoint"]);
}

#[test]
fn inner_shells_and_holes_are_read() {
    let inner = r#"[[0,1,2,3]]"#;
    let geometry = format!(r#"{{"type": "Solid", "lod": 1, "boundaries": [[{FACES}], [{inner}]]}}"#);
    assert_eq!(read(&document(&object("a", &geometry), "")).0.triangles.len(), 14);

    let vertices = "[0,0,0],[4,0,0],[4,4,0],[0,4,0],[1,1,0],[1,2,0],[2,2,0],[2,1,0]";
    let holed = r#"{"type": "MultiSurface", "lod": "2", "boundaries": [[[0,1,2,3],[4,5,6,7],[0,1]]]}"#;
    let (scene, _) = read(&document(&object("a", holed), "").replace(CUBE, vertices));
    let area: f32 = scene
        .triangles
        .iter()
        .map(|triangle| {
            let [a, b, c] = triangle.corners.map(glam::Vec3::from_array);
            (b - a).cross(c - a).z / 2.0
        })
        .sum();
    assert!((area - 15.0).abs() < 1e-4, "{area}");
}

#[test]
fn only_the_best_level_is_read_and_no_footprint_under_a_body() {
    let foot = r#"{"type": "MultiSurface", "lod": "0", "boundaries": [[[0,1,2,3]]]}"#;
    let (scene, _) = read(&document(&object("a", &format!("{foot}, {}, {}", solid("1.3"), solid("2.2"))), ""));
    assert_eq!(scene.triangles.len(), 12);
    let whole = format!(r#""b": {{"type": "Building", "geometry": [{foot}], "children": ["p"]}}"#);
    let part = format!(r#""p": {{"type": "BuildingPart", "geometry": [{}], "parents": ["b"]}}"#, solid("2.2"));
    let (scene, report) = read(&document(&format!("{part}, {whole}"), ""));
    assert_eq!((scene.triangles.len(), scene.objects[0].id.as_str()), (12, "p"));
    assert_eq!((report.sources[0].coarser_left_out, report.sources[0].objects_by_type["Building"]), (1, 1));
    assert_eq!(read(&document(&whole, "")).0.triangles.len(), 2);
}

#[test]
fn rooms_are_left_out_with_a_warning_unless_they_are_all_that_there_is() {
    let room = format!(r#""r": {{"type": "BuildingRoom", "geometry": [{}], "parents": ["b"]}}"#, solid("2"));
    let (scene, report) = read(&document(&format!("{}, {room}", object("b", &solid("2"))), ""));
    assert_eq!((scene.triangles.len(), report.sources[0].objects), (12, 1));
    assert_eq!(report.sources[0].skipped[INTERIOR].first, ["r: BuildingRoom"]);
    let (scene, report) = read(&document(&room, ""));
    assert_eq!((scene.triangles.len(), report.skipped()), (12, 0));
}

#[test]
fn transform_is_applied_and_optional() {
    let more = r#", "transform": {"scale": [0.001, 0.001, 0.001], "translate": [85000, 446000, -3.5]}"#;
    let text = document(&object("a", &solid("1")), more).replace(CUBE, &CUBE.replace('2', "2000"));
    let (scene, _) = read(&text);
    assert_eq!(scene.origin, [85001.0, 446001.0, -4.0]);
    assert!((volume_m3(&scene) - 8.0).abs() < 1e-4);
    assert_eq!(scene.objects[0].base_z_m, 0.5);
    assert_eq!(read(&document(&object("a", &solid("1")), "")).0.origin, [1.0, 1.0, 0.0]);
}

#[test]
fn a_missing_transform_is_a_warning() {
    let has_warning = |corners: &str| {
        let (_, report) = read(&document(&object("a", &solid("1")), "").replace(CUBE, corners));
        report.guess_warnings().any(|text| text.contains(NO_TRANSFORM))
    };
    // The cube in millimetres.
    assert!(has_warning(&CUBE.replace('2', "2000")));
    assert!(!has_warning(&CUBE.replace('2', "2000.5")) && !has_warning(CUBE));
}

#[test]
fn a_transform_that_loses_bodies_is_an_error_or_a_warning() {
    let more = |scale: &str, name: &str| {
        format!(
            r#", "transform": {{"scale": {scale}, "translate": [11, 48, 0]}}, "metadata": {{"referenceSystem": "{name}"}}"#
        )
    };
    let text = |more: &str| document(&object("a", &solid("1")), more);
    let flat = text(&more("[0.001, 0.001, 0]", "EPSG:7415"));
    let error = embedded(&[("a.json", flat.as_bytes())]).unwrap_err().to_string();
    assert!(error.contains("scale is 0"), "{error}");
    let degrees = "https://www.opengis.net/def/crs/EPSG/0/4326";
    let is_inexact = |step: &str| {
        let (_, report) = read(&text(&more(&format!("[{step}, {step}, 1]"), degrees)));
        report.placing_warnings().any(|warning| warning.contains("whole steps"))
    };
    assert!(is_inexact("0.0001") && !is_inexact("0.00001"));
}

#[test]
fn templates_are_placed_by_matrix_and_anchor() {
    let templates =
        format!(r#", "geometry-templates": {{"vertices-templates": [{CUBE}], "templates": [{}]}}"#, solid("2"));
    let instance = r#"{"type": "GeometryInstance", "template": 0, "boundaries": [6],
        "transformationMatrix": [0,-1,0,10, 1,0,0,0, 0,0,3,0, 0,0,0,1]}"#;
    let (scene, _) = read(&document(&object("tree", instance), &templates));
    assert!((volume_m3(&scene) - 24.0).abs() < 1e-3);
    // Rotated by 90 degrees to x in [-2, 0], moved by 10 and by the anchor's (2, 2, 2).
    assert_eq!((range(&scene, 0)[0], scene.origin[2]), (10.0, 2.0));
    // At 2 degrees north and east, still in metres.
    let crs = r#", "metadata": {"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/4326"}"#;
    let in_degrees = read(&document(&object("tree", instance), &format!("{templates}{crs}"))).0;
    assert!((volume_m3(&in_degrees) / 24.0 - 1.0).abs() < 0.01, "{}", volume_m3(&in_degrees));

    let by_column =
        instance.replace("[0,-1,0,10, 1,0,0,0, 0,0,3,0, 0,0,0,1]", "[0,1,0,0, -1,0,0,0, 0,0,3,0, 10,0,0,1]");
    let (transposed, report) = read(&document(&object("tree", &by_column), &templates));
    assert_eq!(transposed.triangles, scene.triangles);
    assert_eq!(report.sources[0].problems[TRANSPOSED].first, ["tree"]);

    let bad = [
        instance.replace("\"template\": 0", "\"template\": 7"),
        instance.replace("10, ", ""),
        instance.replace("0,0,3,0", "0,0,0,0"),
        instance.replace("0,0,0,1]", "0,0,1,1]"),
    ];
    let malformed = "transformationMatrix malformed";
    for (bad, reason) in bad.iter().zip(["template out of range", malformed, malformed, malformed]) {
        let text = document(&format!("{}, {}", object("bad", bad), object("good", &solid("1"))), &templates);
        assert_eq!(read(&text).1.sources[0].skipped[reason].count, 1);
    }
}

/// Whether the texture of a cube that has the themes `autumn` (red) and `photo` (blue) is blue. `default` are further members of its
/// appearance.
fn is_photo(default: &str, is_sequence: bool) -> bool {
    let values = |texture: u32| {
        let face = format!("[[{texture}, 0, 1, 2, 3]]");
        format!(r#"{{"values": [[{}]]}}"#, [face.as_str(); 6].join(", "))
    };
    let texture = format!(r#", "texture": {{"autumn": {}, "photo": {}}}"#, values(0), values(1));
    let geometry = solid("2").replacen(r#""boundaries""#, &format!("{}, \"boundaries\"", &texture[2..]), 1);
    let images = r#""textures": [{"type": "PNG", "image": "red.png"}, {"type": "PNG", "image": "blue.png"}],
        "vertices-texture": [[0, 0], [1, 0], [1, 1], [0, 1]]"#
        .replace('\n', " ");
    let (red, blue) = (png(2, 2, [200, 0, 0]), png(2, 2, [0, 0, 200]));
    let text = if is_sequence {
        let header = document("", &format!(r#", "appearance": {{"textures": []{default}}}"#)).replace(CUBE, "");
        let feature = document(&object("a", &geometry), &format!(r#", "id": "a", "appearance": {{{images}}}"#));
        format!("{header}\n{}\n", feature.replace("\"CityJSON\"", "\"CityJSONFeature\"").replace('\n', " "))
    } else {
        document(&object("a", &geometry), &format!(r#", "appearance": {{{images}{default}}}"#))
    };
    let name = if is_sequence { "a.city.jsonl" } else { "a.city.json" };
    let files = [(name, text.as_bytes()), ("red.png", &red), ("blue.png", &blue)];
    let (scene, report) = read_embedded(&files, &all_objects(), &|_| {}).unwrap();
    assert!(report.sources[0].problems.keys().all(|kind| kind == NO_CRS), "{:?}", report.sources[0].problems);
    let texture = scene.materials[scene.triangles[0].material as usize].texture.clone().unwrap();
    texture.rgb[0][2] > texture.rgb[0][0]
}

#[test]
fn default_theme_of_textures_counts() {
    let photo = r#", "default-theme-texture": "photo""#;
    for (default, is_sequence, expected) in [
        ("", false, false),
        (photo, false, true),
        (photo, true, true),
        (r#", "default-theme-texture": "none""#, false, false),
        (r#", "default-theme-texture": 7"#, false, false),
    ] {
        assert_eq!(is_photo(default, is_sequence), expected, "{default}");
    }
}

#[test]
fn default_theme_of_materials_counts() {
    let material = r#""material": {"a": {"value": 0}, "b": {"value": 1}}, "boundaries""#;
    let geometry = solid("2").replacen(r#""boundaries""#, material, 1);
    let appearance = |default: &str| {
        format!(
            r#", "appearance": {{"materials": [{{"diffuseColor": [1, 0, 0]}}, {{"diffuseColor": [0, 0, 1]}}]{default}}}"#
        )
    };
    for (default, is_blue) in [("", false), (r#", "default-theme-material": "b""#, true)] {
        let [r, _, b] = colours(&read(&document(&object("a", &geometry), &appearance(default))).0)[0];
        assert_eq!(b > r, is_blue, "{r} {b}");
    }
}

fn colours(scene: &Scene) -> Vec<[u8; 3]> {
    scene.triangles.iter().step_by(2).map(|triangle| scene.materials[triangle.material as usize].rgb).collect()
}

#[test]
fn materials_apply_per_surface_or_whole_and_semantics_to_the_rest() {
    let semantics = r#""semantics": {"surfaces": [{"type": "RoofSurface"}, {"type": "WallSurface"}],
        "values": [[null, 0, 1, 1, 1, 77]]}"#;
    let materials = r#""material": {"z": {"value": 0}, "a": {"values": [[0, null, 1, null, 99, null]]}}"#;
    let geometry = format!(r#"{{"type": "Solid", "lod": "1", "boundaries": [[{FACES}]], {semantics}, {materials}}}"#);
    let appearance =
        r#", "appearance": {"materials": [{"name": "m", "diffuseColor": [0.6, 0.5, 0.4]}, {"name": "none"}]}"#;
    let (scene, report) = read(&document(&object("a", &geometry), appearance));
    let found = colours(&scene);
    let [wall, roof] = [found[2], found[1]];
    // The last face has no semantics: it is a wall by its normal.
    assert_eq!(found, [[153, 128, 102], roof, wall, wall, wall, wall]);
    assert!(roof != wall && roof != found[0]);
    let counts = report.sources[0].colours;
    assert_eq!((counts.source, counts.palette, counts.harmonised, counts.textured), (1, 5, 0, 0));
    assert_eq!(report.sources[0].problems["material index out of range"].count, 1);
    assert_eq!(report.sources[0].problems["semantic index out of range"].count, 1);

    let whole = geometry.replace(materials, r#""material": {"a": {"value": 0}}"#);
    assert_eq!(colours(&read(&document(&object("a", &whole), appearance)).0), [[153, 128, 102]; 6]);
    let water = document(&object("w", &solid("1")), "").replace("Building", "WaterBody");
    assert_eq!(colours(&read(&water).0), [[74, 129, 152]; 6]);
}

#[test]
fn water_windows_and_transparent_materials_are_reflective() {
    let is_reflective = |text: &str| {
        let (scene, _) = read(text);
        let of_face = |t: &[crate::scene::SceneTriangle]| scene.materials[t[0].material as usize].is_reflective;
        scene.triangles.chunks(2).map(of_face).collect::<Vec<bool>>()
    };
    let water = document(&object("w", &solid("1")), "").replace("Building", "WaterBody");
    assert_eq!(is_reflective(&water), [true; 6]);
    let semantics = r#""semantics": {"surfaces": [{"type": "Window"}], "values": [[null, null, 0]]}"#;
    let material = r#""material": {"a": {"values": [[null, null, null, 0, 1, 2]]}}"#;
    let geometry = format!(r#"{{"type": "Solid", "lod": "1", "boundaries": [[{FACES}]], {semantics}, {material}}}"#);
    let appearance = r#", "appearance": {"materials": [{"diffuseColor": [0.6, 0.5, 0.4], "transparency": 0.5},
        {"transparency": 0.0}, {"transparency": "odd"}]}"#;
    let house = document(&object("a", &geometry), appearance);
    assert_eq!(is_reflective(&house), [false, false, true, true, false, false]);
}

#[test]
fn parts_share_the_look_of_their_building_and_its_use_decides_the_walls() {
    let part = |id: &str, parent: &str| {
        object(id, &solid("2")).replace("\"Building\"", &format!("\"BuildingPart\", \"parents\": [\"{parent}\"]"))
    };
    let wall = |attributes: &str| {
        let whole = format!(r#""whole": {{"type": "Building", "attributes": {attributes}}}"#);
        let text = document(&format!("{whole}, {}, {}", part("a", "whole"), part("b", "whole")), "");
        let (scene, _) = read(&text);
        let found = colours(&scene);
        assert_eq!((scene.objects.len(), &found[..6]), (2, &found[6..]));
        found[2]
    };
    let plaster = wall("{}");
    assert_eq!(plaster, wall(r#"{"usage": "dwelling", "height": []}"#));
    assert_eq!(plaster, wall("[1]"));
    let brick = wall(r#"{"function": "Church"}"#);
    assert!(brick[0] > brick[2] + 40 && plaster[0] < plaster[2] + 40, "{brick:?} {plaster:?}");
}

#[test]
fn textures_have_coordinates_or_are_reported() {
    let image = png(2, 2, [7, 8, 9]);
    let values = "[[[0,0,1,2,3]]], [[[0,0,1,2,3]]], [[[null]]], [[[1,0,1,2,3]]], [[[0,0,1]]], [[[5,0,1,2,3]]]";
    let values = values.replace("[[[", "[[").replace("]]]", "]]");
    let geometry = format!(
        r#"{{"type": "Solid", "lod": "2", "boundaries": [[{FACES}]], "texture": {{"t": {{"values": [[{values}]]}}}}}}"#
    );
    let appearance = r#", "appearance": {"textures": [{"type": "PNG", "image": "pics/a.png"}, {"image": "none.png"}],
        "vertices-texture": [[0, 0], [1, 0], [1, 1], [0, 1]]}"#;
    let text = document(&object("a", &geometry), appearance);
    let files: [(&str, &[u8]); 2] = [("d/a.city.json", text.as_bytes()), ("d/pics/a.png", &image)];
    let (scene, report) = embedded(&files).unwrap();
    let textured = |i: usize| scene.materials[scene.triangles[i].material as usize].texture.is_some();
    assert_eq!([0, 2, 4, 6, 8, 10].map(textured), [true, true, false, false, false, false]);
    for triangle in &scene.triangles[2..4] {
        for (corner, uv) in triangle.corners.iter().zip(triangle.uv) {
            assert_eq!(uv, [(corner[0] + 1.0) / 2.0, (corner[1] + 1.0) / 2.0]);
        }
    }
    let source = &report.sources[0];
    assert_eq!(source.textures, 1);
    let kinds: Vec<_> = source.problems.keys().map(String::as_str).filter(|kind| *kind != NO_CRS).collect();
    assert_eq!(kinds, ["texture coordinates do not fit the ring", "texture index out of range", "texture missing"]);
}

#[test]
fn textures_repeat_or_end_as_their_mode_says() {
    let image = png(2, 2, [7, 8, 9]);
    let geometry = r#"{"type": "MultiSurface", "lod": "2", "boundaries": [[[4,5,6,7]]], "texture": {"t": {"values": [[[0,0,1,2,3]]]}}}"#;
    let highest = |mode: &str| {
        let appearance = format!(
            r#", "appearance": {{"textures": [{{"image": "a.png"{mode}}}], "vertices-texture": [[0, 0], [2, 0], [2, 1], [0, 1]]}}"#
        );
        let text = document(&object("a", geometry), &appearance);
        let (scene, _) = embedded(&[("a.city.json", text.as_bytes()), ("a.png", &image)]).unwrap();
        scene.triangles.iter().flat_map(|triangle| triangle.uv).map(|uv| uv[0]).fold(0.0, f32::max)
    };
    assert_eq!([highest(""), highest(r#", "wrapMode": "wrap""#), highest(r#", "wrapMode": 1"#)], [2.0; 3]);
    assert_eq!([highest(r#", "wrapMode": "clamp""#), highest(r#", "wrapMode": "none""#)], [1.0; 2]);
}

#[test]
fn relief_is_terrain_and_faces_up() {
    let relief = r#""t": {"type": "TINRelief", "geometry": [{"type": "CompositeSurface", "lod": 1, "boundaries":
        [[[4,5,6]], [[4,7,6]]]}]}"#;
    let (scene, report) = read(&document(relief, ""));
    assert_eq!(scene.objects[0].kind, ObjectKind::Terrain);
    assert_eq!(report.sources[0].terrain_triangles, 2);
    for triangle in &scene.triangles {
        let [a, b, c] = triangle.corners.map(glam::Vec3::from_array);
        assert!((b - a).cross(c - a).z > 0.0);
    }
}

#[test]
fn malformed_objects_are_skipped_with_a_reason() {
    let surface = |ring: &str| format!(r#"{{"type": "MultiSurface", "lod": "1", "boundaries": [[{ring}]]}}"#);
    let objects = [
        object("good", &solid("1")),
        object("index", &surface("[0, 1, 99]")),
        object("negative", &surface("[0, 1, -1]")),
        object("nan", &surface("[0, 1, 8]")),
        object("huge", &surface("[0, 1, 9]")),
        object("overflow", &surface("[0, 1, 10]")),
        object("flat", &surface("[0, 1, 1]")),
        object("two", &surface("[0, 1]")),
        object("shape", r#"{"type": "Solid", "lod": "1", "boundaries": [["x"]]}"#),
        object("shallow", r#"{"type": "Solid", "lod": "1", "boundaries": [[[0, 1, 2]]]}"#),
        r#""number": 7"#.to_owned(),
        r#""group": {"type": "CityObjectGroup"}"#.to_owned(),
    ];
    let text =
        document(&objects.join(", "), "").replace(CUBE, &format!("{CUBE}, [NaN, 0, 0], [1e300, 0, 0], [0, 1e999, 0]"));
    let (scene, report) = read(&text);
    assert_eq!(ids(&scene), ["good"]);
    let skipped = &report.sources[0].skipped;
    let expected = ["index: vertex index 99 out of range of 11", "negative: vertex index -1 out of range of 11"];
    assert_eq!(skipped["vertex index out of range"].first[..2], expected);
    assert_eq!(skipped["coordinate not a number or out of range"].count, 3);
    assert_eq!(skipped["malformed object"].count, 2);
    assert_eq!(report.skipped(), 10, "{skipped:?}");
}

#[test]
fn version_1_0_is_read_and_unknown_versions_are_refused() {
    let old = document(
        &object("a", &solid("1").replace("\"1\"", "1")),
        r#", "metadata": {"referenceSystem": "urn:ogc:def:crs:EPSG::7415"}"#,
    );
    assert_eq!(read(&old.replace("2.0", "1.0")).0.crs.as_deref(), Some("EPSG:7415"));
    let odd = document(&object("a", &solid("1")), r#", "metadata": [{"title": "T"}]"#);
    assert_eq!(read(&odd).1.sources[0].titles, ["T"]);
    let next = odd.replace("2.0", "3.0");
    let error = embedded(&[("a.json", next.as_bytes())]).unwrap_err();
    assert!(matches!(&error, InputError::Unsupported { what, .. } if what.contains("3.0")), "{error}");
}

const HEADER: &str = r#"{"type":"CityJSON","version":"2.0","transform":{"scale":[0.5,0.5,0.5],"translate":[100,0,0]},"CityObjects":{},"vertices":[]}"#;

fn feature(id: &str) -> String {
    let objects = object(id, &solid("1"));
    format!(r#"{{"type": "CityJSONFeature", "id": "{id}", "CityObjects": {{{objects}}}, "vertices": [{CUBE}]}}"#)
}

#[test]
fn sequence_skips_broken_lines() {
    let cut = &feature("cut")[..100];
    let odd = feature("odd").replace("[0,0,0]", "[NaN,0,0]");
    let lines = [HEADER, &feature("a"), cut, "", "nonsense", r#"{"type": "Feature"}"#, &odd, &feature("b")];
    let text = lines.join("\n");
    let (scene, report) = read_embedded(&[("a.city.jsonl", text.as_bytes())], &all_objects(), &|_| {}).unwrap();
    assert_eq!(ids(&scene), ["a", "b"]);
    assert!((volume_m3(&scene) - 2.0).abs() < 1e-4);
    assert_eq!(scene.origin[0], 100.0);
    let skipped = &report.sources[0].skipped;
    assert_eq!(skipped["broken line"].count, 2);
    assert!(skipped["broken line"].first[0].starts_with("line 3, column 1"), "{skipped:?}");
    assert_eq!(skipped["line is no feature"].count, 1);
    assert_eq!(skipped["coordinate not a number or out of range"].count, 1);
}

#[test]
fn sequence_needs_a_header_and_skips_lines_beyond_the_limit() {
    let fails = |text: &str| embedded(&[("a.jsonl", text.as_bytes())]).unwrap_err();
    assert!(matches!(fails(&feature("a")), InputError::Unsupported { .. }));
    assert!(matches!(fails(&HEADER[..40]), InputError::Json { line: 1, .. }));
    assert!(matches!(fails(HEADER), InputError::Empty { .. }));
    let long = feature("long").replace("\"id\"", &format!("\"pad\": \"{}\", \"id\"", "x".repeat(1000)));
    let text = [HEADER, &long, &feature("a")].join("\n");
    let options = ReadOptions { max_line_bytes: 1000, ..ReadOptions::default() };
    let (scene, report) = read_embedded(&[("a.jsonl", text.as_bytes())], &options, &|_| {}).unwrap();
    assert_eq!((scene.objects.len(), report.sources[0].skipped["line too long"].count), (1, 1));
}

#[test]
fn malformed_appearance_costs_only_the_colours() {
    let bad = r#", "appearance": {"materials": [{"diffuseColor": "red"}]}, "geometry-templates": 7"#;
    let (scene, report) = read(&document(&object("a", &solid("1")), bad));
    assert_eq!(scene.triangles.len(), 12);
    assert_eq!(report.sources[0].problems["malformed member"].count, 2);
}

#[test]
fn feature_may_have_its_own_appearance() {
    let coloured = solid("1").replace("\"lod\"", r#""material": {"m": {"value": 0}}, "lod""#);
    let own = r#""appearance": {"materials": [{"diffuseColor": [0.2, 0.3, 0.5]}]}, "vertices""#;
    let feature = feature("a").replace(&object("a", &solid("1")), &object("a", &coloured));
    let text = format!("{HEADER}\n{}", feature.replace("\"vertices\"", own));
    let (scene, _) = embedded(&[("a.jsonl", text.as_bytes())]).unwrap();
    assert_eq!(colours(&scene)[0], [51, 77, 128]);
}

#[test]
fn feature_may_have_its_own_transform() {
    let own = r#""transform": {"scale": [2, 2, 2], "translate": [0, 0, 0]}, "vertices""#;
    let feature = feature("a").replace("\"vertices\"", own);
    let read =
        |feature: &str| volume_m3(&embedded(&[("a.jsonl", format!("{HEADER}\n{feature}").as_bytes())]).unwrap().0);
    let plain = read(&feature.replace("[2, 2, 2]", "[1, 1, 1]"));
    assert!((read(&feature) / plain - 8.0).abs() < 0.01);
}

#[test]
fn degrees_without_a_system_are_taken_as_wgs84() {
    let corners = ["-122.5034,37.7294", "-122.5031,37.7294", "-122.5031,37.7296", "-122.5034,37.7296"];
    let at = |z: &str| corners.map(|corner| format!("[{corner},{z}]")).join(",");
    let text = document(&object("a", &solid("1")), "").replace(CUBE, &format!("{},{}", at("0"), at("8.23")));
    let (scene, report) = read(&text);
    assert_eq!((scene.crs.as_deref(), report.sources[0].crs.as_deref()), (Some("EPSG:32610"), Some("OGC:CRS84")));
    // 26 m x 22 m x 8.23 m.
    assert!((volume_m3(&scene) - 4825.0).abs() < 60.0, "{}", volume_m3(&scene));
    assert!(report.guess_warnings().any(|warning| warning.contains("taken as WGS 84")));
}

#[test]
fn orders_that_are_assumed_are_told_and_mirror_images_are_a_warning() {
    // Projected coordinates in either order are plausible in Japan.
    let metadata = r#", "metadata": {"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/6677"}"#;
    let problems = |cube: &str| {
        let text = document(&object("a", &solid("1")), metadata).replace(CUBE, &cube.replace('[', "[3549"));
        let (_, mut report) = read(&text);
        let is_warning = report.guess_warnings().any(|warning| warning.contains("--axis-order"));
        (report.sources.remove(0).problems, is_warning)
    };
    let (as_declared, is_warning) = problems(CUBE);
    assert!(as_declared.contains_key(EITHER_ORDER) && !is_warning, "{as_declared:?}");
    let north_first = "[0,0,0],[0,2,0],[2,2,0],[2,0,0],[0,0,2],[0,2,2],[2,2,2],[2,0,2]";
    let (mirrored, is_warning) = problems(north_first);
    assert!(mirrored.contains_key(MIRRORED) && is_warning, "{mirrored:?}");
}

#[test]
fn plans_with_a_height_are_extruded_and_others_are_named() {
    let text = |attributes: &str| {
        let surface = r#"{"type": "MultiSurface", "lod": "0", "boundaries": [[[0,1,2,3]]]}"#;
        let object = format!(r#""a": {{"type": "Building", "attributes": {{{attributes}}}, "geometry": [{surface}]}}"#);
        document(&object, "")
    };
    let plan = |attributes: &str| read(&text(attributes));
    let (scene, _) = plan(r#""measuredHeight": 9.0"#);
    assert!((volume_m3(&scene) - 36.0).abs() < 1e-3, "{}", volume_m3(&scene));
    let (scene, report) = plan(r#""year": 1900"#);
    assert_eq!(scene.triangles.len(), 2);
    assert!(report.sources[0].problems.keys().any(|kind| kind.contains("without a height, drawn flat")));
    let hidden = text(r#""measuredHeight": 9.0, "relatieveHoogteligging": -1"#);
    let error = embedded(&[("a.json", hidden.as_bytes())]).unwrap_err();
    assert!(error.to_string().contains("underground"), "{error}");
}

#[test]
fn outlines_of_roofs_are_no_second_building() {
    let height = r#""measuredHeight": 2.0"#;
    let building = |surfaces: &str, semantics: &str| {
        let geometry = format!(r#"{{"type": "MultiSurface", "lod": "0", "boundaries": [{surfaces}]{semantics}}}"#);
        let object = format!(r#""a": {{"type": "Building", "attributes": {{{height}}}, "geometry": [{geometry}]}}"#);
        read(&document(&object, "")).0
    };
    let roof = r#", "semantics": {"surfaces": [{"type": "RoofSurface"}], "values": [0]}"#;
    for (surfaces, semantics) in [("[[0,1,2,3]],[[4,5,6,7]]", ""), ("[[4,5,6,7]]", roof)] {
        let scene = building(surfaces, semantics);
        assert!((volume_m3(&scene) - 8.0).abs() < 1e-3, "{surfaces}: {}", volume_m3(&scene));
        let [low, high] = range(&scene, 2);
        assert!((high - low - 2.0).abs() < 1e-3, "{surfaces}: {low} to {high}");
    }
}

#[test]
fn each_header_of_sequences_in_one_file_counts() {
    let header = |shift: u32| {
        let transform = format!(r#"{{"scale": [1, 1, 1], "translate": [{shift}, 0, 0]}}"#);
        format!(
            r#"{{"type": "CityJSON", "version": "2.0", "transform": {transform}, "CityObjects": {{}}, "vertices": []}}"#
        )
    };
    let text = [header(0), feature("a"), header(100), feature("b")].join("\n");
    let (scene, report) = embedded(&[("a.city.jsonl", text.as_bytes())]).unwrap();
    assert_eq!(scene.objects.len(), 2, "{:?}", report.sources[0].skipped);
    let [west, east] = range(&scene, 0);
    assert!((east - west - 102.0).abs() < 1e-3, "{west} to {east}");
}

#[test]
fn a_header_does_not_have_the_system_of_the_one_before() {
    let header = |x: u32, metadata: &str| {
        let transform = format!(r#"{{"scale": [1, 1, 1], "translate": [{x}, 446000, 0]}}"#);
        format!(
            r#"{{"type": "CityJSON", "version": "2.0"{metadata}, "transform": {transform}, "CityObjects": {{}}, "vertices": []}}"#
        )
    };
    let named = r#", "metadata": {"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/7415"}"#;
    let text = [header(85_000, named), feature("a"), header(85_100, ""), feature("b")].join("\n");
    let (scene, report) = embedded(&[("a.city.jsonl", text.as_bytes())]).unwrap();
    let guess = &report.sources[0].problems[NO_CRS];
    assert_eq!((scene.objects.len(), guess.count), (2, 1));
    assert!(guess.first[0].contains("EPSG:28992, that of the city"), "{:?}", guess.first);
}

#[test]
fn roads_at_zero_lie_on_the_ground() {
    let more = r#", "transform": {"scale": [1, 1, 1], "translate": [85000, 446000, 0]},
        "metadata": {"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/7415"}"#;
    let road = |id: &str, face: &str| {
        let geometry = format!(r#"{{"type": "MultiSurface", "lod": "1", "boundaries": [[{face}]]}}"#);
        object(id, &geometry).replace("Building", "Road")
    };
    let text = document(&format!("{}, {}", road("r", "[0,1,2,3]"), road("bridge", "[4,5,6,7]")), more);
    let options = ReadOptions { level_ground: true, ..all_objects() };
    let (_, report) = read_embedded(&[("a.city.json", text.as_bytes())], &options, &|_| {}).unwrap();
    let source = &report.sources[0];
    assert_eq!((source.painted, &source.problems[ZERO_HEIGHTS].first[..]), (1, &["r".to_owned()][..]));
}
