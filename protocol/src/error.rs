//! What can be wrong with bytes.

/// Why bytes are not what they claim to be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// The first bytes are not an Insula tile's.
    #[error("not an Insula tile: it does not begin with the tile magic")]
    Magic,
    /// Written by a program newer (or older) than this one.
    #[error("format version {found}, this program reads {known}: bake again, or update")]
    Version {
        /// In the bytes.
        found: u16,
        /// By this program.
        known: u16,
    },
    /// A tile of another kind than was asked for.
    #[error("tile of kind {found} where {wanted} was expected")]
    TileKind {
        /// In the bytes.
        found: u8,
        /// By the caller.
        wanted: u8,
    },
    /// Fewer bytes than announced.
    #[error("truncated: {wanted} bytes announced, {found} there")]
    Truncated {
        /// Announced.
        wanted: usize,
        /// There.
        found: usize,
    },
    /// More bytes than announced.
    #[error("{0} bytes too many at the end")]
    TrailingBytes(usize),
    /// A checksum differs.
    #[error("checksum of {0} differs: the bytes are damaged, fetch them again")]
    Checksum(&'static str),
    /// A number is over the limit that the format states.
    #[error("{what} is {found}, the format's limit is {limit}")]
    Limit {
        /// Which number.
        what: &'static str,
        /// In the bytes.
        found: u64,
        /// In the format.
        limit: u64,
    },
    /// Bytes that no encoder writes.
    #[error("{0}")]
    Invalid(&'static str),
}
