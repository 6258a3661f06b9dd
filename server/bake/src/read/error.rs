//! Why a whole reading failed; what is merely skipped goes into the report instead.
//!
//! In: the place and the cause. Out: [`InputError`], one line each: what, where, what to do. Next: the command line.

use std::path::Path;

/// A fault that ends the reading. Faults of single objects never do (see [`super::SourceReport::skipped`]).
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// A file or folder could not be opened or read, or its compressed stream is broken.
    #[error("{path}: cannot be read: {cause}; check that it exists, is readable and complete")]
    Io {
        /// The input as it was given.
        path: String,
        /// What the system or the decompressor said.
        cause: std::io::Error,
    },
    /// The text is not valid JSON, or ends too early.
    #[error("{path}: line {line}, column {column}: {what}; the file is damaged or cut short, fetch or export it again")]
    Json {
        /// The input as it was given.
        path: String,
        /// From 1.
        line: usize,
        /// From 1.
        column: usize,
        /// The parser's words.
        what: String,
    },
    /// The file is of a kind that is not read.
    #[error(
        "{path}: {what}; readable are CityJSON 1.0 to 2.0 (.city.json, .json), CityJSONSeq (.city.jsonl, .jsonl), GeoJSON (.geojson, .json; a feature a line: .geojsonl) and OBJ (.obj), each also as .gz"
    )]
    Unsupported {
        /// The input as it was given.
        path: String,
        /// What it is instead.
        what: String,
    },
    /// Two sources of one city lie in different coordinate systems.
    #[error("{path}: is in {crs}, but {first_path} is in {first_crs}; reproject one of them, or bake two cities")]
    CrsMismatch {
        /// The source that does not fit.
        path: String,
        /// Its system.
        crs: String,
        /// The first source that named a system.
        first_path: String,
        /// That system.
        first_crs: String,
    },
    /// The coordinates are degrees, not metres.
    #[error("{path}: {crs} counts in degrees; reproject it to a projected system in metres")]
    Degrees {
        /// The input as it was given.
        path: String,
        /// Its system.
        crs: String,
    },
    /// A file, a line or a count is larger than the options allow.
    #[error("{path}: {what} exceeds the limit of {limit}; split the file, or raise the limit")]
    TooLarge {
        /// The input as it was given.
        path: String,
        /// What is too large.
        what: String,
        /// How much is allowed.
        limit: u64,
    },
    /// A palette's file is none.
    #[error("{path}: {what}; README.md shows a palette")]
    Palette {
        /// The file as it was given.
        path: String,
        /// What is wrong, and under which key.
        what: String,
    },
    /// There is nothing to read.
    #[error("{path}: no city file in it; give a .city.json, .city.jsonl, .geojson or .obj file, or a folder with some")]
    NoSource {
        /// The input as it was given.
        path: String,
    },
    /// Everything was read and not one triangle came of it.
    #[error("{sources}: the city is empty, not one triangle was read{hint}; check that the input holds surfaces")]
    Empty {
        /// The inputs.
        sources: String,
        /// The most frequent reason for skipping, if any.
        hint: String,
    },
}

impl InputError {
    pub(crate) fn io(path: &str, cause: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), cause }
    }

    pub(crate) fn json(path: &str, error: &serde_json::Error) -> Self {
        Self::Json { path: path.to_owned(), line: error.line(), column: error.column(), what: json_message(error) }
    }

    pub(crate) fn unsupported(path: &str, what: impl Into<String>) -> Self {
        Self::Unsupported { path: path.to_owned(), what: what.into() }
    }

    pub(crate) fn no_source(path: &Path) -> Self {
        Self::NoSource { path: path.display().to_string() }
    }
}

/// A JSON fault's words without its position, which is told separately.
pub(crate) fn json_message(error: &serde_json::Error) -> String {
    let text = error.to_string();
    match text.rfind(" at line ") {
        Some(end) => text[..end].to_owned(),
        None => text,
    }
}
