//! What can be wrong with a city's folder. Each text is one line: what, where, what to do.

use super::source::ReadError;
use std::path::PathBuf;

/// Why a city cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The operating system says no.
    #[error("cannot read {}: {source}; is the path right?", path.display())]
    Io {
        /// What was to be read.
        path: PathBuf,
        /// Why it could not.
        source: std::io::Error,
    },
    /// Neither a city nor a folder of cities.
    #[error("no city in {}: there is no city.json in it or one folder below; make one with `insula-server bake`", .0.display())]
    NoCity(PathBuf),
    /// `city.json` is no manifest that this program serves.
    #[error("cannot use {place}: {reason}; bake the city again")]
    Manifest {
        /// The manifest.
        place: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A tile archive is damaged.
    #[error("cannot use {place}: {source}; copy or bake the city again")]
    Archive {
        /// The archive.
        place: String,
        /// What is wrong with it.
        source: ArchiveError,
    },
    /// URLs could not tell two cities apart.
    #[error("two cities are named {name:?}: {first} and {second}; bake one with another --name")]
    SameName {
        /// The name.
        name: String,
        /// One place.
        first: String,
        /// The other.
        second: String,
    },
    /// A store does not give a city.
    #[error("cannot read {url}: {reason}; is the address right, and may this machine read it?")]
    Remote {
        /// What was to be read.
        url: String,
        /// Why it could not.
        reason: String,
    },
    /// The folder for blocks cannot be used.
    #[error("cannot use cache.folder {}: {source}; give another one", path.display())]
    Cache {
        /// The folder.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// Something replaces the city at this moment.
    #[error("cannot open {place}: it keeps being replaced while it is read; try again")]
    Changing {
        /// The city.
        place: String,
    },
}

/// Why a file is no tile archive that this program serves.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ArchiveError {
    /// Another file, or another version.
    #[error("not a PMTiles v3 archive")]
    Magic,
    /// The file ends too early.
    #[error("truncated: {what} reaches to byte {wanted}, the file has {found}")]
    Truncated {
        /// Which part.
        what: &'static str,
        /// Where it ends.
        wanted: u64,
        /// Where the file ends.
        found: u64,
    },
    /// Packed in a way that our bake does not write.
    #[error("its {0} are compressed in a way that this program does not read")]
    Compression(&'static str),
    /// Bytes that no writer makes.
    #[error("damaged directory: {0}")]
    Directory(&'static str),
    /// The system or the store does not give it.
    #[error("{0}")]
    Unreadable(String),
    /// More than the program is willing to hold in memory.
    #[error("its directory is over the limit of {0} tiles")]
    TooMany(usize),
}

impl From<ReadError> for ArchiveError {
    fn from(error: ReadError) -> Self {
        Self::Unreadable(error.to_string())
    }
}
