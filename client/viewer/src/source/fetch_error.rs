//! Why a tile could not be fetched.

use crate::scene::TileEvent;
use insula_protocol::DecodeError;
use std::time::Duration;

/// Tells people and pages that the manifest must be read again.
pub const REPLACED: &str = "the city was replaced meanwhile: open it again";

/// Why a tile could not be fetched.
#[derive(Debug, Clone, thiserror::Error)]
pub enum FetchError {
    /// The tile does not exist; a retry would not help.
    #[error("the server has no such tile")]
    Missing,
    /// The server is overloaded or failing for now.
    #[error("the server answers {status}")]
    Busy {
        /// HTTP status code.
        status: u16,
        /// Value of the `Retry-After` header.
        retry_after: Option<Duration>,
    },
    /// The server works, but its copy of this tile fails its checksum.
    #[error("the server's copy is damaged")]
    Broken,
    /// No response, or an incomplete one.
    #[error("{0}")]
    Network(String),
    /// The response does not decode.
    #[error("{0}")]
    Damaged(DecodeError),
    /// The archive's directories cannot be read for now.
    #[error("the archive cannot be read: {0}")]
    Archive(String),
    /// This source will never serve the city; a retry would not help.
    #[error("{0}")]
    Unusable(String),
}

impl FetchError {
    /// The source has another version of the city.
    pub fn replaced() -> Self {
        Self::Unusable(REPLACED.to_owned())
    }

    /// The word of programs for it, which say it in words of their own.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Missing => "missing",
            Self::Busy { .. } => "busy",
            Self::Broken | Self::Damaged(_) | Self::Archive(_) => "damaged",
            Self::Network(_) => "network",
            Self::Unusable(_) => "unusable",
        }
    }

    /// Whether only this tile is at fault: the source itself responds.
    pub(crate) fn is_of_tile_alone(&self) -> bool {
        matches!(self, Self::Missing | Self::Damaged(_) | Self::Broken)
    }

    /// The delay that the server asks for: any value.
    pub fn retry_after(&self) -> Option<Duration> {
        match self {
            Self::Busy { retry_after, .. } => *retry_after,
            _ => None,
        }
    }

    pub(crate) fn event(&self, now: Duration, jitter: f64) -> TileEvent {
        match self {
            Self::Missing => TileEvent::Refuse,
            Self::Damaged(_) | Self::Broken => TileEvent::Damage { now, jitter },
            _ => TileEvent::Fail { now, retry_after: self.retry_after(), jitter },
        }
    }
}
