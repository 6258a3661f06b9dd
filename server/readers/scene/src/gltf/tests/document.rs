//! A small document that tests change.

use super::super::{GltfOptions, GltfScene, decode};
use insula_source::error::InputError;
use serde_json::{Value, json};
use std::io;

/// Corners of a square on the ground, counter-clockwise from above.
pub(super) const QUAD: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, -1.0], [0.0, 0.0, -1.0]];

pub(super) const OPTIONS: GltfOptions = GltfOptions { max_bytes: 1 << 20, max_vertices: 1 << 14, loads_images: false };

/// JSON, and the content of its only buffer.
#[derive(Clone)]
pub(crate) struct Document {
    pub(crate) json: Value,
    pub(crate) buffer: Vec<u8>,
}

impl Document {
    /// A node `house` with a mesh of one square.
    pub(super) fn quad() -> Self {
        let json = json!({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
            "nodes": [{"name": "house", "mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
                {"bufferView": 1, "componentType": 5121, "count": 6, "type": "SCALAR"}],
            "bufferViews": [], "buffers": [{}]});
        let mut document = Self { json, buffer: Vec::new() };
        document.add_view(&QUAD.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<_>>());
        document.add_view(&[0, 1, 2, 0, 2, 3]);
        document
    }

    /// Adds bytes, and returns the number of their buffer view.
    pub(crate) fn add_view(&mut self, bytes: &[u8]) -> usize {
        self.buffer.resize(self.buffer.len().next_multiple_of(4), 0);
        let view = json!({"buffer": 0, "byteOffset": self.buffer.len(), "byteLength": bytes.len()});
        self.buffer.extend(bytes);
        push(&mut self.json["bufferViews"], view)
    }

    pub(super) fn add_accessor(&mut self, accessor: Value) -> usize {
        push(&mut self.json["accessors"], accessor)
    }

    pub(crate) fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"][0]["byteLength"] = self.buffer.len().into();
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut binary = self.buffer.clone();
        binary.resize(binary.len().next_multiple_of(4), 0);
        let mut glb = b"glTF".to_vec();
        let words = [2, 28 + text.len() + binary.len(), text.len(), 0x4e4f_534a];
        glb.extend(words.iter().flat_map(|word| (*word as u32).to_le_bytes()));
        glb.extend(text);
        glb.extend((binary.len() as u32).to_le_bytes());
        glb.extend(0x004e_4942u32.to_le_bytes());
        glb.extend(binary);
        glb
    }

    pub(super) fn json_with_data_uri(&self) -> String {
        use base64::Engine;
        let mut json = self.json.clone();
        let content = base64::engine::general_purpose::STANDARD.encode(&self.buffer);
        json["buffers"][0]["uri"] = format!("data:application/octet-stream;base64,{content}").into();
        json.to_string()
    }
}

fn push(list: &mut Value, item: Value) -> usize {
    let list = list.as_array_mut().expect("a list");
    list.push(item);
    list.len() - 1
}

pub(super) fn decode_bytes(bytes: &[u8]) -> Result<GltfScene, InputError> {
    decode("city.glb", bytes, &|_| Err(io::ErrorKind::NotFound.into()), &OPTIONS)
}

pub(super) fn decode_document(document: &Document) -> Result<GltfScene, InputError> {
    decode_bytes(&document.glb())
}

pub(super) fn decode_json(json: &str) -> Result<GltfScene, InputError> {
    decode_bytes(json.as_bytes())
}
