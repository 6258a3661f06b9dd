//! Decodes meshes.

use insula_viewer::decode;
use insula_viewer::transfer::to_bytes;
use insula_web_host::console;
use insula_web_host::host::{tile_key, to_js};
use wasm_bindgen::prelude::*;

/// Runs once in each worker.
#[wasm_bindgen(start)]
pub fn start() {
    console::start();
}

/// Decodes a mesh for the viewer of another worker. Fails with the reason.
#[wasm_bindgen]
pub fn decode_mesh(key: &[u32], bytes: &[u8]) -> Result<Vec<u8>, JsError> {
    let mesh = decode::decode_mesh(tile_key(key)?, bytes).map_err(to_js)?;
    to_bytes(&mesh).map_err(to_js)
}
