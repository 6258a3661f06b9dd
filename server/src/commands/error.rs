//! Why a command fails.

use crate::{config::ConfigError, http::ServeError, store::StoreError};
use std::path::PathBuf;

/// Why a command failed: one line that says what, where and what to do.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    /// A city cannot be opened.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The config file cannot be used.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A file that the config names cannot be used, or the system refuses.
    #[error(transparent)]
    Serve(#[from] ServeError),
    /// No socket.
    #[error("cannot listen on {address}: {source}; give another --listen, port 0 picks a free one")]
    Listen {
        /// As typed.
        address: String,
        /// Why not.
        source: std::io::Error,
    },
    /// A file could not be written.
    #[error("cannot write {}: {reason}; is there space, and may you write there?", path.display())]
    Write {
        /// Which.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// The operating system refuses something else.
    #[error("cannot {what}: {source}; try again")]
    System {
        /// What was tried.
        what: &'static str,
        /// Why not.
        source: std::io::Error,
    },
    /// There is no such tile in the city, or it is damaged.
    #[error("cannot show tile {tile}: {reason}; `insula-server inspect CITY` lists the levels, `verify` the bad tiles")]
    Tile {
        /// Its place.
        tile: String,
        /// What is wrong.
        reason: String,
    },
    /// `verify` found faults; they have been printed.
    #[error("{faults} faults in {}; bake the city again, or copy it again from where it is whole", path.display())]
    Faults {
        /// The city's folder.
        path: PathBuf,
        /// How many.
        faults: usize,
    },
    /// A file is no mesh that can be used.
    #[error("{}: {reason}", path.display())]
    Mesh {
        /// Which.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// The bake failed.
    #[error("{0}")]
    Bake(String),
    /// What was typed makes no sense.
    #[error("{0}")]
    Usage(String),
}

impl CommandError {
    /// 2 for slips of the user, else 1.
    pub fn exit_code(&self) -> u8 {
        if matches!(self, Self::Usage(_)) { 2 } else { 1 }
    }
}
