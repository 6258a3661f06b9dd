//! Whole OBJ files with libraries and textures.

use super::{embedded, ids, range};
use crate::read::texture::tests::png;
use crate::read::{InputError, ObjUpAxis, Palette, PaletteMode, ReadOptions, ReadReport, read_embedded};
use crate::scene::{ObjectKind, Scene};
use insula_source::problems::PART_NOT_READ;
use insula_source::testing::gzip;
use insula_test_support::rng::Rng;

fn read(files: &[(&str, &[u8])]) -> (Scene, ReadReport) {
    embedded(files).unwrap()
}

const SQUARE: &str = "mtllib a.mtl\nv 0 0 1\nv 2 0 1\nv 2 2 1\nv 0 2 1\nvt 0 0\nvt 2.5 0\nvt 2.5 1\nvt 0 1\nusemtl wall\n\
                      f 1/1 2/2 3/3 4/4\n";

#[test]
fn faces_have_colour_texture_and_texture_coordinates() {
    let image = png(2, 2, [1, 2, 3]);
    let mtl = b"newmtl wall\nKd 1 0.5 0\nmap_Kd wall.png\n";
    let files: [(&str, &[u8]); 3] = [("a.obj", SQUARE.as_bytes()), ("a.mtl", mtl), ("wall.png", &image)];
    let palette = Palette { mode: PaletteMode::Source, ..Palette::default() };
    let options = ReadOptions { palette, ..ReadOptions::default() };
    let (scene, report) = read_embedded(&files, &options, &|_| {}).unwrap();
    assert_eq!(scene.triangles.len(), 2);
    let material = &scene.materials[scene.triangles[0].material as usize];
    assert_eq!(material.rgb, [255, 128, 0]);
    assert_eq!(material.texture.as_ref().unwrap().rgb[3], [1, 2, 3]);
    for triangle in &scene.triangles {
        for (corner, uv) in triangle.corners.iter().zip(triangle.uv) {
            // Coordinates beyond 1 repeat the texture, so they are kept.
            assert_eq!(uv, [(corner[0] + 1.0) * 1.25, (corner[1] + 1.0) * 0.5]);
        }
    }
    assert_eq!((report.sources[0].textures, report.sources[0].problems.len()), (1, 0));
    assert_eq!(scene.objects[0].base_z_m, 0.0);
    assert_eq!(scene.origin[2], 1.0);
}

#[test]
fn alpha_makes_holes_and_is_named_if_it_is_in_an_image_of_its_own() {
    let mut image = std::io::Cursor::new(Vec::new());
    let hole = |x: u32, _: u32| image::Rgba([1, 2, 3, if x < 8 { 0 } else { 255 }]);
    image::RgbaImage::from_fn(16, 16, hole).write_to(&mut image, image::ImageFormat::Png).unwrap();
    let area = |alpha: &str| {
        let mtl = format!("newmtl wall\nmap_Kd wall.png\n{alpha}\n");
        let obj = SQUARE.replace("2.5", "1");
        let files: [(&str, &[u8]); 3] =
            [("a.obj", obj.as_bytes()), ("a.mtl", mtl.as_bytes()), ("wall.png", image.get_ref())];
        let (scene, report) = read(&files);
        let area = |triangle: &crate::scene::SceneTriangle| {
            let [a, b, c] = triangle.corners.map(glam::Vec3::from_array);
            (b - a).cross(c - a).length() / 2.0
        };
        let is_named = report.sources[0].problems.contains_key(PART_NOT_READ);
        (scene.triangles.iter().map(area).sum::<f32>().round(), is_named)
    };
    assert_eq!([area(""), area("map_d wall.png"), area("map_d other.png")], [(4.0, false), (2.0, false), (2.0, true)]);
}

#[test]
fn packed_file_finds_packed_libraries() {
    let image = png(2, 2, [1, 2, 3]);
    let (obj, mtl) = (gzip(SQUARE.as_bytes()), gzip(b"newmtl wall\nmap_Kd wall.png\n"));
    let (scene, _) = read(&[("t/a.obj.gz", &obj), ("t/a.mtl.gz", &mtl), ("t/wall.png", &image)]);
    let material = &scene.materials[scene.triangles[0].material as usize];
    assert!(material.texture.is_some());
    assert_eq!((material.rgb, scene.objects[0].id.as_str()), ([255; 3], "a"));
}

#[test]
fn missing_libraries_materials_and_textures_cost_only_the_appearance() {
    let (scene, report) = read(&[("a.obj", SQUARE.as_bytes())]);
    assert_eq!(scene.triangles.len(), 2);
    let problems = &report.sources[0].problems;
    assert!(problems["material library missing"].first[0].starts_with("a.mtl"));
    assert_eq!(problems["material missing"].first, ["wall"]);

    let mtl = b"newmtl wall\nKd 0.2 0.2 0.2\nmap_Kd none.jpg\n";
    let (scene, report) = read(&[("a.obj", SQUARE.as_bytes()), ("a.mtl", mtl)]);
    let material = &scene.materials[scene.triangles[0].material as usize];
    assert_eq!((material.rgb, &material.texture), ([51; 3], &None));
    assert_eq!(report.sources[0].problems["texture missing"].count, 1);
    assert_eq!(scene.triangles[0].uv, [[0.0; 2]; 3]);
}

#[test]
fn white_is_unknown_and_takes_the_colour_of_its_kind() {
    // A flat roof, a wall and a roof of 45 degrees.
    let faces = "mtllib a.mtl\nv 0 0 1\nv 2 0 1\nv 2 2 1\nv 0 0 3\nv 0 2 3\nusemtl white\nf 1 2 3\nf 1 2 4\nf 1 2 5\n";
    let colours = |mtl: &[u8]| {
        let (scene, report) = read(&[("a.obj", faces.as_bytes()), ("a.mtl", mtl)]);
        let colours: Vec<_> = scene.triangles.iter().map(|t| scene.materials[t.material as usize].rgb).collect();
        (colours, report.sources[0].colours)
    };
    let (of_white, counts) = colours(b"newmtl white\nKd 1 1 1\n");
    assert_eq!((counts.palette, counts.source), (3, 0));
    let [flat, wall, pitched] = of_white[..] else { panic!("{of_white:?}") };
    assert!(flat[0].abs_diff(flat[2]) < 10 && wall[0] < flat[0] && pitched[0] > pitched[2] + 40, "{of_white:?}");
    assert_eq!(colours(b"newmtl white\n").0, of_white);
    let (of_grey, counts) = colours(b"newmtl white\nKd .5 .5 .5\n");
    assert_eq!((of_grey, counts.source), (vec![[128; 3]; 3], 3));
}

#[test]
fn malformed_faces_and_coordinates_cost_only_themselves() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 0\nv 1e300 0 0\nv inf 0 0\nv 1\n\
                f 1 2 3\nf 1 2 99\nf 0 1 2\nf -9 1 2\nf 1 2 4\nf 1 2 5\nf 1 2 6\nf 1 2 7\nf 1 1 2\nf a b c\nf 1 2\nf\n\
                f 99999999999999999999 1 2\nf 1/9/9 2/9 3/9\n";
    let (scene, report) = read(&[("a.obj", text.as_bytes())]);
    assert_eq!(scene.triangles.len(), 2);
    let problems = &report.sources[0].problems;
    assert_eq!(problems["vertex index out of range"].count, 5);
    assert_eq!(problems["vertex index out of range"].first[0], "line 9: vertex index 99 out of range of 7");
    assert_eq!(problems["coordinate not a number or beyond 1e9 m"].count, 4);
    assert_eq!(problems["polygon without area"].first, ["line 16: 3 corners"]);
    assert_eq!(problems["face of less than three corners"].count, 2);
}

#[test]
fn objects_have_their_own_base_and_terrain_faces_up() {
    let text = "v 0 0 10\nv 1 0 10\nv 0 1 12\nv 50 0 20\nv 51 0 20\nv 50 1 25\no house\nf 1 2 3\no terrain\nf 4 6 5\n";
    let (scene, report) = read(&[("a.obj", text.as_bytes())]);
    let bases: Vec<_> = scene.objects.iter().map(|object| (object.id.as_str(), object.kind, object.base_z_m)).collect();
    assert_eq!(bases, [("house", ObjectKind::Building, 0.0), ("terrain", ObjectKind::Terrain, 10.0)]);
    assert_eq!(report.sources[0].terrain_triangles, 1);
    let [a, b, c] = scene.triangles[1].corners;
    assert!((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0, "terrain faces up");
}

#[test]
fn y_up_is_converted_and_orientation_is_kept() {
    // A concave vertical wall. With y up it lies in the plane z = 0 and faces south, towards positive z.
    let text = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\nf 1 2 3 4 5\n";
    let options = ReadOptions { obj_up: ObjUpAxis::Y, ..ReadOptions::default() };
    let (scene, _) = read_embedded(&[("a.obj", text.as_bytes())], &options, &|_| {}).unwrap();
    assert_eq!(scene.triangles.len(), 3);
    let faces = scene.triangles.iter().map(|triangle| triangle.corners.map(glam::Vec3::from_array));
    let facing: glam::Vec3 = faces.map(|[a, b, c]| (b - a).cross(c - a) * 0.5).sum();
    assert!((facing - glam::Vec3::new(0.0, -10.0, 0.0)).length() < 1e-5, "{facing}");
}

#[test]
fn random_bytes_never_panic() {
    let mut rng = Rng::new(1);
    let alphabet = b"vftgo 0123456789.-/\\\n\n eusemtl";
    for _ in 0..300 {
        let text: Vec<u8> = (0..200).map(|_| alphabet[rng.below(alphabet.len())]).collect();
        let result = embedded(&[("a.obj", &text)]);
        assert!(matches!(result, Ok(_) | Err(InputError::Empty { .. })));
    }
}

#[test]
fn every_object_is_kept_merged_or_skipped_with_its_reason() {
    let square = |i: u32| format!("f {} {} {}\n", 3 * i + 1, 3 * i + 2, 3 * i + 3);
    let corners: String = (0..4).map(|i| format!("v {0} 0 0\nv {0} 1 1\nv {1} 1 2\n", 9 * i, 9 * i + 2)).collect();
    let text = format!(
        "{corners}{}o a\n{}o empty\no b\n{}o a\n{}o broken\nf 1 2 99\no flat\nf 1 1 1\n",
        square(0),
        square(1),
        square(2),
        square(3)
    );
    let (scene, report) = read(&[("a.obj", text.as_bytes())]);
    let source = &report.sources[0];
    assert_eq!((ids(&scene), source.found, source.objects), (vec!["a", "a", "b"], 7, 3));
    assert_eq!(source.merged["name of an earlier object"].first, ["a"]);
    for (reason, name) in [("no face", "empty"), ("no usable face", "broken"), ("no surface with an area", "flat")] {
        assert_eq!(source.skipped[reason].first, [name]);
    }
    // One name for all faces: connected parts are objects, names without faces are still reported.
    let text = format!("{corners}g none\ng all\n{}{}g all\n{}", square(0), square(1), square(3));
    let (_, report) = read(&[("a.obj", text.as_bytes())]);
    let source = &report.sources[0];
    assert_eq!((source.found, source.objects, source.skipped["no face"].count), (4, 3, 1));
}

#[test]
fn meshes_in_degrees_are_placed_or_named() {
    // A house of 9 m, and a city that is one object: only the first tells enough of itself at once.
    let block = |side: f64| {
        let [w, s, e, n] = [4.36, 52.01, 4.36 + side, 52.01 + side];
        let corners = [[w, s, 0.0], [e, s, 0.0], [e, n, 0.0], [w, s, 9.0], [e, s, 9.0], [e, n, 9.0]];
        let vertices: String = corners.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
        format!("{vertices}f 4 5 6\nf 1 2 5 4\nf 2 3 6 5\n")
    };
    let (scene, report) = read(&[("house.obj", block(1e-4).as_bytes())]);
    let [low, high] = range(&scene, 0);
    assert!((6.0..8.0).contains(&(high - low)), "{low} to {high}");
    let warnings: Vec<String> = report.guess_warnings().collect();
    assert!(warnings[0].contains("4.36, 52.01 look like degrees and are taken as WGS 84"), "{warnings:?}");
    let (_, report) = read(&[("city.obj", block(0.05).as_bytes())]);
    let warnings: Vec<String> = report.guess_warnings().collect();
    assert!(warnings[0].contains("look like degrees and are taken as metres"), "{warnings:?}");
    let (_, report) = read(&[("metres.obj", block(10.0).as_bytes())]);
    assert_eq!(report.guess_warnings().count(), 0);
}

#[test]
fn a_byte_order_mark_costs_no_vertex() {
    let text = format!("\u{feff}{}", SQUARE.replace("mtllib a.mtl\n", ""));
    let (scene, report) = read(&[("a.obj", text.as_bytes())]);
    assert_eq!(scene.triangles.len(), 2);
    assert!(!report.sources[0].problems.contains_key("vertex index out of range"));
}
