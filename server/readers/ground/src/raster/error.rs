//! Why a raster cannot be read.

use std::io;

/// Why a raster cannot be read.
#[derive(Debug, thiserror::Error)]
pub(crate) enum RasterError {
    #[error("not a raster of a known format")]
    NotThisFormat,
    #[error("the raster is damaged: {0}")]
    Damaged(String),
    #[error("the raster has {0}, which is not supported")]
    Unsupported(String),
    #[error("the raster is too large: {what} is more than {limit}")]
    TooLarge { what: &'static str, limit: u64 },
    #[error("the raster does not have the wanted pixels")]
    Outside,
    #[error("the raster cannot be read: {0}")]
    Io(io::Error),
}

impl RasterError {
    /// Shorthand for the most frequent error.
    pub(super) fn damaged(what: impl Into<String>) -> Self {
        Self::Damaged(what.into())
    }

    pub(super) fn unsupported(what: impl Into<String>) -> Self {
        Self::Unsupported(what.into())
    }
}

impl From<io::Error> for RasterError {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::UnexpectedEof => Self::damaged("it ends too early"),
            io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => Self::Damaged(error.to_string()),
            _ => Self::Io(error),
        }
    }
}
