//! Tests of the whole reader on small documents made here.

pub(crate) mod document;
mod hostile;
mod source;

use super::*;
use document::{Document, QUAD, decode_document, decode_json};
use insula_source::attributes::AttributeValue;
use insula_source::object::{SourceImage, Wrap};

#[test]
fn glb_and_json_are_equal() {
    let document = Document::quad();
    let from_glb = decode_document(&document).expect("readable");
    let from_json = decode_json(&document.json_with_data_uri()).expect("readable");
    for scene in [&from_glb, &from_json] {
        assert!(scene.problems.is_empty(), "{:?}", scene.problems);
        assert_eq!(scene.primitives.len(), 1);
        let primitive = &scene.primitives[0];
        assert_eq!(primitive.positions, QUAD.map(|p| p.map(f64::from)));
        assert_eq!(primitive.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(scene.mesh_nodes[0].name.as_deref(), Some("house"));
    }
}

#[test]
fn nodes_transform_in_order_and_mirrors_keep_the_outside() {
    let mut document = Document::quad();
    document.json["nodes"] = serde_json::json!([
        {"translation": [10, 0, 0], "children": [1], "extras": {"use": "school", "levels": [1, 2]}},
        {"name": "house", "mesh": 0, "scale": [-2, 1, 1], "rotation": [0, std::f64::consts::FRAC_1_SQRT_2, 0, std::f64::consts::FRAC_1_SQRT_2]},
    ]);
    document.json["meshes"][0]["extras"] = serde_json::json!({"height": 12.5});
    let scene = decode_document(&document).expect("readable");
    let primitive = &scene.primitives[0];
    // (1, 0, 0) scaled to (-2, 0, 0), turned about y by 90 degrees to (0, 0, 2), moved.
    let expected = [10.0, 0.0, 2.0];
    assert!(
        primitive.positions[1].iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12),
        "{:?}",
        primitive.positions
    );
    assert_eq!(primitive.triangles, [[0, 2, 1], [0, 3, 2]]);
    assert_eq!(primitive.attributes.get("height"), Some(&AttributeValue::Float(12.5)));
}

#[test]
fn normalised_sparse_and_interleaved_accessors_are_read() {
    let mut document = Document::quad();
    // The third vertex is replaced.
    let (indices, values) = (
        document.add_view(&[2, 0]),
        document
            .add_view(&[[9.0f32, 8.0, 7.0]].as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()),
    );
    document.json["accessors"][0]["sparse"] = serde_json::json!({"count": 1,
        "indices": {"bufferView": indices, "componentType": 5123}, "values": {"bufferView": values}});
    // Colours: normalised bytes with a stride of 8.
    let colours = [
        [255u8, 0, 0, 0, 1, 1, 1, 1],
        [0, 255, 0, 0, 1, 1, 1, 1],
        [0, 0, 255, 0, 1, 1, 1, 1],
        [55, 55, 55, 0, 1, 1, 1, 1],
    ];
    let view = document.add_view(colours.as_flattened());
    document.json["bufferViews"][view]["byteStride"] = 8.into();
    let accessor = document.add_accessor(
        serde_json::json!({"bufferView": view, "componentType": 5121, "normalized": true, "count": 4, "type": "VEC3"}),
    );
    document.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = accessor.into();
    let scene = decode_document(&document).expect("readable");
    assert!(scene.problems.is_empty(), "{:?}", scene.problems);
    let primitive = &scene.primitives[0];
    assert_eq!(primitive.positions[2], [9.0, 8.0, 7.0]);
    assert_eq!(primitive.positions[3], [0.0, 0.0, -1.0]);
    assert_eq!(primitive.colours, [[255, 0, 0], [0, 255, 0], [0, 0, 255], [128, 128, 128]], "linear becomes sRGB");
}

#[test]
fn shared_vertices_that_are_not_used_are_dropped() {
    let mut document = Document::quad();
    document.json["accessors"][1]["count"] = 3.into();
    document.json["meshes"][0]["primitives"][0]["extensions"] =
        serde_json::json!({"EXT_mesh_features": {"featureIds": [{"featureCount": 4}]}});
    let scene = decode_document(&document).expect("readable");
    let primitive = &scene.primitives[0];
    assert_eq!(primitive.positions.len(), 3);
    assert_eq!(primitive.feature_ids[0].values, FeatureIdValues::PerVertex(vec![0, 1, 2]));
}

#[test]
fn materials_have_colour_texture_and_alpha() {
    let mut document = Document::quad();
    let image = document.add_view(b"\x89PNG and so on");
    document.json["images"] = serde_json::json!([{"bufferView": image}, {"uri": "a%20b.webp"}, {"uri": "c.bmp"}]);
    document.json["samplers"] = serde_json::json!([{"wrapS": 33071, "wrapT": 33071}]);
    document.json["textures"] = serde_json::json!([
        {"source": 0, "sampler": 0}, {"extensions": {"EXT_texture_webp": {"source": 1}}}, {"source": 7}]);
    let material = |index: usize| {
        serde_json::json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": index},
        "baseColorFactor": [1, 0.2140411, 0, 0.5], "metallicFactor": 0.25, "roughnessFactor": 0.75}})
    };
    let mut masked = material(1);
    masked["alphaMode"] = "MASK".into();
    masked["alphaCutoff"] = 0.3.into();
    let mut clear = material(2);
    clear["alphaMode"] = "BLEND".into();
    clear["extensions"] = serde_json::json!({"KHR_materials_transmission": {"transmissionFactor": 1}});
    document.json["materials"] = serde_json::json!([material(0), masked, clear, {}]);
    for index in 0..3 {
        let mut primitive = document.json["meshes"][0]["primitives"][0].clone();
        primitive["material"] = index.into();
        document.json["meshes"][0]["primitives"].as_array_mut().expect("a list").push(primitive);
    }
    let scene = decode_document(&document).expect("readable");
    let [opaque, masked, clear, unused] = &scene.materials[..] else { panic!("{:?}", scene.materials) };
    assert_eq!(opaque.rgb, Some([255, 127, 0]));
    let texture = opaque.texture.as_ref().expect("a texture");
    assert_eq!(texture.wrap, Wrap::Clamp);
    assert!(matches!(&texture.image, SourceImage::Encoded { bytes, .. } if bytes.starts_with(b"\x89PNG")));
    assert_eq!(
        (opaque.opacity, opaque.alpha_cutoff, opaque.metallic, opaque.roughness),
        (1.0, None, Some(0.25), Some(0.75))
    );
    assert_eq!(masked.texture.as_ref().map(|t| &t.image), Some(&SourceImage::File("a b.webp".into())));
    assert_eq!(masked.alpha_cutoff, Some(0.6), "of the texture alone");
    assert_eq!((clear.opacity, clear.alpha_cutoff), (0.25, None), "without its texture");
    assert_eq!(*unused, SourceMaterial::default());
    assert_eq!(scene.problems, [("missing part of a glTF", "material 2: image 7 does not exist".to_owned())]);
}

#[test]
fn instances_are_expanded() {
    let mut document = Document::quad();
    let shifts = [[0.0f32, 0.0, 0.0], [5.0, 0.0, 0.0]];
    let view = document.add_view(&shifts.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>());
    let accessor = document
        .add_accessor(serde_json::json!({"bufferView": view, "componentType": 5126, "count": 2, "type": "VEC3"}));
    document.json["nodes"][0]["extensions"] = serde_json::json!({
        "EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": accessor}},
        "EXT_instance_features": {"featureIds": [{"featureCount": 2, "nullFeatureId": 1}]}});
    let scene = decode_document(&document).expect("readable");
    assert_eq!(scene.primitives.len(), 2);
    assert_eq!(scene.primitives[1].instance, Some(1));
    assert_eq!(scene.primitives[1].positions[0], [5.0, 0.0, 0.0]);
    assert_eq!(scene.primitives[1].feature_ids[0].values, FeatureIdValues::All(1));
    assert_eq!(scene.primitives[1].feature_ids[0].of_vertex(0), None);
    assert_eq!(scene.primitives[0].feature_ids[0].of_vertex(0), Some(0));
}

#[test]
fn skins_are_in_their_rest_pose() {
    let mut document = Document::quad();
    let joints = document.add_view(&[0u8, 1, 0, 0].repeat(4));
    let joints = document
        .add_accessor(serde_json::json!({"bufferView": joints, "componentType": 5121, "count": 4, "type": "VEC4"}));
    let weights = document.add_view(&[128u8, 128, 0, 0].repeat(4));
    let weights = document.add_accessor(serde_json::json!({"bufferView": weights, "componentType": 5121, "normalized": true, "count": 4, "type": "VEC4"}));
    let attributes = &mut document.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["JOINTS_0"] = joints.into();
    attributes["WEIGHTS_0"] = weights.into();
    document.json["skins"] = serde_json::json!([{"joints": [1, 2]}]);
    document.json["nodes"] = serde_json::json!([
        {"mesh": 0, "skin": 0, "translation": [99, 99, 99]}, {"translation": [2, 0, 0]}, {"translation": [0, 4, 0]}]);
    document.json["scenes"][0]["nodes"] = serde_json::json!([0, 1, 2]);
    let scene = decode_document(&document).expect("readable");
    let [x, y, z] = scene.primitives[0].positions[1];
    assert!((x - 2.0).abs() < 1e-6 && (y - 2.0).abs() < 1e-6 && z == 0.0, "{x} {y} {z}");
}

#[test]
fn property_tables_give_attributes() {
    let mut document = Document::quad();
    let texts = document.add_view("northsouth".as_bytes());
    let offsets = document.add_view(&[0u8, 5, 10]);
    let heights = document.add_view(&[[10u8, 0], [255, 255]].concat());
    let flags = document.add_view(&[0b10]);
    document.json["extensions"] = serde_json::json!({"EXT_structural_metadata": {
        "schema": {"classes": {"building": {"properties": {
            "name": {"type": "STRING"}, "height": {"type": "SCALAR", "componentType": "UINT16", "noData": 65535, "scale": 0.5},
            "listed": {"type": "BOOLEAN"}, "use": {"type": "STRING", "default": "unknown"}, "gone": {"type": "STRING"}}}}},
        "propertyTables": [{"class": "building", "count": 2, "properties": {
            "name": {"values": texts, "stringOffsets": offsets, "stringOffsetType": "UINT8"},
            "height": {"values": heights}, "listed": {"values": flags}, "gone": {"values": 99}}}]}});
    let scene = decode_document(&document).expect("readable");
    let all = |feature| scene.attributes_of(0, feature).iter().map(|(n, v)| format!("{n}={v}")).collect::<Vec<_>>();
    assert_eq!(all(0), ["height=5", "listed=false", "name=north", "use=unknown"]);
    assert_eq!(all(1), ["listed=true", "name=south", "use=unknown"]);
    assert!(all(2).is_empty());
    assert_eq!(scene.id_of(0, 1).as_deref(), Some("south"));
    assert_eq!(scene.problems.len(), 1, "{:?}", scene.problems);
}

#[test]
fn texts_in_other_pages_are_read_and_reported() {
    let mut document = Document::quad();
    let texts = document.add_view(b"K\xf6lnStra\xdfea");
    let offsets = document.add_view(&[0u8, 4, 10, 11]);
    document.json["extensions"] = serde_json::json!({"EXT_structural_metadata": {
        "schema": {"classes": {"building": {"properties": {"name": {"type": "STRING"}}}}},
        "propertyTables": [{"class": "building", "count": 3, "properties": {
            "name": {"values": texts, "stringOffsets": offsets, "stringOffsetType": "UINT8"}}}]}});
    document.json["nodes"][0]["name"] = "gebaeude".into();
    let mut glb = document.glb();
    let scene = document::decode_bytes(&glb).expect("readable");
    let name = |feature| scene.id_of(0, feature).unwrap_or_default();
    assert_eq!([name(0), name(1), name(2)], ["Köln", "Straße", "a"]);
    let [(ENCODING_GUESSED, what)] = &scene.problems[..] else { panic!("{:?}", scene.problems) };
    assert!(what.contains("property name: 2 texts are not in UTF-8") && what.contains("windows-1252"), "{what}");
    let place = glb.windows(8).position(|bytes| bytes == b"gebaeude").expect("the name");
    glb[place..place + 8].copy_from_slice(b"geb\xe4ude ");
    let scene = document::decode_bytes(&glb).expect("readable");
    assert_eq!(scene.mesh_nodes[0].name.as_deref(), Some("gebäude "));
    assert!(scene.problems[0].0 == ENCODING_GUESSED && scene.problems[0].1.contains("geb\u{e4}ude"));
}

#[test]
fn version_1_is_converted() {
    let mut body: Vec<u8> = QUAD.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    body.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|v| v.to_le_bytes()));
    let json = serde_json::json!({
        "buffers": {"binary_glTF": {"byteLength": body.len(), "type": "arraybuffer"}},
        "bufferViews": {"b": {"buffer": "binary_glTF", "byteOffset": 0, "byteLength": 48},
            "a": {"buffer": "binary_glTF", "byteOffset": 48, "byteLength": 12}},
        "accessors": {"i": {"bufferView": "a", "byteOffset": 0, "byteStride": 0, "componentType": 5123, "count": 6, "type": "SCALAR"},
            "p": {"bufferView": "b", "byteOffset": 0, "byteStride": 12, "componentType": 5126, "count": 4, "type": "VEC3"}},
        "materials": {"m": {"technique": "t", "values": {"diffuse": [0.5, 0.25, 1, 0.5]}}},
        "meshes": {"one": {"primitives": [{"attributes": {"POSITION": "p"}, "indices": "i", "material": "m", "mode": 4}]},
            "two": {"primitives": [{"attributes": {"POSITION": "p"}, "indices": "i", "mode": 4}]}},
        "nodes": {"root": {"children": ["leaf"], "matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, 7,0,0,1]}, "leaf": {"meshes": ["one", "two"]}},
        "scene": "s", "scenes": {"s": {"nodes": ["root"]}},
        "extensionsUsed": ["KHR_binary_glTF"]});
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut glb = b"glTF".to_vec();
    let words = [1, 20 + text.len() + body.len(), text.len(), 0];
    glb.extend(words.iter().flat_map(|word| (*word as u32).to_le_bytes()));
    glb.extend(&text);
    glb.extend(&body);
    let scene = document::decode_bytes(&glb).expect("readable");
    assert!(scene.problems.is_empty(), "{:?}", scene.problems);
    assert_eq!(scene.primitives.len(), 2);
    assert_eq!(scene.primitives[0].positions[1], [8.0, 0.0, 0.0]);
    assert_eq!(scene.primitives[0].triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(scene.materials[0].rgb, Some([128, 64, 255]));
    assert_eq!(scene.materials[0].opacity, 0.5);
    assert_eq!(scene.mesh_nodes[1].owner, scene.mesh_nodes[0].node);
}

#[test]
fn parts_that_are_not_read_are_named() {
    let mut document = Document::quad();
    document.json["extensions"] = serde_json::json!({"EXT_feature_metadata": {"schema": {}},
        "EXT_structural_metadata": {"propertyTextures": [{"class": "c"}], "propertyAttributes": []}});
    document.json["meshes"][0]["weights"] = serde_json::json!([0.5]);
    document.json["meshes"][0]["primitives"][0]["targets"] = serde_json::json!([{"POSITION": 0}]);
    document.json["nodes"] = serde_json::json!([{"mesh": 0}, {"mesh": 0, "weights": [0]}, {"mesh": 0}]);
    document.json["scenes"] = serde_json::json!([{"nodes": [0, 1]}, {"nodes": [2]}]);
    let scene = decode_document(&document).expect("readable");
    let parts: Vec<_> = scene.problems.iter().map(|(kind, detail)| (*kind, detail.as_str())).collect();
    let expected = [
        "attributes in EXT_feature_metadata, which EXT_structural_metadata has replaced",
        "attributes in property textures",
        "morph targets, whose nodes have their basic shape: 2",
        "nodes with meshes outside of the scene that the file shows: 1",
    ];
    assert_eq!(parts, expected.map(|part| (PART_NOT_READ, part)));
    assert_eq!(scene.primitives.len(), 2);
}
