//! Why the inputs could not be read. Objects that are merely skipped are in the report instead.

use std::path::Path;

/// An error that ends the reading. A fault of a single object never does (see [`crate::read::SourceReport::skipped`]).
/// Every `path` is the input as it was given.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// A file or folder could not be opened or read, or its compressed stream is damaged.
    #[error("{path}: cannot be read: {cause}; check that it exists, is readable and complete")]
    Io { path: String, cause: std::io::Error },
    /// The text is not valid JSON, or ends too early.
    #[error("{path}: line {line}, column {column}: {what}; the file is damaged or cut short, fetch or export it again")]
    Json {
        path: String,
        /// From 1.
        line: usize,
        /// From 1.
        column: usize,
        /// The parser's message.
        what: String,
    },
    /// The file format is not supported.
    #[error(
        "{path}: {what}; supported are CityJSON 1.0 to 2.0 (.city.json, .json), CityJSONSeq (.city.jsonl, .jsonl), GeoJSON (.geojson, .json; one feature per line: .geojsonl) and OBJ (.obj), each also as .gz"
    )]
    Unsupported { path: String, what: String },
    /// A known format that is not read.
    #[error("{path}: {format}: not read; {advice}")]
    NotRead {
        path: String,
        format: &'static str,
        /// How to make a file of it that is read.
        advice: String,
    },
    /// Two sources of one city use different coordinate systems.
    #[error("{path}: is in {crs}, but {first_path} is in {first_crs}; reproject one of them, or bake two cities")]
    CrsMismatch { path: String, crs: String, first_path: String, first_crs: String },
    /// The coordinates are in degrees, not metres.
    #[error("{path}: {crs} is in degrees; reproject the file to a projected system in metres")]
    Degrees { path: String, crs: String },
    /// A file, a line or a count is larger than the options allow.
    #[error("{path}: {what} exceeds the limit of {limit}; split the file, or raise the limit (--memory)")]
    TooLarge { path: String, what: String, limit: u64 },
    /// A palette file is invalid.
    #[error("{path}: {what}; README.md shows a palette")]
    Palette {
        path: String,
        /// What is wrong, and under which key.
        what: String,
    },
    /// An input folder has no city file, or there is no input.
    #[error(
        "{path}: contains no city file; give a .city.json, .city.jsonl, .geojson or .obj file, or a folder with such files"
    )]
    NoSource { path: String },
    /// Every object of a source is left out, while others give the city.
    #[error("{path}: {}: {reason}; {advice}, or leave the file out", all_left_out(*objects))]
    NothingLeft {
        path: String,
        objects: u64,
        /// The most frequent reason, with an example.
        reason: String,
        advice: &'static str,
    },
    /// The sources have no triangles.
    #[error("{sources}: the city is empty, not one triangle was read{hint}; check that the input contains surfaces")]
    Empty {
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

fn all_left_out(objects: u64) -> String {
    if objects == 1 {
        "its only object is left out".into()
    } else {
        format!("all of its {objects} objects are left out")
    }
}

/// The message of a JSON error without its position.
pub(crate) fn json_message(error: &serde_json::Error) -> String {
    let text = error.to_string();
    match text.rfind(" at line ") {
        Some(end) => text[..end].to_owned(),
        None => text,
    }
}
