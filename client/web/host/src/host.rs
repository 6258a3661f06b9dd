//! What the modules need from the page: `page/engine-core.js` implements it.

use insula_protocol::TileId;
use insula_viewer::scene::TileKey;
use js_sys::{Promise, Uint8Array};
use wasm_bindgen::prelude::*;

#[wasm_bindgen]
extern "C" {
    /// The engine's services.
    #[derive(Debug, Clone)]
    pub type Host;

    /// Fetches a URL, or a range of it (`bytes=0-99`), of at most `limit` bytes. `request` is a number for [`Host::abort`].
    /// Resolves to a [`Response`] and never rejects.
    #[wasm_bindgen(method)]
    pub fn fetch(this: &Host, url: &str, range: Option<String>, limit: f64, request: u32) -> Promise;

    /// Gives up a request.
    #[wasm_bindgen(method)]
    pub fn abort(this: &Host, request: u32);

    /// Makes the requests of the next half minute pass the browser's caches by: one of them has damaged bytes.
    #[wasm_bindgen(method, js_name = bypassCaches)]
    pub fn bypass_caches(this: &Host);

    /// Decodes a tile in a worker, which has [`key_numbers`] of it. Resolves to the bytes of `decode_tile` or `decode_mesh`, or rejects
    /// with the reason; with `isTemporary` if it is not the tile's.
    #[wasm_bindgen(method)]
    pub fn decode(this: &Host, key: &[u32], bytes: Uint8Array) -> Promise;

    /// Fetches the text for [`insula_shaders::wgsl::load`]. Rejects with the reason.
    #[wasm_bindgen(method)]
    pub fn shaders(this: &Host) -> Promise;

    /// A tile has arrived: a frame is due.
    #[wasm_bindgen(method)]
    pub fn wake(this: &Host);

    /// An answer to [`Host::fetch`].
    pub type Response;

    /// HTTP status; 0 if there was no answer.
    #[wasm_bindgen(method, getter)]
    pub fn status(this: &Response) -> u16;

    /// Why there was no answer, or none of at most the limit.
    #[wasm_bindgen(method, getter)]
    pub fn error(this: &Response) -> Option<String>;

    /// Whether the body had more bytes than the limit.
    #[wasm_bindgen(method, getter, js_name = tooLong)]
    pub fn too_long(this: &Response) -> bool;

    /// The body.
    #[wasm_bindgen(method, getter)]
    pub fn bytes(this: &Response) -> Uint8Array;

    /// A header of the answer.
    #[wasm_bindgen(method)]
    pub fn header(this: &Response, name: &str) -> Option<String>;
}

/// An error for JavaScript with the same text.
pub fn to_js(error: impl std::fmt::Display) -> JsError {
    JsError::new(&error.to_string())
}

/// A tile's key as numbers: kind (0 V-BlockMap, 2 mesh), level, x, y, level of detail.
pub fn key_numbers(key: TileKey) -> [u32; 5] {
    let kind = if key == TileKey::block_map(key.id) { 0 } else { 2 };
    [kind, u32::from(key.id.level()), key.id.x(), key.id.y(), u32::from(key.lod)]
}

/// The key of [`key_numbers`]. Fails if it is none.
pub fn tile_key(numbers: &[u32]) -> Result<TileKey, JsError> {
    let &[kind, level, x, y, lod] = numbers else { return Err(JsError::new("a key has five numbers")) };
    let (Ok(level), Ok(lod)) = (u8::try_from(level), u8::try_from(lod)) else {
        return Err(JsError::new("level or level of detail is too large"));
    };
    let id = TileId::new(level, x, y).ok_or_else(|| JsError::new("no such node"))?;
    Ok(if kind == 0 { TileKey::block_map(id) } else { TileKey::mesh(id, lod) })
}
