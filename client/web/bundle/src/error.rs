//! Why a bundle cannot be made.

use std::{
    fmt, io,
    path::{Path, PathBuf},
};

/// What failed, where, and what to do.
#[derive(Debug)]
pub(crate) enum BundleError {
    /// A file or folder cannot be read or written.
    Io { path: PathBuf, cause: io::Error },
    /// The module cannot be bound.
    Bindings(String),
    /// A file cannot be an asset.
    Asset(String),
}

impl BundleError {
    /// For `map_err`.
    pub(crate) fn io(path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        |cause| Self::Io { path, cause }
    }
}

impl fmt::Display for BundleError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io { path, cause } => write!(f, "{}: {cause}", path.display()),
            Self::Bindings(reason) => write!(f, "the module cannot be bound: {reason}"),
            Self::Asset(reason) => f.write_str(reason),
        }
    }
}
