//! Errors of decoding and encoding.

/// Why bytes cannot be decoded, or a value cannot be encoded.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    #[error("not an Insula tile: the magic bytes are missing")]
    Magic,
    #[error("format version {found}, this program reads {known}: bake again, or update")]
    Version { found: u16, known: u16 },
    #[error("tile of kind {found} where {wanted} was expected")]
    TileKind { found: u8, wanted: u8 },
    #[error("truncated: {wanted} bytes announced, {found} found")]
    Truncated { wanted: usize, found: usize },
    #[error("{0} unexpected bytes at the end")]
    TrailingBytes(usize),
    /// A checksum differs. The name says of what.
    #[error("checksum of {0} differs: the bytes are damaged, fetch them again")]
    Checksum(&'static str),
    /// A number exceeds a limit of the format.
    #[error("{what} is {found}, the format's limit is {limit}")]
    Limit { what: &'static str, found: u64, limit: u64 },
    /// This build lacks an ability.
    #[error("{0} is not available in this build")]
    Unsupported(&'static str),
    /// A rule of the format is broken. The text says which.
    #[error("{0}")]
    Invalid(&'static str),
}

/// Fails with [`DecodeError::Limit`] if `found` is above `limit`.
pub fn check_limit(what: &'static str, found: usize, limit: usize) -> Result<(), DecodeError> {
    if found > limit { Err(DecodeError::Limit { what, found: found as u64, limit: limit as u64 }) } else { Ok(()) }
}

/// Fails with [`DecodeError::Invalid`] if a rule of the format is broken.
#[inline]
pub fn invalid_if(is_broken: bool, rule: &'static str) -> Result<(), DecodeError> {
    if is_broken { Err(DecodeError::Invalid(rule)) } else { Ok(()) }
}
