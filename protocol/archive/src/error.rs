//! What can be wrong with sources, archives and cities. Each text is one line.

use std::time::Duration;

/// Why bytes cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ReadError {
    /// The object does not exist.
    #[error("there is no such object")]
    Missing,
    /// The source is overloaded or failing for now.
    #[error("the source answers {status}")]
    Busy {
        /// HTTP status code.
        status: u16,
        /// Value of the `Retry-After` header.
        retry_after: Option<Duration>,
    },
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
    /// Another file format, or another version of it.
    #[error("not a PMTiles v3 archive")]
    Magic,
    /// The file ends before one of its sections.
    #[error("truncated: {section} ends at byte {end}, the file has {length} bytes")]
    Truncated {
        /// Name of the section.
        section: &'static str,
        /// Where the header says that it ends.
        end: u64,
        /// Length of the file in bytes.
        length: u64,
    },
    /// A compression that the bake does not write.
    #[error("its {0} are compressed in a way that this program does not read")]
    Compression(&'static str),
    /// A directory that no writer makes.
    #[error("damaged directory: {0}")]
    Directory(&'static str),
    /// More tiles than the program holds in memory, or than the file has bytes.
    #[error("its directory is over the limit of {0} tiles")]
    TooMany(u64),
    /// A read failed.
    #[error(transparent)]
    Read(#[from] ReadError),
}

/// Why a city cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum CityError {
    /// A file is missing or cannot be read.
    #[cfg(feature = "fs")]
    #[error("cannot read {}: {source}; is the path right?", path.display())]
    Io {
        /// The file.
        path: std::path::PathBuf,
        /// What the operating system says.
        source: std::io::Error,
    },
    /// `city.json` is damaged, or of another version.
    #[error("cannot use {location}: {reason}; bake the city again")]
    Manifest {
        /// Path or address of the manifest.
        location: String,
        /// What is wrong with it.
        reason: String,
    },
    /// An archive is damaged, or not of this city.
    #[error("cannot use {location}: {source}; copy or bake the city again")]
    Archive {
        /// Path or address of the archive.
        location: String,
        /// What is wrong with it.
        source: ArchiveError,
    },
}
