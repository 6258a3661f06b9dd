//! Errors of the client. Each is one line that says what failed, where, and what to do.

use insula_protocol::manifest::Attribution;
use serde::Deserialize;
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
    /// The server does not respond. It may respond later.
    #[error("{0}")]
    NoResponse(String),
    /// The server's response cannot be used.
    #[error("{0}")]
    Server(String),
    /// The server has several cities, and none is named. Exit code 2.
    #[error("{base} has several cities: choose one with --city: {}", names(cities))]
    SeveralCities { base: String, cities: Vec<ListedCity> },
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
        if matches!(self, Self::Usage(_) | Self::SeveralCities { .. }) { 2 } else { 1 }
    }

    /// Whether another attempt may succeed without any change by the user.
    pub fn is_temporary(&self) -> bool {
        matches!(self, Self::NoResponse(_))
    }

    /// Converts an I/O error on `path`, for `map_err`.
    pub fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |source| Self::File { path: path.to_owned(), source }
    }
}

/// An entry of a server's list of cities.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct ListedCity {
    pub name: String,
    pub title: String,
    /// Size of the baked city; 0 if it is unknown.
    pub bytes: u64,
    pub attribution: Vec<Attribution>,
}

/// Longest list of names in a message.
const MAX_NAMES: usize = 40;

fn names(cities: &[ListedCity]) -> String {
    let mut names: Vec<&str> = cities.iter().take(MAX_NAMES).map(|city| city.name.as_str()).collect();
    if cities.len() > MAX_NAMES {
        names.push("...");
    }
    names.join(", ")
}

/// `Result` with [`ClientError`] as the default error.
pub type Result<T, E = ClientError> = std::result::Result<T, E>;
