//! The reference library.

use crate::error::DecodeError;

/// The level is a constant of the format's encoder, so that a bake is reproducible.
const LEVEL: i32 = 19;

/// Compresses to one frame. Fails only if the library runs out of memory.
pub fn compress(raw: &[u8]) -> Result<Vec<u8>, DecodeError> {
    zstd::bulk::compress(raw, LEVEL).map_err(|_| DecodeError::Invalid("zstd compression failed"))
}

/// Decompresses into a buffer and returns the number of bytes. Fails on damaged frames and if the buffer is too small.
pub(super) fn decompress_into(packed: &[u8], raw: &mut [u8]) -> Result<usize, DecodeError> {
    zstd::bulk::decompress_to_buffer(packed, raw).map_err(|_| DecodeError::Invalid("a zstd frame is damaged"))
}
