//! The text form of glTF (2.0, section 3.6.1): JSON, with the bytes as a data URI.

use super::ExportError;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::Value;

/// Bytes of the header, and of the head of a chunk.
const HEADER_BYTES: usize = 12;
const CHUNK_HEAD_BYTES: usize = 8;

/// The text of a model that [`super::write_glb`] wrote. Fails if it did not.
pub fn gltf_of_glb(glb: &[u8]) -> Result<String, ExportError> {
    let wrong = || ExportError::Encode("a GLB cannot be written as text".to_owned());
    let (json, rest) = chunk(glb.get(HEADER_BYTES..).ok_or_else(wrong)?).ok_or_else(wrong)?;
    let mut model: Value = serde_json::from_slice(json).map_err(|error| ExportError::Encode(error.to_string()))?;
    if let (Some((bytes, _)), Some(buffer)) = (chunk(rest), model.pointer_mut("/buffers/0")) {
        buffer["uri"] = format!("data:application/octet-stream;base64,{}", STANDARD.encode(bytes)).into();
        buffer["byteLength"] = bytes.len().into();
    }
    Ok(model.to_string())
}

/// The bytes of the first chunk, and what follows it.
fn chunk(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let length = u32::from_le_bytes(*bytes.first_chunk()?) as usize;
    bytes.get(CHUNK_HEAD_BYTES..)?.split_at_checked(length)
}
