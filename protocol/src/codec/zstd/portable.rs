//! A decoder in Rust, for targets without a C compiler.

use crate::error::DecodeError;
use ruzstd::decoding::FrameDecoder;

/// Maximum window of a frame, which bounds memory besides the output: the largest section of a tile.
const MAX_WINDOW_BYTES: u64 = 16 << 20;

/// Always fails: there is no encoder on this target.
#[cfg(target_arch = "wasm32")]
pub fn compress(_: &[u8]) -> Result<Vec<u8>, DecodeError> {
    Err(DecodeError::Unsupported("zstd compression"))
}

/// Decompresses into a buffer and returns the number of bytes. Fails on damaged frames, if the buffer is too small, and
/// on frames whose window is over [`MAX_WINDOW_BYTES`], before it is allocated.
///
/// A frame's own checksum is not verified, because sections carry a CRC-32.
pub(super) fn decompress_into(packed: &[u8], raw: &mut [u8]) -> Result<usize, DecodeError> {
    let mut decoder = FrameDecoder::new();
    decoder.set_max_window_size(MAX_WINDOW_BYTES);
    decoder.decode_all(packed, raw).map_err(|_| DecodeError::Invalid("a zstd frame is damaged"))
}
