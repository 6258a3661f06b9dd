//! Tests of whole layers, whose files are made here.

use super::read;
use insula_source::attributes::AttributeValue;
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::{FeatureKind, Shape, SourceImage};
use insula_source::problems::UNIT_GUESSED;
use insula_source::testing::{TestFiles, TestSink};
use serde_json::{Value, json};
use std::path::Path;

fn write(folder: &Path, name: &str, bytes: &[u8]) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
}

fn read_at(folder: &Path, name: &str, bbox_deg: Option<[f64; 4]>) -> (TestSink, Result<(), InputError>) {
    let files = TestFiles(folder.to_owned());
    let mut sink = TestSink::default();
    let input = Input { bbox_deg, ..Input::new(name, name, &files, 1 << 24) };
    let result = read(&input, &mut sink);
    (sink, result)
}

fn format(number: &str, component: u32) -> Value {
    json!({"type": number, "component": component})
}

fn layer() -> Value {
    json!({
        "layerType": "3DObject", "name": "Houses", "copyrightText": "City",
        "spatialReference": {"wkid": 4326, "latestWkid": 4326},
        "heightModelInfo": {"heightModel": "ellipsoidal", "heightUnit": "foot"},
        "store": {"rootNode": "./nodes/root"}, "nodePages": {"nodesPerPage": 2},
        "materialDefinitions": [{"alphaMode": "mask", "pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0, 1],
            "baseColorTexture": {"textureSetDefinitionId": 0}, "roughnessFactor": 0.75}}],
        "textureSetDefinitions": [{"formats": [{"name": "1", "format": "ktx2"}, {"name": "0", "format": "jpg"}]}],
        "geometryDefinitions": [{"geometryBuffers": [
            {"compressedAttributes": {"encoding": "draco"}},
            {"offset": 8, "position": format("Float32", 3), "uv0": format("Float32", 2), "color": format("UInt8", 4),
                "featureId": format("UInt64", 1), "faceRange": format("UInt32", 2)}
        ]}],
        "attributeStorageInfo": [{"key": "f_1", "name": "storeys", "header": [{"property": "count"}],
            "attributeValues": {"valueType": "Int16"}}]
    })
}

/// Two triangles of two features, without regions although the schema of the store has them.
fn geometry() -> Vec<u8> {
    let mut bytes: Vec<u8> = [6_u32, 2].iter().flat_map(|count| count.to_le_bytes()).collect();
    let positions = [0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.5, 10.0_f32];
    bytes.extend(positions.iter().chain(&positions).flat_map(|number| number.to_le_bytes()));
    bytes.extend([[0.25_f32, 1.0]; 6].iter().flatten().flat_map(|number| number.to_le_bytes()));
    bytes.extend([[255, 0, 0, 255_u8]; 6].iter().flatten());
    bytes.extend([70_u64, 80].iter().flat_map(|id| id.to_le_bytes()));
    bytes.extend([0_u32, 0, 1, 1].iter().flat_map(|face| face.to_le_bytes()));
    bytes
}

fn node(children: &[u32], resource: Option<u32>) -> Value {
    let mut node = json!({"index": 0, "children": children,
        "obb": {"center": [8.0, 50.0, 100.0], "halfSize": [9, 9, 9], "quaternion": [0, 0, 0, 1]}});
    if let Some(resource) = resource {
        node["mesh"] = json!({"material": {"definition": 0, "resource": resource},
            "geometry": {"definition": 0, "resource": resource, "vertexCount": 6}, "attribute": {"resource": resource}});
    }
    node
}

/// A layer with a root, a coarse node 1 and below it the nodes 2 and 3, of which 3 is missing its files.
fn write_layer(folder: &Path) {
    write(folder, "3dSceneLayer.json", layer().to_string().as_bytes());
    write(
        folder,
        "nodepages/0.json",
        json!({"nodes": [node(&[1], None), node(&[2, 3], Some(5))]}).to_string().as_bytes(),
    );
    write(
        folder,
        "nodepages/1.json",
        json!({"nodes": [node(&[1], Some(6)), node(&[], Some(7))]}).to_string().as_bytes(),
    );
    for resource in [5, 6] {
        write(folder, &format!("nodes/{resource}/geometries/1.bin"), &geometry());
        write(folder, &format!("nodes/{resource}/textures/0.jpg"), b"image");
        write(folder, &format!("nodes/{resource}/attributes/f_1/0.bin"), &[2, 0, 0, 0, 4, 0, 9, 0]);
    }
}

#[test]
fn finest_nodes_are_read_with_attributes_materials_and_places() {
    let folder = tempfile::tempdir().unwrap();
    write_layer(folder.path());
    let (sink, result) = read_at(folder.path(), "3dSceneLayer.json", None);
    result.unwrap();
    assert_eq!((sink.crs[0].name.as_str(), sink.crs[0].height_unit_m), ("EPSG:4326+4979", Some(1.0)));
    let ids: Vec<_> = sink.objects.iter().map(|object| object.id.as_str()).collect();
    assert_eq!(ids, ["70", "80"]);
    assert_eq!(sink.objects[1].attributes.get("storeys"), Some(&AttributeValue::Integer(9)));
    let Shape::Surfaces { meshes, .. } = &sink.objects[1].shape else { panic!() };
    assert_eq!(meshes[0].positions[2], [8.0, 50.5, 110.0 * 0.3048]);
    assert_eq!((meshes[0].uv[0], meshes[0].colours[0]), ([0.25, 0.0], [255, 0, 0]));
    let material = &sink.materials[meshes[0].material.unwrap() as usize];
    assert_eq!(
        (material.rgb, material.alpha_cutoff, material.roughness),
        (Some([255, 128, 0]), Some(0.25), Some(0.75))
    );
    let SourceImage::Encoded { name, .. } = &material.texture.as_ref().unwrap().image else { panic!() };
    assert_eq!(name, "nodes/6/textures/0.jpg");
    // Node 1 is below node 2 again; node 3 has no files.
    assert_eq!(sink.problems[0].0, "node has two parents or contains itself");
    assert_eq!(sink.skipped.iter().map(|(reason, _)| *reason).collect::<Vec<_>>(), ["node cannot be read"]);
}

#[test]
fn an_unknown_unit_of_heights_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    write_layer(folder.path());
    let layer = layer().to_string().replace("\"foot\"", "\"cubit\"");
    write(folder.path(), "3dSceneLayer.json", layer.as_bytes());
    let (sink, _) = read_at(folder.path(), "3dSceneLayer.json", None);
    assert!(sink.problems[0].0 == UNIT_GUESSED && sink.problems[0].1.contains("cubit"), "{:?}", sink.problems);
}

#[test]
fn nodes_that_share_a_geometry_are_few() {
    let folder = tempfile::tempdir().unwrap();
    write_layer(folder.path());
    let mut layer = layer();
    layer["nodePages"]["nodesPerPage"] = 4096.into();
    write(folder.path(), "3dSceneLayer.json", layer.to_string().as_bytes());
    let read = |count: u32| {
        let children: Vec<u32> = (1..=count).collect();
        let mut nodes = vec![node(&children, None)];
        nodes.extend((0..count).map(|_| node(&[], Some(5))));
        write(folder.path(), "nodepages/0.json", json!({"nodes": nodes}).to_string().as_bytes());
        read_at(folder.path(), "3dSceneLayer.json", None)
    };
    let (sink, result) = read(1001);
    assert!(result.is_ok() && sink.objects.len() == 2002, "{result:?}");
    let (_, result) = read(1002);
    assert!(
        matches!(&result, Err(InputError::TooLarge { limit: 1000, what, .. }) if what.contains("nodes/5")),
        "{result:?}"
    );
}

#[test]
fn nodes_outside_of_the_wanted_part_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    write_layer(folder.path());
    let (sink, _) = read_at(folder.path(), "3dSceneLayer.json", Some([7.9, 49.9, 8.1, 50.1]));
    assert_eq!(sink.objects.len(), 2);
    let (sink, result) = read_at(folder.path(), "3dSceneLayer.json", Some([8.1, 49.9, 8.2, 50.1]));
    assert!(result.is_ok() && sink.objects.is_empty());
}

#[test]
fn documents_of_nodes_and_shared_resources_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let attribute = |number: &str, count: u32| json!({"valueType": number, "valuesPerElement": count});
    let layer = json!({
        "layerType": "IntegratedMesh", "spatialReference": {"latestWkid": 25832},
        "store": {"rootNode": "./nodes/root", "defaultGeometrySchema": {
            "header": [{"property": "vertexCount", "type": "UInt32"}, {"property": "featureCount", "type": "UInt32"}],
            "ordering": ["position", "uv0", "color", "region"],
            "vertexAttributes": {"position": attribute("Float32", 3), "uv0": attribute("Float32", 2),
                "color": attribute("UInt8", 4), "region": attribute("UInt16", 4)},
            "featureAttributeOrder": ["id", "faceRange"],
            "featureAttributes": {"id": attribute("UInt64", 1), "faceRange": attribute("UInt32", 2)}
        }}
    });
    let layers = "SceneServer/layers/0";
    let at = |name: &str| format!("{layers}/{name}/index.json");
    write(folder.path(), &format!("{layers}/index.json"), layer.to_string().as_bytes());
    let root =
        json!({"id": "root", "mbs": [0, 0, 0, 9], "children": [{"id": "1", "href": "../1"}, {"id": "../../../x"}]});
    write(folder.path(), &at("nodes/root"), root.to_string().as_bytes());
    let node = json!({"id": "1", "mbs": [400000.0, 5500000.0, 7.0, 9], "geometryData": [{"href": "./geometries/0"}],
        "textureData": [{"href": "./textures/0_0"}], "sharedResource": {"href": "./shared"}});
    write(folder.path(), &at("nodes/1"), node.to_string().as_bytes());
    let shared = json!({"materialDefinitions": {"M": {"params": {"diffuse": [1, 1, 1], "transparency": 0.5}}},
        "textureDefinitions": {"T": {"encoding": ["image/vnd-ms.dds", "image/jpeg"], "wrap": ["repeat", "repeat"],
            "images": [{"size": 4, "href": ["../textures/0_0_1", "../textures/0_0"]}]}}});
    write(folder.path(), &at("nodes/1/shared"), shared.to_string().as_bytes());
    write(folder.path(), &format!("{layers}/nodes/1/geometries/0/index.bin"), &geometry());
    write(folder.path(), &format!("{layers}/nodes/1/textures/0_0/index.jpg"), b"image");
    let (sink, result) = read_at(folder.path(), &format!("{layers}/index.json"), None);
    result.unwrap();
    assert_eq!((sink.crs[0].name.as_str(), sink.objects.len()), ("EPSG:25832", 2));
    assert_eq!((sink.objects[0].id.as_str(), sink.objects[0].kind), ("node 1", FeatureKind::Generic));
    let Shape::Surfaces { meshes, .. } = &sink.objects[0].shape else { panic!() };
    assert_eq!(meshes[0].positions[1], [400000.5, 5500000.0, 7.0]);
    assert_eq!((sink.materials[0].opacity, sink.materials[0].texture.is_some()), (0.5, true));
    assert_eq!(sink.skipped[0].0, "node cannot be read");
}

#[test]
fn buildings_are_read_by_their_overview() {
    let folder = tempfile::tempdir().unwrap();
    let leaf = |id: u32, name: &str| json!({"id": id, "layerType": "3DObject", "name": name, "modelName": name});
    let building = json!({"layerType": "Building", "sublayers": [
        leaf(1, "Overview"), {"layerType": "group", "name": "Full Model", "sublayers": [leaf(2, "Walls"), leaf(3, "Rooms")]}
    ]});
    write(folder.path(), "3dSceneLayer.json", building.to_string().as_bytes());
    write_layer(&folder.path().join("sublayers/1"));
    let (sink, result) = read_at(folder.path(), "3dSceneLayer.json", None);
    result.unwrap();
    assert_eq!((sink.objects.len(), sink.objects[0].source_type.as_str()), (2, "Overview"));
    assert_eq!(sink.skipped.len(), 3, "{:?}", sink.skipped);
}

#[test]
fn a_sublayer_has_the_system_of_its_building() {
    let folder = tempfile::tempdir().unwrap();
    let building = json!({"layerType": "Building", "spatialReference": {"wkid": 25832}, "sublayers": [
        {"id": 1, "layerType": "3DObject", "modelName": "Overview"}]});
    write(folder.path(), "3dSceneLayer.json", building.to_string().as_bytes());
    write_layer(&folder.path().join("sublayers/1"));
    let mut layer = layer();
    layer.as_object_mut().unwrap().remove("spatialReference");
    layer.as_object_mut().unwrap().remove("heightModelInfo");
    write(folder.path(), "sublayers/1/3dSceneLayer.json", layer.to_string().as_bytes());
    let (sink, result) = read_at(folder.path(), "3dSceneLayer.json", None);
    result.unwrap();
    assert_eq!(sink.crs.iter().map(|crs| crs.name.as_str()).collect::<Vec<_>>(), ["EPSG:25832"]);
}

#[test]
fn layers_without_surfaces_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (json, expected) in [("{\"layerType\":\"PointCloud\"}", "PointCloud"), ("{}", "not the document")] {
        write(folder.path(), "3dSceneLayer.json", json.as_bytes());
        let (_, result) = read_at(folder.path(), "3dSceneLayer.json", None);
        let Err(InputError::Unsupported { what, .. }) = result else { panic!("{result:?}") };
        assert!(what.contains(expected), "{what}");
    }
    write(folder.path(), "3dSceneLayer.json", b"{\"layerType\":\"3DObject\"}");
    let (_, result) = read_at(folder.path(), "3dSceneLayer.json", None);
    assert!(matches!(result, Err(InputError::Damaged { .. })), "{result:?}");
}

#[test]
fn cut_and_absurd_geometry_is_skipped_at_every_length() {
    let folder = tempfile::tempdir().unwrap();
    write_layer(folder.path());
    let whole = geometry();
    // If the finer node cannot be read, the coarser one is; then neither.
    for (resource, objects) in [(6, 2), (5, 0)] {
        let name = format!("nodes/{resource}/geometries/1.bin");
        for length in 0..whole.len() {
            write(folder.path(), &name, &whole[..length]);
            let (sink, result) = read_at(folder.path(), "3dSceneLayer.json", None);
            result.unwrap();
            assert_eq!(sink.objects.len(), objects, "{resource} {length}");
        }
        write(folder.path(), &name, &[255; 200]);
        let (_, result) = read_at(folder.path(), "3dSceneLayer.json", None);
        result.unwrap();
    }
    let mut ranges = whole;
    let start = ranges.len() - 16;
    ranges[start..].copy_from_slice(&[255; 16]);
    write(folder.path(), "nodes/6/geometries/1.bin", &ranges);
    let (sink, result) = read_at(folder.path(), "3dSceneLayer.json", None);
    result.unwrap();
    assert_eq!((sink.objects.len(), sink.objects[0].id.as_str()), (1, "node 2"));
}
