//! Errors of opening a city. Each text is one line: what failed, where, and what to do.

use super::source::ReadError;
use std::path::PathBuf;

/// Why a city cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    #[error("cannot read {}: {source}; check the path", path.display())]
    Io { path: PathBuf, source: std::io::Error },
    #[error("no city in {}: neither it nor a folder in it contains city.json; make a city with `insula-server bake`", .0.display())]
    NoCity(PathBuf),
    #[error("cannot use {place}: {reason}; bake the city again")]
    Manifest { place: String, reason: String },
    #[error("cannot use {place}: {source}; copy or bake the city again")]
    Archive { place: String, source: ArchiveError },
    #[error("two cities are named {name:?}: {first} and {second}; bake one with another --name")]
    SameName { name: String, first: String, second: String },
    #[error("cannot read {url}: {reason}; check the URL and this machine's access to it")]
    Remote { url: String, reason: String },
    #[error("cannot use cache.folder {}: {source}; set another one", path.display())]
    Cache { path: PathBuf, source: std::io::Error },
    /// Every attempt to open the city found it replaced meanwhile.
    #[error("cannot open {place}: it is being replaced repeatedly; try again")]
    Changing { place: String },
}

/// Why a file is not a tile archive that this program serves.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ArchiveError {
    #[error("not a PMTiles v3 archive")]
    Magic,
    /// `what`, a part of the file, ends at byte `wanted` of a file of `found` bytes.
    #[error("truncated: {what} reaches to byte {wanted}, the file has {found}")]
    Truncated { what: &'static str, wanted: u64, found: u64 },
    #[error("its {0} use a compression that this program does not support")]
    Compression(&'static str),
    #[error("damaged directory: {0}")]
    Directory(&'static str),
    #[error("{0}")]
    Unreadable(String),
    #[error("its directory exceeds the limit of {0} tiles")]
    TooMany(usize),
}

impl From<ReadError> for ArchiveError {
    fn from(error: ReadError) -> Self {
        Self::Unreadable(error.to_string())
    }
}
