//! Decodes tiles in a worker.

use insula_protocol::TileId;
use insula_viewer::scene::TileKey;
use insula_viewer::transfer;
use wasm_bindgen::prelude::*;

/// Decodes a V-BlockMap (kind 0) or a mesh (kind 2) for the viewer of another worker. Fails with the reason.
#[wasm_bindgen]
pub fn decode_tile(key: &[u32], bytes: &[u8]) -> Result<Vec<u8>, JsError> {
    let &[kind, level, x, y, lod] = key else { return Err(JsError::new("a key has five numbers")) };
    let (Ok(level), Ok(lod)) = (u8::try_from(level), u8::try_from(lod)) else {
        return Err(JsError::new("level or level of detail is too large"));
    };
    let id = TileId::new(level, x, y).ok_or_else(|| JsError::new("no such node"))?;
    let key = if kind == 0 { TileKey::block_map(id) } else { TileKey::mesh(id, lod) };
    transfer::decode_to_bytes(key, bytes).map_err(|error| JsError::new(&error.to_string()))
}

pub(crate) fn key_numbers(key: TileKey) -> [u32; 5] {
    let kind = if key == TileKey::block_map(key.id) { 0 } else { 2 };
    [kind, u32::from(key.id.level()), key.id.x(), key.id.y(), u32::from(key.lod)]
}
