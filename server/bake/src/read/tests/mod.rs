//! Several sources and formats together, from memory and from disk.

mod bucket;
mod cityjson;
mod elevation;
mod ended;
mod geojson;
mod obj;
mod overture;

use super::*;
use insula_source::testing::{gzip, utf16};
use insula_test_support::folder::TestFolder;
use std::cell::RefCell;
use std::fs;

/// One square roof at z = 3.
fn city(epsg: &str) -> String {
    let metadata = if epsg.is_empty() { String::new() } else { format!(r#""referenceSystem": "{epsg}""#) };
    format!(
        r#"{{"type": "CityJSON", "version": "1.1", "metadata": {{{metadata}}}, "CityObjects": {{"house": {{
            "type": "Building", "geometry": [{{"type": "MultiSurface", "lod": "1", "boundaries": [[[0, 1, 2, 3]]]}}]
        }}}}, "vertices": [[0, 0, 3], [1, 0, 3], [1, 1, 3], [0, 1, 3]]}}"#
    )
}

const OBJ: &str = "v 5 0 0\nv 6 0 0\nv 6 1 0\nf 1 2 3\n";

fn embedded(files: &[(&str, &[u8])]) -> Result<(Scene, ReadReport), InputError> {
    read_embedded(files, &ReadOptions::default(), &|_| {})
}

/// Names of the objects.
fn ids(scene: &Scene) -> Vec<&str> {
    scene.objects.iter().map(|object| object.id.as_str()).collect()
}

/// Lowest and highest world coordinate of all corners along an axis.
fn range(scene: &Scene, axis: usize) -> [f64; 2] {
    let all = || scene.triangles.iter().flat_map(|triangle| triangle.corners).map(|corner| f64::from(corner[axis]));
    [all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max)].map(|c| c + scene.origin[axis])
}

/// Volume by the divergence theorem. It is correct only if the surface is closed and every face turns outwards.
fn volume_m3(scene: &Scene) -> f64 {
    let volume = |corners: [[f32; 3]; 3]| {
        let [a, b, c] = corners.map(|corner| glam::DVec3::from_array(corner.map(f64::from)));
        a.dot(b.cross(c)) / 6.0
    };
    scene.triangles.iter().map(|triangle| volume(triangle.corners)).sum()
}

fn folder(test: &str, files: &[(&str, &[u8])]) -> TestFolder {
    let folder = TestFolder::new(&format!("read-{test}"));
    for (name, bytes) in files {
        fs::write(folder.path.join(name), bytes).unwrap();
    }
    folder
}

#[test]
fn several_sources_become_one_scene() {
    let city = city("EPSG:7415");
    let (scene, report) = embedded(&[("b.obj", OBJ.as_bytes()), ("a.city.json", city.as_bytes())]).unwrap();
    assert_eq!((scene.objects.len(), scene.triangles.len()), (2, 3));
    assert_eq!(scene.crs.as_deref(), Some("EPSG:7415"));
    assert_eq!(scene.origin, [3.0, 0.0, 0.0]);
    assert_eq!(scene.objects[0].base_z_m, 3.0);
    let formats: Vec<_> = report.sources.iter().map(|source| (source.format, source.objects)).collect();
    assert_eq!(formats, [(SourceFormat::CityJson, 1), (SourceFormat::Obj, 1)]);
    assert_eq!(report.skipped(), 0);
}

#[test]
fn a_proposal_removes_what_it_names_and_adds_what_is_no_duplicate() {
    const TOWN: &str = "v 5 0 0\nv 6 0 0\nv 6 1 0\nv 8 0 0\nv 9 0 0\nv 9 1 0\no a\nf 1 2 3\no b\nf 4 5 6\n";
    let again = format!("o a\n{OBJ}");
    let folder = folder("proposal", &[("again.obj", again.as_bytes()), ("block.geojson", b"{}")]);
    let add = |name: &str, content| AddedInput { file: folder.path.join(name), content };
    let block = vec![[[2.0, 0.0, 1.0], [3.0, 0.0, 1.0], [2.0, 1.0, 5.0]]];
    let named = |bounds_m| RemovedObject { identifier: "a".to_owned(), bounds_m };
    let read = |removed| {
        // It lies at height 0, so it has none of its own.
        let model = add("again.obj", AddedContent::Model { base_m: 7.0 });
        let added = vec![model, add("block.geojson", AddedContent::Block(block.clone()))];
        let proposal = ProposalOptions { title: "Plan".to_owned(), added, removed, ..ProposalOptions::default() };
        let options = ReadOptions { proposal: Some(proposal), ..ReadOptions::default() };
        read_embedded(&[("town.obj", TOWN.as_bytes())], &options, &|_| {}).unwrap()
    };
    let (scene, report) = read(vec![named([[5.0, 0.0], [6.0, 1.0]])]);
    let heights = |scene: &Scene| -> Vec<_> {
        let height_m = |base_z_m: f32| scene.origin[2] + f64::from(base_z_m);
        scene.objects.iter().map(|object| (object.id.clone(), height_m(object.base_z_m))).collect()
    };
    let of = |id: &str, height_m: f64| (id.to_owned(), height_m);
    assert_eq!(heights(&scene), [of("b", 0.0), of("a", 7.0), of("block.geojson", 1.0)]);
    let counts = report.proposal.map(|proposal| (proposal.removed, proposal.added));
    assert_eq!((counts, report.objects), (Some((1, 2)), 3));
    // Another object of the name stays.
    let (scene, report) = read(vec![named([[50.0, 0.0], [60.0, 1.0]])]);
    assert_eq!((scene.objects.len(), report.proposal.map(|proposal| proposal.removed)), (4, Some(0)));
}

#[test]
fn reading_is_deterministic() {
    let city = city("");
    let files: [(&str, &[u8]); 2] = [("a.json", city.as_bytes()), ("b.obj", OBJ.as_bytes())];
    let ((first, _), (second, _)) = (embedded(&files).unwrap(), embedded(&files).unwrap());
    assert_eq!(first.triangles, second.triangles);
    assert_eq!((first.origin, first.objects), (second.origin, second.objects));
}

#[test]
fn packed_and_plain_files_give_the_same_scene() {
    let city = city("EPSG:7415");
    let seq = sequence();
    let plain: [(&str, &[u8]); 3] =
        [("a.json", city.as_bytes()), ("b.obj", OBJ.as_bytes()), ("c.jsonl", seq.as_bytes())];
    let packed = plain.map(|(name, bytes)| (format!("{name}.gz"), gzip(bytes)));
    let packed: Vec<(&str, &[u8])> = packed.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())).collect();
    let ((plain, _), (packed, report)) = (embedded(&plain).unwrap(), embedded(&packed).unwrap());
    assert_eq!(plain.triangles, packed.triangles);
    assert_eq!(report.sources[2].format, SourceFormat::CityJsonSeq);
}

#[test]
fn texts_of_windows_are_read_as_those_in_utf8() {
    let (city, seq) = (city("EPSG:25832"), sequence());
    let square = "11.6 48.2, 11.6001 48.2, 11.6001 48.2001, 11.6 48.2";
    let geojson = r#"{"type": "Feature", "properties": {"name": "Höhe"}, "geometry": {"type": "Polygon", "coordinates":
        [[[11.6, 48.2], [11.6001, 48.2], [11.6001, 48.2001], [11.6, 48.2]]]}}"#;
    let csv = format!("name\thoehe\tgeom\nHöhe\t12\tPOLYGON (({square}))\n");
    for (name, text) in [("a.json", &*city), ("a.jsonl", &seq), ("a.obj", OBJ), ("a.geojson", geojson), ("a.csv", &csv)]
    {
        let (plain, _) = embedded(&[(name, text.as_bytes())]).unwrap();
        for mark in ["\u{feff}", ""] {
            for is_big_endian in [false, true] {
                let bytes = utf16(&format!("{mark}{text}"), is_big_endian);
                let (found, _) = embedded(&[(name, &bytes)]).unwrap();
                assert_eq!(found.triangles, plain.triangles, "{name}, mark {mark:?}, big endian {is_big_endian}");
            }
        }
    }
}

#[test]
fn truncated_or_oversized_packed_file_is_an_error() {
    let packed = gzip(OBJ.repeat(1000).as_bytes());
    let error = embedded(&[("a.obj.gz", &packed[..packed.len() - 9])]).unwrap_err();
    assert!(error.to_string().starts_with("a.obj.gz: cannot be read"), "{error}");
    let oversized = gzip(&vec![b' '; 1 << 20]);
    let options = ReadOptions { max_source_bytes: 1 << 16, ..ReadOptions::default() };
    for name in ["a.json.gz", "a.obj.gz"] {
        let error = read_embedded(&[(name, &oversized)], &options, &|_| {}).unwrap_err();
        assert!(matches!(error, InputError::TooLarge { limit: 65536, .. }), "{error}");
    }
}

fn sequence() -> String {
    let feature = r#"{"type": "CityJSONFeature", "id": "f", "CityObjects": {"f": {"type": "Building", "geometry":
        [{"type": "MultiSurface", "lod": "1", "boundaries": [[[0, 1, 2]]]}]}}, "vertices": [[0, 0, 0], [9, 0, 0], [0, 9, 0]]}"#;
    let header = r#"{"type": "CityJSON", "version": "2.0", "CityObjects": {}, "vertices": [],
        "transform": {"scale": [1, 1, 1], "translate": [0, 0, 0]}}"#;
    format!("{}\n{}\n", header.replace('\n', ""), feature.replace('\n', ""))
}

#[test]
fn sequence_is_recognised_by_content() {
    let (scene, report) = embedded(&[("a.json", sequence().as_bytes())]).unwrap();
    assert_eq!((report.sources[0].format, scene.triangles.len()), (SourceFormat::CityJsonSeq, 1));
}

/// `pyproj.Transformer.from_crs("OGC:CRS84", "EPSG:28992", always_xy=True).transform(4.3573, 52.0110)`.
const DELFT: [f64; 2] = [84_293.499, 447_460.720];

#[test]
fn coordinate_systems_are_brought_together() {
    // A square of 10 m in Delft, and one of 0.0001 degrees a few metres to the east.
    let square = |crs: &str, [x, y]: [f64; 2], side: f64| {
        let (x1, y1) = (x + side, y + side);
        format!(
            r#"{{"type": "FeatureCollection", "crs": {{"type": "name", "properties": {{"name": "{crs}"}}}}, "features": [
                {{"type": "Feature", "id": "{crs}", "properties": {{"height": 10}}, "geometry": {{"type": "Polygon",
                "coordinates": [[[{x}, {y}], [{x1}, {y}], [{x1}, {y1}], [{x}, {y1}], [{x}, {y}]]]}}}}]}}"#
        )
    };
    let dutch = square("EPSG:28992", [84_500.0, 447_500.0], 10.0);
    let degrees = square("OGC:CRS84", [4.3573, 52.0110], 0.0001);
    let unknown = square("EPSG:999999", [1.0, 2.0], 3.0);
    // The source in degrees comes first, but the projected one decides.
    let files = [("a.geojson", degrees.as_bytes()), ("b.geojson", dutch.as_bytes())];
    let (scene, report) = embedded(&files).unwrap();
    assert_eq!((scene.crs.as_deref(), scene.objects.len()), (Some("EPSG:28992"), 2));
    assert_eq!(
        report.sources.iter().map(|source| source.path.as_str()).collect::<Vec<_>>(),
        ["b.geojson", "a.geojson"]
    );
    let corner = |object: u32| {
        let corners = scene.triangles.iter().filter(|t| t.object == object).flat_map(|t| t.corners);
        let low = corners.fold([f32::MAX; 2], |low, c| [low[0].min(c[0]), low[1].min(c[1])]);
        [0, 1].map(|axis| scene.origin[axis] + f64::from(low[axis]))
    };
    assert!((corner(0)[0] - 84_500.0).abs() < 0.01, "{:?}", corner(0));
    let [x, y] = corner(1);
    assert!((x - DELFT[0]).abs() < 0.5 && (y - DELFT[1]).abs() < 0.5, "{x} {y}");
    let error = embedded(&[("a.geojson", unknown.as_bytes())]).unwrap_err();
    assert!(error.to_string().contains("999999"), "{error}");
}

#[test]
fn truncated_json_names_line_and_column() {
    let city = city("");
    let cut = city.find("MultiSurface").unwrap();
    let error = embedded(&[("a.json", &city.as_bytes()[..cut])]).unwrap_err();
    let InputError::Json { line, column, .. } = &error else { panic!("{error}") };
    assert_eq!(*line, 2);
    assert!(*column > 10, "{column}");
    assert!(!error.to_string().contains('\n'), "{error}");
}

#[test]
fn every_truncation_is_an_error() {
    for text in [city("EPSG:7415"), sequence()] {
        for end in 0..text.trim_end().len() {
            assert!(embedded(&[("a.json", &text.as_bytes()[..end])]).is_err(), "cut at {end}");
        }
    }
}

#[test]
fn empty_city_is_an_error() {
    let nothing = r#"{"type": "CityJSON", "version": "2.0", "CityObjects": {}, "vertices": []}"#;
    for (name, text) in [("a.json", nothing), ("a.obj", "v 0 0 0\n"), ("a.obj", "")] {
        let error = embedded(&[(name, text.as_bytes())]).unwrap_err();
        assert!(matches!(error, InputError::Empty { .. }), "{error}");
    }
    let mut elsewhere = ReadOptions::default();
    elsewhere.placing.bbox_deg = Some([1.0, 2.0, 3.0, 4.5]);
    let text = city("EPSG:7415");
    let error = read_embedded(&[("a.json", text.as_bytes())], &elsewhere, &|_| {}).unwrap_err().to_string();
    assert!(error.contains("not one triangle was read in --bbox 1,2,3,4.5; check"), "{error}");
    let bad = city("").replace("[0, 1, 2, 3]", "[0, 1, 2, 99]");
    let error = embedded(&[("a.json", bad.as_bytes())]).unwrap_err().to_string();
    assert!(error.contains("vertex index 99 out of range of 4"), "{error}");
    assert!(matches!(embedded(&[]), Err(InputError::NoSource { .. })));
}

#[test]
fn folder_is_read_by_name_and_other_json_ignored() {
    let city = city("");
    let other = r#"{"type": "Topology", "objects": {}}"#;
    let files: [(&str, &[u8]); 5] = [
        ("b.json", city.as_bytes()),
        ("a.obj", OBJ.as_bytes()),
        ("c.json", other.as_bytes()),
        ("list.json", b"[1, 2]"),
        ("readme.txt", b"x"),
    ];
    let folder = folder("folder", &files);
    let inputs = [folder.path.clone(), folder.path.join("a.obj")];
    let seen = RefCell::new(Vec::new());
    let (_, report) = read(&inputs, &ReadOptions::default(), &|progress| seen.borrow_mut().push(progress)).unwrap();
    let formats: Vec<_> = report.sources.iter().map(|source| source.format).collect();
    assert_eq!(formats, [SourceFormat::Obj, SourceFormat::CityJson]);
    assert_eq!(report.ignored.len(), 2);
    let seen = seen.into_inner();
    assert!(seen.windows(2).all(|pair| pair[0].bytes_done <= pair[1].bytes_done));
    assert!(seen.iter().all(|progress| progress.bytes_total == seen[0].bytes_total));
    assert_eq!(seen.last().map(|last| last.bytes_done), Some(seen[0].bytes_total));
    let error = read(&[folder.path.join("c.json")], &ReadOptions::default(), &|_| {}).unwrap_err();
    assert!(error.to_string().contains("its type is \"Topology\""), "{error}");
}

#[test]
fn a_city_in_a_folder_whose_coordinates_contradict_its_system_is_no_foreign_file() {
    let (good, bad) = (city("EPSG:7415"), city("EPSG:4326").replace("[0, 0, 3]", "[85000, 446000, 3]"));
    let folder = folder("contradiction", &[("a.json", good.as_bytes()), ("b.json", bad.as_bytes())]);
    let error = read(std::slice::from_ref(&folder.path), &ReadOptions::default(), &|_| {}).unwrap_err();
    assert!(error.to_string().contains("b.json: its coordinate system EPSG:4326"), "{error}");
    let options = ReadOptions { skip_bad_inputs: true, ..ReadOptions::default() };
    let (_, report) = read(std::slice::from_ref(&folder.path), &options, &|_| {}).unwrap();
    assert_eq!((report.bad_inputs.len(), report.ignored.len()), (1, 0));
}

#[test]
fn missing_empty_and_foreign_inputs_are_errors() {
    let folder = folder("foreign", &[("a.txt", b"x"), ("b.json", b"[1]")]);
    let fails = |name: &str| read(&[folder.path.join(name)], &ReadOptions::default(), &|_| {}).unwrap_err();
    assert!(matches!(fails("none.json"), InputError::Io { .. }));
    assert!(matches!(fails("a.txt"), InputError::UnknownFormat { .. }));
    assert!(matches!(fails("b.json"), InputError::UnknownFormat { .. }));
    fs::remove_file(folder.path.join("b.json")).unwrap();
    assert!(matches!(fails(""), InputError::NoSource { .. }));
}

#[test]
fn alpha_cuts_holes_into_meshes() {
    // A fence: the upper half of its texture is a hole.
    let corners = [[0.0f32, 0.0, 0.0], [8.0, 0.0, 0.0], [0.0, 4.0, 0.0], [8.0, 4.0, 0.0]];
    let uv = [[0.0f32, 1.0], [1.0, 1.0], [0.0, 0.0], [1.0, 0.0]];
    let numbers = corners.as_flattened().iter().chain(uv.as_flattened());
    let buffer: Vec<u8> = numbers.flat_map(|number| number.to_le_bytes()).collect();
    let texels = image::RgbaImage::from_fn(16, 16, |_, y| image::Rgba([200, 10, 10, if y < 8 { 0 } else { 255 }]));
    let mut png = std::io::Cursor::new(Vec::new());
    texels.write_to(&mut png, image::ImageFormat::Png).unwrap();
    let document = |material: &str| {
        format!(
            r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}], "nodes": [{{"mesh": 0}}],
            "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0, "TEXCOORD_0": 1}}, "mode": 5, "material": 0}}]}}],
            "materials": [{{"pbrMetallicRoughness": {{"baseColorTexture": {{"index": 0}}}}, {material}}}],
            "textures": [{{"source": 0}}], "images": [{{"uri": "fence.png"}}],
            "buffers": [{{"uri": "fence.bin", "byteLength": 80}}],
            "bufferViews": [{{"buffer": 0, "byteLength": 48}}, {{"buffer": 0, "byteOffset": 48, "byteLength": 32}}],
            "accessors": [
                {{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [8, 4, 0]}},
                {{"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"}}]}}"#
        )
    };
    let top_and_count = |material: &str| {
        let json = document(material);
        let files: [(&str, &[u8]); 3] =
            [("fence.gltf", json.as_bytes()), ("fence.bin", &buffer), ("fence.png", png.get_ref())];
        let folder = folder("alpha", &files);
        let options = ReadOptions { obj_up: ObjUpAxis::Y, ..ReadOptions::default() };
        let (scene, report) = read(&[folder.path.join("fence.gltf")], &options, &|_| {}).unwrap();
        assert_eq!(report.sources[0].textures, 1);
        let heights = scene.triangles.iter().flat_map(|triangle| triangle.corners.map(|corner| corner[2]));
        (heights.fold(f32::NEG_INFINITY, f32::max), scene.triangles.len())
    };
    let (top, count) = top_and_count(r#""alphaMode": "OPAQUE""#);
    assert!((top - 4.0).abs() < 1e-4 && count == 2, "{top} {count}");
    let (top, count) = top_and_count(r#""alphaMode": "MASK""#);
    assert!((top - 2.0).abs() < 0.3 && count < 400, "{top} {count}");
    let (top, _) = top_and_count(r#""alphaMode": "BLEND""#);
    assert!((top - 2.0).abs() < 0.3, "coverage of less than a half is a hole: {top}");
}

#[test]
fn a_folder_without_a_city_is_told_by_a_file_in_it() {
    let folder = folder("no-city", &[("city.json", br#"{"name": "baked", "version": "1"}"#)]);
    let error = read(std::slice::from_ref(&folder.path), &ReadOptions::default(), &|_| {}).unwrap_err().to_string();
    assert!(error.contains("city.json: contains no city file"), "{error}");
}

#[test]
fn files_with_the_content_of_other_formats_are_told() {
    for (name, text, expected) in [
        ("a.geojson", "<!DOCTYPE html><html>", "a web page: not read"),
        ("a.gml", "<html><body>", "a web page: not read"),
        ("a.tif", "version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
        ("a.json", r#"{"elements": [{"type": "way", "nodes": [1]}]}"#, "[out:xml]"),
        ("a.json", r#"{"type": "Topology", "arcs": []}"#, "ogr2ogr -f GPKG"),
        ("a.geojson", "{", "the file is damaged or cut short"),
    ] {
        let error = embedded(&[(name, text.as_bytes())]).unwrap_err().to_string();
        assert!(error.starts_with(name) && error.contains(expected), "{error}");
    }
}

/// An OBJ object of one triangle beside the others, with a material if it has a texture.
fn part(number: usize, has_texture: bool) -> String {
    let (x, material) = (2 * number, if has_texture { format!("usemtl m{number}\n") } else { String::new() });
    let [a, b, c] = [1, 2, 3].map(|corner| 3 * number + corner);
    let end = x + 1;
    format!(
        "o part{number}\n{material}v {x} 0 0\nv {end} 0 0\nv {end} 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf {a}/{a} {b}/{b} {c}/{c}\n"
    )
}

#[test]
fn a_scene_that_takes_too_much_memory_is_refused() {
    let obj: String = (0..2000).map(|number| part(number, false)).collect();
    let read = |max_held_bytes: u64| {
        let options = ReadOptions { max_held_bytes, ..ReadOptions::default() };
        read_embedded(&[("many.obj", obj.as_bytes())], &options, &|_| {})
    };
    let error = read(64_000).unwrap_err().to_string();
    assert!(error.contains("many.obj") && error.contains("64.0 kB of memory"), "{error}");
    assert_eq!(read(1_000_000).unwrap().0.triangles.len(), 2000);
}

#[test]
fn pictures_of_a_scene_in_memory_have_a_limit() {
    // Each of half a megabyte when it is unpacked.
    let pictures: Vec<_> = (0..20).map(|i| (format!("{i}.png"), texture::tests::png(400, 400, [10 * i; 3]))).collect();
    let materials: String = (0..20).map(|i| format!("newmtl m{i}\nmap_Kd {i}.png\n")).collect();
    let parts: String = (0..20).map(|number| part(number, true)).collect();
    let obj = format!("mtllib a.mtl\n{parts}");
    let mut files: Vec<(&str, &[u8])> = vec![("a.obj", obj.as_bytes()), ("a.mtl", materials.as_bytes())];
    files.extend(pictures.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())));
    let read = |max_held_bytes: u64| {
        let options = ReadOptions { max_held_bytes, ..ReadOptions::default() };
        read_embedded(&files, &options, &|_| {})
    };
    let error = read(2_000_000).unwrap_err().to_string();
    assert!(error.contains("a.obj") && error.contains("2.0 MB of memory"), "{error}");
    assert_eq!(read(32_000_000).unwrap().1.sources[0].textures, 20);
}
