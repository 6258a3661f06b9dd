//! Errors of the client. Each is one line that says what failed, where, and what to do.

use std::path::{Path, PathBuf};

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// An argument or an input file is invalid. Exit code 2.
    #[error("{0}")]
    Usage(String),
    /// A file could not be read or written.
    #[error("{path}: {source}: check that the path exists and is accessible", path = path.display())]
    File { path: PathBuf, source: std::io::Error },
    /// The server did not respond, or its response cannot be used.
    #[error("{0}")]
    Server(String),
    /// There is no window, no usable GPU, or no surface to draw to.
    #[error("{0}")]
    Graphics(String),
    /// Any other failure.
    #[error("{0}")]
    Failed(String),
}

impl ClientError {
    /// Exit code of the process: 2 for usage errors, 1 for all others.
    pub fn exit_code(&self) -> u8 {
        if matches!(self, Self::Usage(_)) { 2 } else { 1 }
    }

    /// Converts an I/O error on `path`, for `map_err`.
    pub fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |source| Self::File { path: path.to_owned(), source }
    }
}

/// `Result` with [`ClientError`] as the default error.
pub type Result<T, E = ClientError> = std::result::Result<T, E>;
