//! Decodes V-BlockMaps in a worker.

use insula_viewer::decode::decode_block_map;
use insula_viewer::transfer::to_bytes;
use insula_web_host::host::{tile_key, to_js};
use wasm_bindgen::prelude::*;

/// Decodes a V-BlockMap for the viewer of another worker. Fails with the reason.
#[wasm_bindgen]
pub fn decode_tile(key: &[u32], bytes: &[u8]) -> Result<Vec<u8>, JsError> {
    let tile = decode_block_map(tile_key(key)?.id, bytes).map_err(to_js)?;
    to_bytes(&tile).map_err(to_js)
}
