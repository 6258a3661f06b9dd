//! Tests of a file as a source of its own.

use super::super::read;
use super::document::Document;
use insula_source::attributes::AttributeValue;
use insula_source::input::Input;
use insula_source::object::{Shape, TriangleMesh};
use insula_source::testing::{TestFiles, TestSink};
use serde_json::json;
use std::fs;

fn read_document(document: &Document) -> TestSink {
    let folder = tempfile::tempdir().expect("a folder");
    fs::create_dir(folder.path().join("sub")).expect("a folder");
    fs::write(folder.path().join("sub/city.gltf"), document.json.to_string()).expect("a file");
    fs::write(folder.path().join("sub/the buffer.bin"), &document.buffer).expect("a file");
    let files = TestFiles(folder.path().to_path_buf());
    let input = Input::new("city.gltf", "sub/city.gltf", &files, 1 << 20);
    let mut sink = TestSink::default();
    read(&input, &mut sink).expect("readable");
    sink
}

fn external() -> Document {
    let mut document = Document::quad();
    document.json["buffers"][0]["uri"] = "the%20buffer.bin".into();
    document
}

fn meshes(sink: &TestSink, object: usize) -> &[TriangleMesh] {
    match &sink.objects[object].shape {
        Shape::Surfaces { meshes, .. } => meshes,
        shape => panic!("{shape:?}"),
    }
}

#[test]
fn nodes_with_meshes_become_objects() {
    let mut document = external();
    document.json["nodes"] = json!([
        {"children": [1, 3, 4, 5]}, {"name": "house", "mesh": 0, "children": [2], "extras": {"year": 1904}}, {"mesh": 0, "translation": [0, 5, 0]},
        {"name": "house", "mesh": 0}, {"mesh": 0}, {"name": "lost", "mesh": 1}]);
    document.json["meshes"] = json!([document.json["meshes"][0], {"primitives": []}]);
    document.json["asset"]["copyright"] = "Somebody".into();
    let sink = read_document(&document);
    let ids: Vec<_> = sink.objects.iter().map(|object| object.id.as_str()).collect();
    assert_eq!(ids, ["house", "house (2)", "mesh 4"]);
    assert_eq!(meshes(&sink, 0).len(), 2, "with the node below");
    assert_eq!(
        meshes(&sink, 0)[0].positions,
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
        "z up"
    );
    assert_eq!(meshes(&sink, 0)[1].positions[2], [1.0, 1.0, 5.0]);
    assert_eq!(sink.objects[0].attributes.get("year"), Some(&AttributeValue::Integer(1904)));
    assert_eq!(sink.skipped, [("mesh has no triangles", "lost: mesh 1".to_owned())]);
    assert_eq!(sink.described.len(), 1);
    assert!(sink.crs.is_empty() && sink.bytes_done > 0);
}

#[test]
fn features_with_a_table_become_objects() {
    let mut document = external();
    let ids = document.add_view(&[0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0]);
    let accessor =
        document.add_accessor(json!({"bufferView": ids, "componentType": 5121, "count": 4, "type": "SCALAR"}));
    document.json["bufferViews"][ids]["byteStride"] = 4.into();
    // The triangles start at vertices 1 and 3.
    document.buffer[48..54].copy_from_slice(&[1, 2, 0, 3, 0, 2]);
    let primitive = &mut document.json["meshes"][0]["primitives"][0];
    primitive["attributes"]["_FEATURE_ID_0"] = accessor.into();
    primitive["extensions"] = json!({"EXT_mesh_features": {"featureIds": [
        {"featureCount": 2, "attribute": 0, "propertyTable": 0, "nullFeatureId": 7}]}});
    let names = document.add_view(b"ab");
    let offsets = document.add_view(&[0, 1, 2]);
    document.json["extensions"] = json!({"EXT_structural_metadata": {
        "schema": {"classes": {"building": {"properties": {"gml_id": {"type": "STRING"}}}}},
        "propertyTables": [{"class": "building", "count": 2, "properties": {
            "gml_id": {"values": names, "stringOffsets": offsets, "stringOffsetType": "UINT8"}}}]}});
    let sink = read_document(&document);
    let ids: Vec<_> = sink.objects.iter().map(|o| (o.id.as_str(), o.source_type.as_str())).collect();
    assert_eq!(ids, [("house", "mesh"), ("b", "building")]);
    assert_eq!(meshes(&sink, 1)[0].triangles, [[0, 1, 2]]);
    assert_eq!(meshes(&sink, 1)[0].positions.len(), 3);
    assert_eq!(sink.objects[1].attributes.get("gml_id"), Some(&AttributeValue::Text("b".into())));
}

#[test]
fn geocentric_files_say_so() {
    let mut document = external();
    let center = [-3_983_466.3, 3_328_972.2, 3_693_141.6];
    document.json["extensions"] = json!({"CESIUM_RTC": {"center": center}});
    let sink = read_document(&document);
    assert_eq!(sink.crs[0].name, "ECEF");
    assert_eq!(meshes(&sink, 0)[0].positions[2], [center[0] + 1.0, center[1] + 1.0, center[2]]);
    document.json["extensions"] = json!({"CESIUM_RTC": {"center": [5, 0, 0]}});
    let sink = read_document(&document);
    assert!(sink.crs.is_empty());
    assert_eq!(meshes(&sink, 0)[0].positions[0], [5.0, 0.0, 0.0]);
}
