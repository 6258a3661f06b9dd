//! Tests of whole tilesets, whose files are made here.

use super::{globe, read};
use crate::gltf::tests::document::Document;
use glam::DVec3;
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::{FeatureKind, Shape, SourceObject};
use insula_source::problems::ENCODING_GUESSED;
use insula_source::testing::{TestFiles, TestSink, gzip};
use serde_json::{Value, json};
use std::path::Path;

/// A GLB with a triangle for each of `batch_ids` at `x` and up to 1 m beside: (x, 0, 0), (x + 1, 0, 0), (x, 1, 0) in glTF axes.
fn glb(x: f32, batch_ids: &[u8]) -> Vec<u8> {
    let mut positions = Vec::new();
    let mut ids = Vec::new();
    for id in batch_ids {
        for corner in [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0_f32]] {
            positions.extend(corner.into_iter().flat_map(f32::to_le_bytes));
            ids.extend([*id, 0, 0, 0]);
        }
    }
    let count = 3 * batch_ids.len();
    let json = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "_BATCHID": 1}}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3", "min": [x, 0, 0], "max": [x + 1.0, 1, 0]},
            {"bufferView": 1, "componentType": 5121, "count": count, "type": "SCALAR"}
        ],
        "bufferViews": [], "buffers": [{}]
    });
    let mut document = Document { json, buffer: Vec::new() };
    document.add_view(&positions);
    let view = document.add_view(&ids);
    document.json["bufferViews"][view]["byteStride"] = 4.into();
    document.glb()
}

/// A tile with tables; `more` are the numbers between them and the header's end.
fn tile(magic: &[u8; 4], tables: [&[u8]; 4], more: &[u32], rest: &[u8]) -> Vec<u8> {
    let length = 28 + 4 * more.len() + tables.iter().map(|table| table.len()).sum::<usize>() + rest.len();
    let mut bytes = magic.to_vec();
    let lengths = tables.iter().map(|table| table.len() as u32);
    let numbers = [1, length as u32].into_iter().chain(lengths).chain(more.iter().copied());
    bytes.extend(numbers.flat_map(u32::to_le_bytes));
    tables.iter().for_each(|table| bytes.extend(*table));
    bytes.extend(rest);
    bytes
}

fn b3dm(features: &Value, batch: &Value, glb: &[u8]) -> Vec<u8> {
    let batch = if batch.is_null() { String::new() } else { batch.to_string() };
    tile(b"b3dm", [features.to_string().as_bytes(), b"", batch.as_bytes(), b""], &[], glb)
}

fn cmpt(inner: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = b"cmpt".to_vec();
    let length = 16 + inner.iter().map(Vec::len).sum::<usize>();
    bytes.extend([1, length as u32, inner.len() as u32].iter().flat_map(|number| number.to_le_bytes()));
    inner.iter().for_each(|tile| bytes.extend(tile));
    bytes
}

fn read_in(folder: &Path, name: &str, bbox_deg: Option<[f64; 4]>) -> (TestSink, Result<(), InputError>) {
    let files = TestFiles(folder.to_owned());
    let mut sink = TestSink::default();
    let input = Input { bbox_deg, ..Input::new(name, name, &files, 1 << 24) };
    let result = read(&input, &mut sink);
    (sink, result)
}

/// Reads the first of some files.
fn read_files(files: &[(&str, &[u8])]) -> (TestSink, Result<(), InputError>) {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    read_in(folder.path(), files[0].0, None)
}

/// Reads a tileset with such a root, and the files that it names.
fn read_tileset(root: &Value, files: &[(&str, &[u8])]) -> TestSink {
    let tileset = json!({"asset": {"version": "1.1"}, "root": root}).to_string();
    let mut all: Vec<(&str, &[u8])> = vec![("tileset.json", tileset.as_bytes())];
    all.extend(files);
    let (sink, result) = read_files(&all);
    result.unwrap();
    sink
}

fn ids(sink: &TestSink) -> Vec<&str> {
    sink.objects.iter().map(|object| object.id.as_str()).collect()
}

fn reasons(sink: &TestSink) -> Vec<&str> {
    sink.skipped.iter().map(|(reason, _)| *reason).collect()
}

fn first_position(object: &SourceObject) -> DVec3 {
    let Shape::Surfaces { meshes, .. } = &object.shape else { panic!("no surfaces") };
    DVec3::from_array(meshes[0].positions[0])
}

/// The transform to a place on the globe, as tilesets have it.
fn on_globe(lon_deg: f64, lat_deg: f64) -> Value {
    json!(globe::east_north_up(globe::ecef(lon_deg, lat_deg, 0.0)).to_cols_array())
}

#[test]
fn a_batch_table_in_another_page_is_read_and_reported() {
    let batch = b"{\"strasse\": [\"Stra\xdfe\", \"K\xf6ln\"]}";
    let bytes = tile(b"b3dm", [br#"{"BATCH_LENGTH": 2}"#, b"", batch, b""], &[], &glb(0.0, &[0, 1]));
    let (sink, result) = read_files(&[("a.b3dm", &bytes)]);
    result.unwrap();
    let texts: Vec<_> = sink.objects.iter().filter_map(|object| object.attributes.get("strasse")).collect();
    assert_eq!(texts.into_iter().map(ToString::to_string).collect::<Vec<_>>(), ["Straße", "Köln"]);
    assert!(sink.problems[0].0 == ENCODING_GUESSED && sink.problems[0].1.contains("windows-1252"));
}

#[test]
fn features_have_attributes_and_stand_on_the_globe() {
    let batch = json!({"gml_id": ["a", "b", "unused"], "class": ["bldg:Building", "tran:Road", "x"], "info": [{"h": 4}, null, 1]});
    let tile = b3dm(&json!({"BATCH_LENGTH": 3, "RTC_CENTER": [0, 0, 7]}), &batch, &glb(2.0, &[0, 1]));
    let root = json!({"transform": on_globe(8.0, 50.0), "content": {"uri": "a%20tile.b3dm"}});
    let sink = read_tileset(&root, &[("a tile.b3dm", &tile)]);
    assert_eq!(sink.crs.iter().map(|crs| crs.name.as_str()).collect::<Vec<_>>(), ["ECEF"]);
    assert_eq!(ids(&sink), ["a", "b"]);
    let [first, second] = &sink.objects[..] else { panic!() };
    assert_eq!((first.kind, second.kind), (FeatureKind::Building, FeatureKind::Road));
    assert_eq!(first.source_type, "bldg:Building");
    assert_eq!(first.attributes.get("info.h").and_then(|value| value.as_f64()), Some(4.0));
    let expected = globe::east_north_up(globe::ecef(8.0, 50.0, 0.0)).transform_point3(DVec3::new(2.0, 0.0, 7.0));
    assert!(first_position(first).distance(expected) < 1e-6);
    assert_eq!(sink.skipped, [("feature has no triangles", "unused: in a tile.b3dm".to_owned())]);
}

#[test]
fn tiles_without_features_are_one_object_and_local_ones_have_no_system() {
    let tile = b3dm(&json!({"BATCH_LENGTH": 0}), &Value::Null, &glb(2.0, &[0, 1]));
    let (sink, result) = read_files(&[("tree_1.b3dm", &tile)]);
    result.unwrap();
    assert_eq!((ids(&sink), sink.crs.len(), sink.objects[0].kind), (vec!["tree_1.b3dm"], 0, FeatureKind::Vegetation));
    // y up becomes z up.
    let Shape::Surfaces { meshes, .. } = &sink.objects[0].shape else { panic!() };
    assert_eq!(meshes[0].positions[2], [2.0, 0.0, 1.0]);
}

#[test]
fn finest_contents_replace_and_others_add() {
    let tile = |x: f32| glb(x, &[0]);
    let files: Vec<(String, Vec<u8>)> = (0..7).map(|i| (format!("{i}.glb"), tile(i as f32))).collect();
    let files: Vec<(&str, &[u8])> = files.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())).collect();
    let content = |i: u32| json!({"uri": format!("{i}.glb")});
    let root = json!({"refine": "REPLACE", "content": content(0), "children": [
        {"content": content(1), "children": [{"content": {"uri": "missing.glb"}}]},
        {"refine": "ADD", "contents": [content(2), content(3)], "children": [{"content": content(4)}]},
        {"children": [{}]}
    ]});
    let sink = read_tileset(&root, &files);
    assert_eq!(ids(&sink), ["1.glb#0", "4.glb#0", "2.glb#0", "3.glb#0"]);
    assert_eq!(reasons(&sink), ["tile cannot be read"]);
    let root = json!({"refine": "REPLACE", "content": content(0), "children": [{}, {"children": [{}]}]});
    assert_eq!(ids(&read_tileset(&root, &files)), ["0.glb#0"]);
}

#[test]
fn external_tilesets_are_followed_but_not_in_circles_or_out_of_the_folder() {
    let inner = json!({"asset": {}, "root": {"transform": [1,0,0,0, 0,1,0,0, 0,0,1,0, 100,0,0,1], "children": [
        {"content": {"uri": "../a.glb"}},
        {"content": {"uri": "../tileset.json"}},
        {"content": {"uri": "../../secret.glb"}},
        {"content": {"uri": "https://example.org/a.glb"}},
        {"content": {"uri": "broken.json"}}
    ]}});
    let root = json!({"transform": [2,0,0,0, 0,2,0,0, 0,0,2,0, 0,0,0,1], "content": {"url": "sub/inner.json"}});
    let glb = glb(3.0, &[0]);
    let inner = inner.to_string();
    let sink = read_tileset(
        &root,
        &[("sub/inner.json", inner.as_bytes()), ("a.glb", &glb), ("sub/broken.json", b"{\"root\":")],
    );
    assert_eq!(first_position(&sink.objects[0]), DVec3::new(206.0, 0.0, 0.0));
    let expected =
        ["external tileset contains itself", "tile is not fetched", "tile is not fetched", "tile cannot be read"];
    assert_eq!(reasons(&sink), expected);
}

#[test]
fn composites_packed_tiles_and_data_uris_are_read() {
    let tile = b3dm(&json!({"BATCH_LENGTH": 1}), &json!({"id": [7]}), &glb(0.0, &[0]));
    let points = tile_of_points();
    let composite = cmpt(&[tile.clone(), cmpt(&[tile.clone(), points])]);
    let packed = gzip(&composite);
    let data = format!("data:application/octet-stream;base64,{}", base64_of(&tile));
    let root = json!({"refine": "ADD", "content": {"uri": "c.cmpt"}, "children": [{"content": {"uri": data}}]});
    let sink = read_tileset(&root, &[("c.cmpt", &packed)]);
    assert_eq!(ids(&sink), ["7", "7", "7"]);
    assert_eq!(sink.skipped[0].0, "tile has a format that is not read");
    let deep = (0..40).fold(tile, |inner, _| cmpt(&[inner]));
    let (sink, result) = read_files(&[("deep.cmpt", &deep)]);
    assert!(result.is_ok() && sink.objects.is_empty());
    assert!(sink.skipped[0].1.contains("too deeply"));
    let (_, result) = read_files(&[("a.pnts", &tile_of_points())]);
    assert!(matches!(result, Err(InputError::Unsupported { .. })));
}

fn tile_of_points() -> Vec<u8> {
    tile(b"pnts", [b"{}", b"", b"", b""], &[], b"")
}

fn base64_of(bytes: &[u8]) -> String {
    use base64::Engine;
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

/// An i3dm whose feature table has these bytes.
fn i3dm(features: &Value, binary: &[u8], glb: &[u8]) -> Vec<u8> {
    tile(b"i3dm", [features.to_string().as_bytes(), binary, b"{\"kind\":[\"oak\",\"elm\"]}", b""], &[1], glb)
}

fn floats(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

#[test]
fn instances_are_placed_turned_and_scaled() {
    // The model's corners are (0, 0, 0), (1, 0, 0) and, up, (0, 0, 1).
    let positions = floats(&[10.0, 0.0, 0.0, 20.0, 0.0, 0.0]);
    let turned = floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
    let binary = [positions, turned, floats(&[1.0, 3.0])].concat();
    let features = json!({
        "INSTANCES_LENGTH": 2, "POSITION": {"byteOffset": 0}, "NORMAL_UP": {"byteOffset": 24},
        "NORMAL_RIGHT": {"byteOffset": 48}, "SCALE": {"byteOffset": 72}
    });
    let (sink, result) = read_files(&[("tree.i3dm", &i3dm(&features, &binary, &glb(0.0, &[0])))]);
    result.unwrap();
    assert_eq!(ids(&sink), ["tree.i3dm#0", "tree.i3dm#1"]);
    assert_eq!(sink.objects[1].attributes.get("kind").and_then(|kind| kind.as_str()), Some("elm"));
    assert_eq!(sink.objects[1].kind, FeatureKind::Vegetation);
    let Shape::Surfaces { meshes, .. } = &sink.objects[1].shape else { panic!() };
    // x is the right vector, z is right x up.
    assert_eq!(meshes[0].positions, [[20.0, 0.0, 0.0], [20.0, 3.0, 0.0], [23.0, 0.0, 0.0]]);
}

#[test]
fn quantised_instances_stand_upright_on_the_globe() {
    let at = globe::ecef(8.0, 50.0, 0.0);
    let binary: Vec<u8> = [0_u16, 0, 0].iter().flat_map(|step| step.to_le_bytes()).collect();
    let features = json!({
        "INSTANCES_LENGTH": 1, "POSITION_QUANTIZED": {"byteOffset": 0}, "EAST_NORTH_UP": true,
        "QUANTIZED_VOLUME_OFFSET": at.to_array(), "QUANTIZED_VOLUME_SCALE": [1, 1, 1]
    });
    let (sink, result) = read_files(&[("a.i3dm", &i3dm(&features, &binary, &glb(0.0, &[0])))]);
    result.unwrap();
    let Shape::Surfaces { meshes, .. } = &sink.objects[0].shape else { panic!() };
    let top = DVec3::from_array(meshes[0].positions[2]);
    assert!(top.distance(globe::ecef(8.0, 50.0, 1.0)) < 1e-3, "{top}");
}

/// A subtree with constant availabilities, or with bits of tiles and contents.
fn subtree(tiles: Option<&[u8]>, children: u8) -> Vec<u8> {
    let bits = tiles.unwrap_or_default();
    let availability = match tiles {
        Some(_) => json!({"bitstream": 0}),
        None => json!({"constant": 1}),
    };
    let json = json!({
        "buffers": [{"byteLength": bits.len()}], "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": bits.len()}],
        "tileAvailability": availability, "contentAvailability": [availability], "childSubtreeAvailability": {"constant": children}
    });
    let text = json.to_string();
    let mut bytes = b"subt".to_vec();
    bytes.extend(1_u32.to_le_bytes());
    bytes.extend((text.len() as u64).to_le_bytes());
    bytes.extend((bits.len() as u64).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.extend(bits);
    bytes
}

fn implicit(scheme: &str, subtree_levels: u32, levels: u32) -> Value {
    json!({"refine": "REPLACE", "content": {"uri": "{level}/{x}_{y}_{z}.glb"}, "implicitTiling": {
        "subdivisionScheme": scheme, "subtreeLevels": subtree_levels, "availableLevels": levels,
        "subtrees": {"uri": "s/{level}.{x}.{y}.subtree"}
    }})
}

#[test]
fn implicit_tiles_are_found_in_morton_order() {
    // The root, and of its children numbers 1 (x = 1, y = 0) and 2 (x = 0, y = 1).
    let subtree = subtree(Some(&[0b0_1101]), 0);
    let glb = glb(0.0, &[0]);
    let files: [(&str, &[u8]); 4] =
        [("s/0.0.0.subtree", &subtree), ("0/0_0_0.glb", &glb), ("1/1_0_0.glb", &glb), ("1/0_1_0.glb", &glb)];
    let sink = read_tileset(&implicit("QUADTREE", 2, 2), &files);
    assert_eq!(ids(&sink), ["1/1_0_0.glb#0", "1/0_1_0.glb#0"]);
    // A wrong length of the bits, at every length of the file, and an octree that needs more bits.
    for length in 0..subtree.len() {
        let sink = read_tileset(&implicit("QUADTREE", 2, 2), &[("s/0.0.0.subtree", &subtree[..length])]);
        assert_eq!(reasons(&sink), ["subtree cannot be read"], "{length}");
    }
    let sink = read_tileset(&implicit("OCTREE", 2, 2), &files);
    assert!(sink.skipped[0].1.contains("1 bytes for 9 bits"), "{:?}", sink.skipped);
}

#[test]
fn absurd_implicit_tilings_end() {
    let all = subtree(None, 1);
    let sink = read_tileset(&implicit("QUADTREE", 40, 50), &[("s/0.0.0.subtree", &all)]);
    assert_eq!(reasons(&sink), ["implicit tiling is malformed"]);
    let tileset = json!({"root": implicit("QUADTREE", 20, 4_000_000_000)}).to_string();
    let (sink, result) = read_files(&[("tileset.json", tileset.as_bytes()), ("s/0.0.0.subtree", &all)]);
    assert!(matches!(result, Err(InputError::Damaged { .. })), "{result:?}");
    assert_eq!(sink.problems[0].0, "implicit tiling has too many levels");
}

#[test]
fn small_tilesets_that_name_the_same_files_again_are_refused() {
    let is_refused = |files: &[(&str, &[u8])]| {
        let (_, result) = read_files(files);
        assert!(matches!(&result, Err(InputError::TooLarge { what, .. }) if what.contains("share")), "{result:?}");
    };
    // Every tile of 30 levels has the same subtree and the same content.
    let (all, glb) = (subtree(None, 1), glb(0.0, &[0]));
    let mut root = implicit("QUADTREE", 4, 30);
    root["content"]["uri"] = "a.glb".into();
    root["implicitTiling"]["subtrees"]["uri"] = "s.subtree".into();
    let text = json!({"root": root}).to_string();
    is_refused(&[("tileset.json", text.as_bytes()), ("s.subtree", &all), ("a.glb", &glb)]);
    // Each tileset names the next one twice.
    let tileset = |number: u32| {
        let next = json!({"refine": "ADD", "content": {"uri": format!("{}.json", number + 1)}});
        json!({"root": {"children": [next, next]}}).to_string()
    };
    let texts: Vec<(String, String)> = (0..40).map(|number| (format!("{number}.json"), tileset(number))).collect();
    let files: Vec<(&str, &[u8])> = texts.iter().map(|(name, text)| (name.as_str(), text.as_bytes())).collect();
    is_refused(&files);
}

#[test]
fn contents_that_tiles_share_have_few_bytes_together() {
    let folder = tempfile::tempdir().unwrap();
    let glb = glb(0.0, &[0]);
    std::fs::write(folder.path().join("a.glb"), &glb).unwrap();
    let read = |tiles: usize| {
        let tile = json!({"refine": "ADD", "content": {"uri": "a.glb"}});
        let tileset = json!({"root": {"children": vec![tile; tiles]}}).to_string();
        std::fs::write(folder.path().join("tileset.json"), tileset).unwrap();
        let files = TestFiles(folder.path().to_owned());
        let mut sink = TestSink::default();
        let name = "tileset.json";
        let result = super::read(&Input::new(name, name, &files, 8 * glb.len() as u64), &mut sink);
        (sink.objects.len(), result)
    };
    let (objects, result) = read(33);
    assert!(result.is_ok() && objects == 33, "{objects} {result:?}");
    let (_, result) = read(34);
    assert!(matches!(&result, Err(InputError::TooLarge { what, .. }) if what.contains("a.glb")), "{result:?}");
}

#[test]
fn tiles_outside_of_the_wanted_part_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let region = |west: f64| json!({"region": [west.to_radians(), 0.8, (west + 1.0).to_radians(), 0.9, 0, 9]});
    let tileset = json!({"root": {"refine": "REPLACE", "content": {"uri": "far.glb"}, "children": [
        {"boundingVolume": region(8.0), "content": {"uri": "a.glb"}},
        {"boundingVolume": region(10.0), "content": {"uri": "b.glb"}}
    ]}});
    std::fs::write(folder.path().join("tileset.json"), tileset.to_string()).unwrap();
    for name in ["a.glb", "b.glb", "far.glb"] {
        std::fs::write(folder.path().join(name), glb(0.0, &[0])).unwrap();
    }
    let (sink, _) = read_in(folder.path(), "tileset.json", Some([8.2, 46.0, 8.3, 51.0]));
    assert_eq!(ids(&sink), ["a.glb#0"]);
    let (sink, _) = read_in(folder.path(), "tileset.json", Some([0.0, 46.0, 1.0, 51.0]));
    assert!(sink.objects.is_empty());
}

#[test]
fn objects_of_two_worlds_are_not_mixed() {
    let glb = glb(0.0, &[0]);
    let root = json!({"refine": "ADD", "content": {"uri": "a.glb"}, "children": [
        {"transform": on_globe(8.0, 50.0), "content": {"uri": "b.glb"}},
        {"transform": [1, 2], "content": {"uri": "b.glb"}}
    ]});
    let sink = read_tileset(&root, &[("a.glb", &glb), ("b.glb", &glb)]);
    assert_eq!((ids(&sink), sink.crs.len()), (vec!["b.glb#0"], 1));
    let expected =
        ["transform of a tile is malformed", "object is not on the globe as others of the tileset are, or the reverse"];
    assert_eq!(reasons(&sink), expected);
}

#[test]
fn cut_tiles_are_refused_at_every_length_without_a_panic() {
    let batch = b3dm(&json!({"BATCH_LENGTH": 1}), &json!({"id": [7]}), &glb(0.0, &[0]));
    let features = json!({"INSTANCES_LENGTH": 1, "POSITION": {"byteOffset": 0}});
    let instances = i3dm(&features, &floats(&[1.0, 2.0, 3.0]), &glb(0.0, &[0]));
    let folder = tempfile::tempdir().unwrap();
    for (name, whole) in [("a.b3dm", &batch), ("a.i3dm", &instances), ("a.cmpt", &cmpt(std::slice::from_ref(&batch)))] {
        for length in 0..whole.len() {
            std::fs::write(folder.path().join(name), &whole[..length]).unwrap();
            let (sink, result) = read_in(folder.path(), name, None);
            assert!(result.is_err() || sink.objects.is_empty(), "{name} {length}");
        }
    }
}

#[test]
fn absurd_counts_in_tables_are_refused() {
    let count = u32::MAX;
    let features = json!({"INSTANCES_LENGTH": count, "POSITION": {"byteOffset": 0}});
    let (_, result) = read_files(&[("a.i3dm", &i3dm(&features, &[0; 12], &glb(0.0, &[0])))]);
    assert!(matches!(result, Err(InputError::Damaged { .. })));
    let batch = json!({"h": {"byteOffset": 0, "componentType": "DOUBLE", "type": "VEC4"}, "id": [1], "n": 4});
    let (sink, result) = read_files(&[("a.b3dm", &b3dm(&json!({"BATCH_LENGTH": count}), &batch, &glb(0.0, &[0])))]);
    result.unwrap();
    assert_eq!((ids(&sink), sink.problems.len()), (vec!["1"], 2));
}

#[test]
fn attributes_come_from_classes_and_parents() {
    let batch = json!({"extensions": {"3DTILES_batch_table_hierarchy": {
        "classes": [
            {"name": "Wall", "length": 2, "instances": {"colour": ["red", "white"]}},
            {"name": "Building", "length": 1, "instances": {"name": ["Kerk"], "colour": ["none"]}}
        ],
        "instancesLength": 3, "classIds": [0, 0, 1], "parentCounts": [1, 1, 0], "parentIds": [2, 2]
    }}});
    let (sink, result) = read_files(&[("a.b3dm", &b3dm(&json!({"BATCH_LENGTH": 2}), &batch, &glb(0.0, &[0, 1])))]);
    result.unwrap();
    let wall = &sink.objects[1];
    assert_eq!((wall.source_type.as_str(), wall.id.as_str()), ("Wall", "Kerk"));
    let text = |name: &str| wall.attributes.get(name).and_then(|value| value.as_str());
    assert_eq!((text("colour"), text("name")), (Some("white"), Some("Kerk")));
    // A parent that is its own grandparent.
    let batch = json!({"HIERARCHY": {"classes": [{"name": "A", "length": 2, "instances": {}}], "instancesLength": 2,
        "classIds": [0, 0], "parentIds": [1, 0]}});
    let (sink, result) = read_files(&[("a.b3dm", &b3dm(&json!({"BATCH_LENGTH": 2}), &batch, &glb(0.0, &[0, 1])))]);
    assert!(result.is_ok() && sink.objects.len() == 2);
}
