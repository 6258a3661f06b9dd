//! bincode, for headers and manifests only. The crate is no longer maintained (RUSTSEC-2025-0141): it stays behind these
//! two functions, so that another could take its place in a day.

use crate::error::DecodeError;
use serde::{Serialize, de::DeserializeOwned};

/// Largest header or manifest in bytes.
pub const LIMIT: usize = 1 << 20;

fn config() -> impl bincode::config::Config {
    bincode::config::standard().with_little_endian().with_limit::<LIMIT>()
}

/// Any serde value as bytes.
pub fn to_bytes<T: Serialize>(value: &T) -> Result<Vec<u8>, DecodeError> {
    bincode::serde::encode_to_vec(value, config()).map_err(|_| DecodeError::Invalid("a header cannot be written"))
}

/// The value that all of `bytes` are; what is left over is an error.
pub fn from_bytes<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, DecodeError> {
    let (value, read) = bincode::serde::decode_from_slice(bytes, config())
        .map_err(|_| DecodeError::Invalid("a header cannot be read: its fields are damaged"))?;
    if read != bytes.len() {
        return Err(DecodeError::TrailingBytes(bytes.len() - read));
    }
    Ok(value)
}
