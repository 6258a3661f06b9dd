//! What can go wrong in the client, each in one line: what, where, what to do.

use std::path::PathBuf;

/// Why a command ended without doing what was asked.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// Something that was typed, or a file that was handed in, means nothing: exit code 2.
    #[error("{0}")]
    Usage(String),
    /// A file could not be read or written.
    #[error("{path}: {source}: check that the path exists and may be used", path = path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The server did not answer, or not with what was asked for.
    #[error("{0}")]
    Server(String),
    /// No window, no device, no picture.
    #[error("{0}")]
    Graphics(String),
    /// Everything else.
    #[error("{0}")]
    Failed(String),
}

impl ClientError {
    /// The process's exit code: 1 failed, 2 usage.
    pub fn exit_code(&self) -> u8 {
        if matches!(self, Self::Usage(_)) { 2 } else { 1 }
    }

    /// For `map_err` on file operations.
    pub fn file(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |source| Self::File { path: path.to_owned(), source }
    }
}

/// Shorthand.
pub type Result<T, E = ClientError> = std::result::Result<T, E>;
