//! zstd with the size known before.

use crate::error::DecodeError;

/// zstd frame of `raw`. The level is a constant of the format's encoder, so that a bake is reproducible.
pub fn compress(raw: &[u8]) -> Result<Vec<u8>, DecodeError> {
    zstd::bulk::compress(raw, 19).map_err(|_| DecodeError::Invalid("zstd cannot compress"))
}

/// Exactly `raw_len` bytes, or an error. The caller has checked `raw_len` against a limit: it is what is allocated.
pub fn decompress(packed: &[u8], raw_len: usize) -> Result<Vec<u8>, DecodeError> {
    let raw = zstd::bulk::decompress(packed, raw_len).map_err(|_| DecodeError::Invalid("a zstd frame is damaged"))?;
    if raw.len() != raw_len {
        return Err(DecodeError::Truncated { wanted: raw_len, found: raw.len() });
    }
    Ok(raw)
}
