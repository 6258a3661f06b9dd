//! What can be wrong with sources, archives and cities. Each text is one line.

use std::time::Duration;

/// Why bytes cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ReadError {
    #[error("there is no such object")]
    Missing,
    /// The source is overloaded or failing for now; HTTP status and `Retry-After`.
    #[error("the source answers {status}")]
    Busy { status: u16, retry_after: Option<Duration> },
    /// The operating system, the store or the network failed. A retry may succeed.
    #[error("cannot read: {0}")]
    Failed(String),
    /// The bytes are not those that were written.
    #[error("damaged: {0}")]
    Damaged(String),
    /// The object is not the one that was opened.
    #[error("the object was replaced after it was opened")]
    Replaced,
    /// The source can never be read; a retry would not help.
    #[error("{0}")]
    Unusable(String),
}

impl From<std::io::Error> for ReadError {
    fn from(error: std::io::Error) -> Self {
        Self::Failed(error.to_string())
    }
}

/// Why an archive cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ArchiveError {
    #[error("not a PMTiles v3 archive")]
    Magic,
    /// A section ends behind the end of the file.
    #[error("truncated: {section} ends at byte {end}, the file has {length} bytes")]
    Truncated { section: &'static str, end: u64, length: u64 },
    #[error("its {0} use a compression that this program does not support")]
    Compression(&'static str),
    #[error("damaged directory: {0}")]
    Directory(&'static str),
    /// More tiles than an archive may have, or than the file has bytes.
    #[error("its directory exceeds the limit of {0} tiles")]
    TooMany(u64),
    /// Archive and manifest are of different bakes.
    #[error("it is of another version of the city than city.json")]
    OtherVersion,
    #[error("its directories could not be read in time")]
    TooSlow,
    #[error(transparent)]
    Read(#[from] ReadError),
}

impl From<ArchiveError> for ReadError {
    fn from(error: ArchiveError) -> Self {
        match error {
            ArchiveError::Read(error) => error,
            ArchiveError::OtherVersion => Self::Replaced,
            other => Self::Damaged(other.to_string()),
        }
    }
}

/// Why a city cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum CityError {
    #[cfg(feature = "fs")]
    #[error("cannot read {}: {source}; check the path", path.display())]
    Io { path: std::path::PathBuf, source: std::io::Error },
    #[error("cannot use {location}: {reason}; bake the city again")]
    Manifest { location: String, reason: String },
    /// It shares tiles with a city that is not there.
    #[error(
        "cannot use {location}: it shares tiles with the city {name}, which is not beside it; put the folder {name} there"
    )]
    NotBeside { location: String, name: String },
    #[error("cannot use {location}: {source}; copy or bake the city again")]
    Archive { location: String, source: ArchiveError },
}
