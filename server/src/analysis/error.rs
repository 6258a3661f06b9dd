//! Why a client gets no answer.

use insula_draw::DrawError;
use insula_export::table::ExportError;

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub(crate) enum RequestError {
    #[error("{0}")]
    Invalid(String),
    #[error("{0}")]
    Outside(String),
    #[error("the area would be too large: choose a smaller one")]
    TooLarge,
    #[error("nobody waits for the answer")]
    Stopped,
    #[error(transparent)]
    Source(ExportError),
}

impl RequestError {
    /// An area without a part of the city is the client's fault.
    pub(super) fn of_export(error: ExportError) -> Self {
        match error {
            ExportError::ObjectSelection(reason) => Self::Outside(reason),
            ExportError::TooLarge { .. } => Self::TooLarge,
            error => Self::Source(error),
        }
    }

    pub(super) fn of_draw(error: DrawError) -> Self {
        match error {
            DrawError::Invalid(reason) => Self::Invalid(reason),
            DrawError::TooManyTriangles { .. } | DrawError::TooManyParts { .. } => Self::TooLarge,
            DrawError::Empty => Self::Outside("no part of the city is in the area".to_owned()),
            DrawError::Cancelled => Self::Stopped,
            DrawError::Source(error) => Self::Source(ExportError::Source(error)),
            DrawError::City(error) => Self::of_export(error),
            DrawError::Write { path, source } => Self::Source(ExportError::Write { path, source }),
        }
    }
}
