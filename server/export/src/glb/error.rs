//! Why an export in glTF or 3D Tiles fails.

use crate::source::SourceError;

/// Why a GLB, a tile or a tileset cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// A tile or block of the city cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The place that is written to fails, such as a full disk.
    #[error("{what} cannot be written: {source}")]
    Write { what: String, source: std::io::Error },
    /// The result does not fit its format.
    #[error("{what} has {bytes} bytes, the format's limit is 4 GiB: export a smaller area, or 3D Tiles")]
    TooLarge { what: String, bytes: usize },
    /// No triangle is selected.
    #[error("nothing to export: {0}")]
    Nothing(&'static str),
    /// The city has data that cannot be expressed.
    #[error("cannot be encoded: {0}")]
    Encode(String),
}

impl ExportError {
    /// A failed write to `what`, as a function for `map_err`.
    pub(crate) fn writing(what: impl Into<String>) -> impl FnOnce(std::io::Error) -> Self {
        let what = what.into();
        move |source| Self::Write { what, source }
    }
}
