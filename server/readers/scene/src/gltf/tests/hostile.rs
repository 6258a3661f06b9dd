//! Documents that are damaged or made to do harm.

use super::document::{Document, decode_bytes, decode_document, decode_json};
use insula_source::error::InputError;
use serde_json::json;

#[test]
fn truncated_glb_is_an_error_at_every_length() {
    let whole = Document::quad().glb();
    for length in 0..whole.len() {
        let result = decode_bytes(&whole[..length]);
        // Of the last bytes only padding is missing if the buffer is whole.
        let is_error = matches!(result, Err(InputError::Damaged { .. } | InputError::Json { .. }));
        let lost = result.is_ok_and(|scene| scene.primitives.is_empty() && !scene.problems.is_empty());
        assert!(is_error || lost, "{length}");
    }
}

#[test]
fn absurd_numbers_cost_a_part_or_the_file_but_no_memory() {
    let places: [(&str, u64); 12] = [
        ("/accessors/0/count", u64::MAX),
        ("/accessors/0/count", 5),
        ("/accessors/0/byteOffset", u64::MAX),
        ("/accessors/0/componentType", 7),
        ("/accessors/1/count", u64::MAX / 2),
        ("/accessors/1/byteOffset", 1),
        ("/bufferViews/0/byteOffset", u64::MAX),
        ("/bufferViews/0/byteLength", u64::MAX),
        ("/bufferViews/0/buffer", 3),
        ("/meshes/0/primitives/0/attributes/POSITION", 9),
        ("/meshes/0/primitives/0/indices", 9),
        ("/nodes/0/mesh", 9),
    ];
    for (place, value) in places {
        let mut document = Document::quad();
        let parent = place.rsplit_once('/').expect("a path");
        document.json.pointer_mut(parent.0).expect("a member")[parent.1] = value.into();
        let scene = decode_document(&document).expect(place);
        assert!(scene.primitives.is_empty(), "{place}");
        assert!(scene.mesh_nodes[0].lost.is_some(), "{place}");
    }
    let mut document = Document::quad();
    document.json["accessors"][0] = json!({"componentType": 5126, "count": 1u64 << 40, "type": "MAT4"});
    assert!(matches!(decode_document(&document), Err(InputError::TooLarge { .. })));
    let mut document = Document::quad();
    let indices = document.json["accessors"][1].clone();
    document.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2}}});
    document.json["accessors"] =
        json!([document.json["accessors"][0], indices, {"componentType": 5126, "count": 5000, "type": "VEC3"}]);
    let error = decode_document(&document).expect_err("more vertices than allowed");
    assert!(matches!(error, InputError::TooLarge { limit: 16_384, .. }), "{error}");
}

#[test]
fn elements_that_cost_the_file_nothing_are_few() {
    let with_accessor = |count: u64, use_it: &dyn Fn(&mut Document)| {
        let mut document = Document::quad();
        document.add_accessor(json!({"componentType": 5120, "count": count, "type": "VEC3"}));
        use_it(&mut document);
        decode_document(&document)
    };
    let instances = |document: &mut Document| {
        let of_node = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2}}});
        document.json["nodes"][0]["extensions"] = of_node;
    };
    let colours = |document: &mut Document| {
        document.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 2.into();
    };
    assert_eq!(with_accessor(50, &instances).expect("few").primitives.len(), 50);
    assert_eq!(with_accessor(4, &colours).expect("as many as corners").primitives.len(), 1);
    let mut document = Document::quad();
    document.json["accessors"][0]["version1Stride"] = 0.into();
    document.json["accessors"][0]["count"] = 1_000_000.into();
    assert!(decode_document(&document).expect("readable").primitives.is_empty(), "all corners in one place");
    for error in [with_accessor(70_000, &instances), with_accessor(5_000_000, &colours)] {
        let error = error.expect_err("too many");
        assert!(matches!(error, InputError::TooLarge { limit: 4_194_304, .. }), "{error}");
    }
}

#[test]
fn indices_out_of_range_cost_their_triangles() {
    let mut document = Document::quad();
    let last = document.buffer.len() - 1;
    document.buffer[last] = 4;
    let scene = decode_document(&document).expect("readable");
    assert_eq!(scene.primitives[0].triangles, [[0, 1, 2]]);
    assert_eq!(scene.problems, [("vertex index out of range", "mesh 0, primitive 0: 1 triangles".to_owned())]);
    document.buffer[4..8].copy_from_slice(&f32::NAN.to_le_bytes());
    let scene = decode_document(&document).expect("readable");
    assert!(scene.primitives.is_empty());
}

#[test]
fn cycles_and_chains_of_nodes_end() {
    let mut document = Document::quad();
    document.json["nodes"] = json!([{"children": [1]}, {"children": [0, 1, 2, 2, 77], "mesh": 0}, {"mesh": 0}]);
    let scene = decode_document(&document).expect("readable");
    assert_eq!(scene.primitives.len(), 2);
    let problems =
        [("node with several parents", "tree of nodes: 3 times"), ("missing part of a glTF", "tree of nodes: 1 times")];
    assert_eq!(scene.problems, problems.map(|(kind, detail)| (kind, detail.to_owned())));
    let count = 20_000;
    let chain: Vec<_> = (0..count)
        .map(|n| json!({"children": if n + 1 < count { vec![n + 1] } else { vec![] }, "scale": [9, 9, 9]}))
        .collect();
    document.json["nodes"] = chain.into();
    document.json["nodes"][count - 1]["mesh"] = 0.into();
    let scene = decode_document(&document).expect("deep, but no recursion");
    assert!(scene.primitives.iter().all(|p| p.positions.iter().flatten().all(|value| value.is_finite())));
}

#[test]
fn unknown_versions_and_requirements_are_named() {
    let mut document = Document::quad();
    document.json["extensionsRequired"] = json!(["KHR_materials_unlit", "ACME_gizmo", "VND_x"]);
    let error = decode_document(&document).expect_err("unknown").to_string();
    assert!(error.contains("ACME_gizmo, VND_x"), "{error}");
    let error = decode_json(r#"{"asset": {"version": "3.0"}}"#).expect_err("unknown").to_string();
    assert!(error.contains("version \"3.0\""), "{error}");
    assert!(matches!(decode_json("{\"asset\": "), Err(InputError::Json { .. })));
    assert!(matches!(decode_bytes(b"glTF\x07\0\0\0\x0c\0\0\0"), Err(InputError::Unsupported { .. })));
    let objects = format!(r#"{{"asset": {{"version": "2.0"}}, "nodes": [{}{{}}]}}"#, "{},".repeat(1 << 22));
    assert!(matches!(decode_json(&objects), Err(InputError::TooLarge { .. })));
    assert!(decode_json(r#"{"asset": {"version": "2.0"}}"#).expect("an empty scene").primitives.is_empty());
}

#[test]
fn points_and_compressed_garbage_are_reported() {
    let mut document = Document::quad();
    let garbage = document.add_view(&[0xa0; 40]);
    let primitive = document.json["meshes"][0]["primitives"][0].clone();
    let mut points = primitive.clone();
    points["mode"] = 0.into();
    let mut draco = primitive.clone();
    draco["extensions"] = json!({"KHR_draco_mesh_compression": {"bufferView": garbage, "attributes": {"POSITION": 0}}});
    document.json["meshes"][0]["primitives"] = json!([points, draco, points, primitive]);
    let scene = decode_document(&document).expect("readable");
    assert_eq!(scene.primitives.len(), 1);
    let kinds: Vec<_> = scene.problems.iter().map(|(kind, _)| *kind).collect();
    assert_eq!(kinds, ["Draco data cannot be read", "points and lines are not read"]);
    let mut packed = Document::quad();
    packed.json["bufferViews"][0]["extensions"] = json!({"EXT_meshopt_compression": {"buffer": 0, "byteOffset": 0,
        "byteLength": 48, "byteStride": 12, "count": 4, "mode": "ATTRIBUTES", "filter": "NONE"}});
    let scene = decode_document(&packed).expect("readable");
    assert_eq!(scene.problems[0].0, "meshopt data cannot be read");
}

#[test]
fn changed_bytes_never_panic() {
    let mut document = Document::quad();
    let image = document.add_view(b"\xabKTX 20\xbb\r\n\x1a\n\0\0\0\0\x01\0\0\0\x04\0\0\0\x04\0\0\0");
    document.json["images"] = json!([{"bufferView": image}]);
    document.json["textures"] = json!([{"source": 0}]);
    document.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    document.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    let whole = document.glb();
    let mut state = 1u64;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state as usize
    };
    for _ in 0..3000 {
        let mut bytes = whole.clone();
        for _ in 0..=random() % 4 {
            let at = random() % bytes.len();
            // Digits make other numbers of the JSON.
            bytes[at] = if bytes[at].is_ascii_digit() { b'0' + (random() % 10) as u8 } else { random() as u8 };
        }
        let _ = decode_bytes(&bytes);
    }
}
