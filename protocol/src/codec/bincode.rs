//! bincode for tile headers and manifests.
//!
//! The crate is unmaintained (RUSTSEC-2025-0141). It is used only through these functions, so that it can be
//! replaced.

use crate::error::DecodeError;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Maximum size of a header or manifest in bytes.
pub const LIMIT: usize = 1 << 20;

fn config() -> impl bincode::config::Config {
    bincode::config::standard().with_little_endian().with_limit::<LIMIT>()
}

/// Maximum size of a value that [`long_from_bytes`] reads, in bytes.
pub const LONG_LIMIT: usize = 1 << 30;

/// As [`from_bytes`], for values of the host's own files of up to [`LONG_LIMIT`] bytes.
pub fn long_from_bytes<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, DecodeError> {
    let config = bincode::config::standard().with_little_endian().with_limit::<LONG_LIMIT>();
    let (value, read) = bincode::serde::decode_from_slice(bytes, config)
        .map_err(|_| DecodeError::Invalid("a file's fields are damaged"))?;
    if read != bytes.len() {
        return Err(DecodeError::TrailingBytes(bytes.len() - read));
    }
    Ok(value)
}

/// Serialises a value. Fails if the value has a type that bincode cannot represent.
pub fn to_bytes<T: Serialize>(value: &T) -> Result<Vec<u8>, DecodeError> {
    bincode::serde::encode_to_vec(value, config()).map_err(|_| DecodeError::Invalid("a header cannot be serialised"))
}

/// Deserialises a value from all of `bytes`. Fails on damaged fields, on more than [`LIMIT`] bytes and on trailing
/// bytes.
pub fn from_bytes<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, DecodeError> {
    let (value, read) = bincode::serde::decode_from_slice(bytes, config())
        .map_err(|_| DecodeError::Invalid("a header's fields are damaged"))?;
    if read != bytes.len() {
        return Err(DecodeError::TrailingBytes(bytes.len() - read));
    }
    Ok(value)
}
