//! What goes wrong with scratch files.

use std::io;
use std::path::{Path, PathBuf};

/// A scratch file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ScratchError {
    /// The system refuses.
    #[error("{path} cannot be {action}: {cause}")]
    Io {
        /// The folder of the file.
        path: PathBuf,
        /// What fails, as a participle.
        action: &'static str,
        /// The reason.
        cause: io::Error,
    },
    /// The file is not as it was written, or has no such record.
    #[error("a scratch file of records has changed")]
    Damaged,
}

impl ScratchError {
    pub(crate) fn io(path: &Path, action: &'static str, cause: io::Error) -> Self {
        Self::Io { path: path.to_owned(), action, cause }
    }
}
