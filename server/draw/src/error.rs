//! Why a drawing failed.

use insula_export::source::SourceError;
use insula_export::table::ExportError;
use std::path::PathBuf;

/// Why a drawing failed. Nothing is written then.
#[derive(Debug, thiserror::Error)]
pub enum DrawError {
    #[error(transparent)]
    Source(#[from] SourceError),
    #[error(transparent)]
    City(#[from] ExportError),
    #[error(
        "more than {limit} triangles are in the drawing: draw a part of the city with --bbox or --filter, or a smaller scale with --scale"
    )]
    TooManyTriangles { limit: usize },
    #[error("more than {limit} parts of surfaces are in the drawing: draw a part of the city with --bbox or --filter")]
    TooManyParts { limit: usize },
    #[error(
        "nothing to draw: no surface of the selection is in the view: choose another area (--bbox), filter (--filter) or view"
    )]
    Empty,
    #[error("{0}")]
    Invalid(String),
    #[error("stopped before the drawing was complete")]
    Cancelled,
    #[error("{path}: cannot be written: {source}")]
    Write { path: PathBuf, source: std::io::Error },
}

/// What is being done, for progress displays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DrawStep {
    Read,
    Sort,
    Subdivide,
    Join,
}

impl DrawStep {
    /// A word for people.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Read => "reading",
            Self::Sort => "sorting by depth",
            Self::Subdivide => "removing hidden surfaces",
            Self::Join => "joining shapes",
        }
    }
}

/// Called with a step and the share of it that is done, 0 to 1. Returns whether to go on.
pub type DrawProgress<'a> = &'a (dyn Fn(DrawStep, f64) -> bool + Sync);

/// Fails if the progress says so.
pub(crate) fn advance(progress: DrawProgress<'_>, step: DrawStep, share: f64) -> Result<(), DrawError> {
    if progress(step, share) { Ok(()) } else { Err(DrawError::Cancelled) }
}
