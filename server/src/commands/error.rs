//! Errors of the commands, one line each.

use crate::config::ConfigError;
use crate::http::ServeError;
use crate::store::{ObjectError, SearchFileError, StoreError};
use insula_protocol::text::count;
use std::path::PathBuf;

/// Why a command failed: what failed, where, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Objects(#[from] ObjectError),
    #[error(transparent)]
    Search(#[from] SearchFileError),
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error(transparent)]
    Serve(#[from] ServeError),
    #[error("cannot listen on {address}: {source}; use another --listen, port 0 picks a free one")]
    Listen { address: String, source: std::io::Error },
    #[error("cannot write {}: {reason}; check free space and permissions", path.display())]
    Write { path: PathBuf, reason: String },
    /// The operating system refuses `what`, an action such as "start threads".
    #[error("cannot {what}: {source}; try again")]
    System { what: &'static str, source: std::io::Error },
    #[error(
        "cannot show tile {tile}: {reason}; `insula-server inspect CITY` lists the levels, `verify` the damaged tiles"
    )]
    Tile { tile: String, reason: String },
    /// `verify` found faults and has printed them.
    #[error("{} in {}; bake the city again, or copy it again from an intact source", count(*faults as u64, "fault"), path.display())]
    Faults { path: PathBuf, faults: usize },
    /// A file or folder that cannot be used or made.
    #[error("{}: {reason}", path.display())]
    File { path: PathBuf, reason: String },
    #[error("this program has no viewer to publish: run client/web/build, and build insula-server again")]
    NoViewer,
    #[error("{0}")]
    Bake(String),
    /// A step of a bake that no retry mends.
    #[error("{0}")]
    Final(String),
    #[error("{0}")]
    Keys(String),
    #[error("{0}")]
    Usage(String),
    #[cfg(feature = "bake")]
    #[error(transparent)]
    Proposal(#[from] crate::proposal::ProposalError),
}

impl CommandError {
    pub(super) fn file(path: impl Into<PathBuf>, reason: impl ToString) -> Self {
        Self::File { path: path.into(), reason: reason.to_string() }
    }

    pub(super) fn write(path: impl Into<PathBuf>, reason: impl ToString) -> Self {
        Self::Write { path: path.into(), reason: reason.to_string() }
    }

    /// 2 for usage errors, 3 for steps that no retry mends, else 1.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Usage(_) => 2,
            #[cfg(feature = "bake")]
            Self::Proposal(_) => 2,
            Self::Final(_) => 3,
            _ => 1,
        }
    }
}
