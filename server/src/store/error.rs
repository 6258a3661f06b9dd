//! What can be wrong with a city's folder. Each text is one line: what, where, what to do.

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
    #[error("cannot use {}: {reason}; bake the city again", path.display())]
    Manifest {
        /// The manifest.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A tile archive is damaged.
    #[error("cannot use {}: {source}; copy or bake the city again", path.display())]
    Archive {
        /// The archive.
        path: PathBuf,
        /// What is wrong with it.
        source: ArchiveError,
    },
    /// URLs could not tell two cities apart.
    #[error("two cities are named {name:?}: {} and {}; bake one with another --name", first.display(), second.display())]
    SameName {
        /// The name.
        name: String,
        /// One folder.
        first: PathBuf,
        /// The other.
        second: PathBuf,
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
    /// More than the program is willing to hold in memory.
    #[error("its directory is over the limit of {0} tiles")]
    TooMany(usize),
}
