//! Reads GLBs in tests, and checks what glTF 2.0 demands of them.

use meshoptimizer_rs::Workspace;
use meshoptimizer_rs::codec::{decode_index_buffer, decode_vertex_buffer};
use serde_json::Value;

/// A parsed GLB.
pub(crate) struct Glb {
    pub(crate) json: Value,
    binary: Vec<u8>,
}

fn u32_at(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

fn number(json: &Value, member: &str) -> usize {
    json[member].as_u64().unwrap_or(0) as usize
}

fn component_bytes(component_type: &Value) -> usize {
    match component_type.as_u64().unwrap() {
        5121 => 1,
        5123 => 2,
        5125 | 5126 => 4,
        other => panic!("component type {other}"),
    }
}

fn components(accessor: &Value) -> usize {
    match accessor["type"].as_str().unwrap() {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" => 4,
        other => panic!("type {other}"),
    }
}

impl Glb {
    /// Parses header and chunks, and checks every buffer view and accessor.
    pub(crate) fn parse(bytes: &[u8]) -> Self {
        assert_eq!(&bytes[..4], b"glTF");
        assert_eq!((u32_at(bytes, 4), u32_at(bytes, 8)), (2, bytes.len()));
        let json_bytes = u32_at(bytes, 12);
        assert_eq!((&bytes[16..20], json_bytes % 4), (&b"JSON"[..], 0));
        let json: Value = serde_json::from_slice(&bytes[20..20 + json_bytes]).unwrap();
        let rest = &bytes[20 + json_bytes..];
        let mut binary = Vec::new();
        if !rest.is_empty() {
            assert_eq!((&rest[4..8], u32_at(rest, 0)), (&b"BIN\0"[..], rest.len() - 8));
            assert_eq!(rest.len() % 4, 0);
            binary = rest[8..].to_vec();
            assert!(binary.len() - number(&json["buffers"][0], "byteLength") < 4);
        }
        let glb = Self { json, binary };
        glb.check_views();
        glb.list("accessors").iter().for_each(|accessor| glb.check_accessor(accessor));
        glb
    }

    pub(crate) fn list(&self, member: &str) -> &[Value] {
        self.json[member].as_array().map_or(&[], Vec::as_slice)
    }

    fn check_views(&self) {
        for view in self.list("bufferViews") {
            let buffer = &self.json["buffers"][number(view, "buffer")];
            assert!(number(view, "byteOffset") + number(view, "byteLength") <= number(buffer, "byteLength"));
            assert!(number(view, "byteLength") > 0);
            assert_eq!(number(view, "byteStride") % 4, 0);
        }
    }

    fn check_accessor(&self, accessor: &Value) {
        let view = &self.json["bufferViews"][number(accessor, "bufferView")];
        let element = components(accessor) * component_bytes(&accessor["componentType"]);
        let stride = if view["byteStride"].is_null() { element } else { number(view, "byteStride") };
        let (offset, count) = (number(accessor, "byteOffset"), number(accessor, "count"));
        assert!(count > 0 && offset + (count - 1) * stride + element <= number(view, "byteLength"));
        assert_eq!((offset + number(view, "byteOffset")) % component_bytes(&accessor["componentType"]), 0);
    }

    /// The bytes of a view, decompressed.
    pub(crate) fn view(&self, index: usize) -> Vec<u8> {
        let view = &self.json["bufferViews"][index];
        let packed = &view["extensions"]["EXT_meshopt_compression"];
        let place = if packed.is_null() { view } else { packed };
        let (start, length) = (number(place, "byteOffset"), number(place, "byteLength"));
        let bytes = &self.binary[start..start + length];
        if packed.is_null() {
            return bytes.to_vec();
        }
        let (count, stride) = (number(packed, "count"), number(packed, "byteStride"));
        let mut workspace = Workspace::default();
        let decoded = match packed["mode"].as_str().unwrap() {
            "ATTRIBUTES" => decode_vertex_buffer(count, stride, bytes, &mut workspace),
            _ => decode_index_buffer(count, stride, bytes, &mut workspace),
        };
        let decoded = decoded.unwrap();
        assert_eq!(decoded.len(), number(view, "byteLength"));
        decoded
    }

    /// The elements of an accessor as numbers.
    pub(crate) fn elements(&self, index: usize) -> Vec<Vec<f64>> {
        let accessor = &self.json["accessors"][index];
        let view = number(accessor, "bufferView");
        let bytes = self.view(view);
        let component_type = &accessor["componentType"];
        let size = component_bytes(component_type);
        let stride = &self.json["bufferViews"][view]["byteStride"];
        let stride = stride.as_u64().map_or(size * components(accessor), |stride| stride as usize);
        let value = |at: usize| match component_type.as_u64().unwrap() {
            5121 => f64::from(bytes[at]),
            5123 => f64::from(u16::from_le_bytes([bytes[at], bytes[at + 1]])),
            5125 => u32_at(&bytes, at) as f64,
            _ => f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())),
        };
        let element = |i: usize| {
            let start = number(accessor, "byteOffset") + i * stride;
            (0..components(accessor)).map(|k| value(start + k * size)).collect()
        };
        (0..number(accessor, "count")).map(element).collect()
    }

    /// Checks the primitives: bounds of positions, indices, feature ids and their table. Returns the number of triangles.
    pub(crate) fn check_primitives(&self) -> usize {
        let rows = number(&self.json["extensions"]["EXT_structural_metadata"]["propertyTables"][0], "count");
        let mut triangles = 0;
        for primitive in self.list("meshes").iter().flat_map(|mesh| mesh["primitives"].as_array().unwrap()) {
            let position = number(&primitive["attributes"], "POSITION");
            let positions = self.elements(position);
            for k in 0..3 {
                let axis = || positions.iter().map(|p| p[k]);
                let accessor = &self.json["accessors"][position];
                assert_eq!(accessor["min"][k].as_f64(), axis().reduce(f64::min));
                assert_eq!(accessor["max"][k].as_f64(), axis().reduce(f64::max));
            }
            let indices = self.elements(number(primitive, "indices"));
            assert!(indices.iter().all(|index| (index[0] as usize) < positions.len()));
            assert_eq!(indices.len() % 3, 0);
            triangles += indices.len() / 3;
            if let Some(feature) = primitive["attributes"]["_FEATURE_ID_0"].as_u64() {
                let set = &primitive["extensions"]["EXT_mesh_features"]["featureIds"][0];
                let features = self.elements(feature as usize);
                assert_eq!(features.len(), positions.len());
                let is_known = |id: f64| (id as usize) < rows || set["nullFeatureId"].as_f64() == Some(id);
                assert!(features.iter().all(|feature| is_known(feature[0])));
            }
        }
        triangles
    }

    /// Values of a property of the table, as texts.
    pub(crate) fn column(&self, property: &str) -> Vec<String> {
        let metadata = &self.json["extensions"]["EXT_structural_metadata"];
        let table = &metadata["propertyTables"][0];
        let class = &metadata["schema"]["classes"]["object"]["properties"][property];
        let column = &table["properties"][property];
        let values = self.view(number(column, "values"));
        let rows = number(table, "count");
        let f64_at = |i: usize| f64::from_le_bytes(values[8 * i..8 * i + 8].try_into().unwrap());
        let value = |i: usize| match (class["type"].as_str().unwrap(), class["componentType"].as_str()) {
            ("STRING", _) => {
                assert_eq!(column["stringOffsetType"], "UINT16");
                let ends = self.view(number(column, "stringOffsets"));
                let end = |i: usize| usize::from(u16::from_le_bytes([ends[2 * i], ends[2 * i + 1]]));
                String::from_utf8(values[end(i)..end(i + 1)].to_vec()).unwrap()
            }
            ("ENUM", _) => values[i].to_string(),
            (_, Some("UINT32")) => u32_at(&values, 4 * i).to_string(),
            (_, Some("INT32")) => (u32_at(&values, 4 * i) as u32 as i32).to_string(),
            (_, Some("FLOAT64")) => f64_at(i).to_string(),
            other => panic!("{other:?}"),
        };
        (0..rows).map(value).collect()
    }

    /// World positions of all vertices by the matrices of nodes, as glTF coordinates.
    pub(crate) fn scene_positions(&self) -> Vec<[f64; 3]> {
        let mut out = Vec::new();
        let mut stack: Vec<(usize, Vec<Vec<f64>>)> = self.json["scenes"][0]["nodes"]
            .as_array()
            .unwrap()
            .iter()
            .map(|n| (n.as_u64().unwrap() as usize, vec![]))
            .collect();
        while let Some((node, mut above)) = stack.pop() {
            let node = &self.json["nodes"][node];
            above.push(node["matrix"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect());
            for child in node["children"].as_array().into_iter().flatten() {
                stack.push((child.as_u64().unwrap() as usize, above.clone()));
            }
            let Some(mesh) = node["mesh"].as_u64() else { continue };
            let position = number(&self.json["meshes"][mesh as usize]["primitives"][0]["attributes"], "POSITION");
            for p in self.elements(position) {
                let mut p = [p[0], p[1], p[2]];
                for m in above.iter().rev() {
                    p = [0, 1, 2].map(|k| m[k] * p[0] + m[4 + k] * p[1] + m[8 + k] * p[2] + m[12 + k]);
                }
                out.push(p);
            }
        }
        out
    }
}
