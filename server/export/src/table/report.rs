//! What an export did, and why it failed.

use crate::source::{ExportSource, SourceError};
use insula_protocol::Manifest;
use insula_protocol::manifest::Attribution;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What an export wrote.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct ExportReport {
    /// Objects in the output, with those without geometry. 0 for rasters.
    pub objects: u64,
    /// Objects in the output that no tile shows: they have attributes and no geometry.
    pub without_geometry: u64,
    /// Number of selected objects that are not in the output, by reason.
    pub skipped: BTreeMap<String, u64>,
    /// Size of all written files.
    pub bytes: u64,
    /// The written files, the main one first.
    pub files: Vec<PathBuf>,
    /// What the user should know of the output.
    pub warnings: Vec<String>,
    /// Who must be named wherever the output is shown; empty if nobody.
    pub attribution: String,
}

impl ExportReport {
    pub(crate) fn new(source: &dyn ExportSource) -> Self {
        Self { attribution: attribution(source.manifest()), ..Self::default() }
    }

    pub(crate) fn skip(&mut self, reason: &str) {
        *self.skipped.entry(reason.to_owned()).or_default() += 1;
    }
}

/// The sources of a city as one text, which inputs of a bake may have.
pub fn attribution(manifest: &Manifest) -> String {
    Attribution::line(&manifest.attribution)
}

/// Why an export failed. Nothing remains of the output then.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    #[error(transparent)]
    Source(#[from] SourceError),
    #[error("{path}: cannot be written: {source}")]
    Write { path: PathBuf, source: std::io::Error },
    /// The writer of a format refused the city's data.
    #[error("{path}: cannot be written as {format}: {reason}")]
    Encode { path: PathBuf, format: &'static str, reason: String },
    #[error("the selection is not valid: {0}")]
    ObjectSelection(String),
    #[error("the selection is too large for {format}: {reason}")]
    TooLarge { format: &'static str, reason: String },
}

impl ExportError {
    pub(crate) fn write(path: &Path) -> impl Fn(std::io::Error) -> Self + '_ {
        move |source| Self::Write { path: path.to_owned(), source }
    }

    pub(crate) fn encode<E: std::fmt::Display>(path: &Path, format: &'static str) -> impl Fn(E) -> Self {
        let path = path.to_owned();
        move |error| Self::Encode { path: path.clone(), format, reason: error.to_string() }
    }
}
