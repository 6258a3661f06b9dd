//! Why the inputs could not be read. Objects that are merely skipped are in the report instead.

use insula_protocol::text::shell_word;
use std::path::Path;

/// What the parser of JSON says of bytes that are no UTF-8.
const NOT_UTF8: &str = "invalid unicode code point";

/// An error that ends the reading. A fault of a single object never does (see [`crate::report::SourceReport::skipped`]).
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
    /// A file of another format than JSON is invalid or ends too early.
    #[error("{path}: {place}: {what}; the file is damaged or cut short, fetch or export it again")]
    Damaged {
        path: String,
        /// Such as `line 7` or `byte 120`.
        place: String,
        what: String,
    },
    /// The file is of no known format.
    #[error(
        "{path}: {what}; supported are CityGML (.gml, .xml), CityJSON (.json, .jsonl), GeoJSON (.geojson, .geojsonl), GeoPackage (.gpkg), Shapefile (.shp), FlatGeobuf (.fgb), GeoParquet (.parquet), CSV with WKT (.csv), OpenStreetMap (.osm, .pbf), glTF (.gltf, .glb), 3D Tiles (tileset.json, .3tz), I3S (.slpk), OBJ, PLY and STL; most also as .gz or in a .zip"
    )]
    UnknownFormat { path: String, what: String },
    /// The content of a file is not supported.
    #[error("{path}: {what}")]
    Unsupported { path: String, what: String },
    /// A known format that is not read.
    #[error("{path}: {format}: not read; {advice}")]
    NotRead {
        path: String,
        format: &'static str,
        /// How to make a file of it that is read.
        advice: String,
    },
    /// The coordinate system of a city is not known, contradicts the coordinates, or cannot be brought to the city's. Unlike
    /// [`Self::Unsupported`], it is never that of a file that is no city.
    #[error("{path}: {what}")]
    Misplaced { path: String, what: String },
    /// The coordinates are in degrees, and the city has no projected system yet.
    #[error("{path}: is in degrees; give the city's coordinate system with --crs EPSG:N")]
    NoProjection { path: String },
    /// A coordinate system was wanted, and is found.
    #[error("{path}: its coordinate system is known; report this")]
    Settled { path: String },
    /// A file, a line or a count is larger than the options allow.
    #[error("{path}: {what} exceeds the limit of {limit}; split the file, or raise the limit (--memory)")]
    TooLarge { path: String, what: String, limit: u64 },
    /// A palette file is invalid.
    #[error("{path}: {what}; docs/inputs.md shows a palette")]
    Palette {
        path: String,
        /// What is wrong, and under which key.
        what: String,
    },
    /// An input folder has no city file, or there is no input.
    #[error(
        "{path}: contains no city file; give CityGML, CityJSON, GeoJSON, GeoPackage, OpenStreetMap, glTF, 3D Tiles or other files that `insula-server bake --help` names, or a folder of them"
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
    #[error("{sources}: the city is empty, not one triangle was read{hint}; {advice}")]
    Empty {
        sources: String,
        /// The wanted area, or else the most frequent reason for skipping, if any.
        hint: String,
        advice: &'static str,
    },
}

impl InputError {
    /// A file cannot be read.
    pub fn io(path: &str, cause: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), cause }
    }

    /// A text is no valid JSON.
    pub fn json(path: &str, error: &serde_json::Error) -> Self {
        match json_message(error) {
            what if what == NOT_UTF8 => Self::not_utf8(path),
            what => Self::Json { path: path.to_owned(), line: error.line(), column: error.column(), what },
        }
    }

    /// The bytes of a JSON are no UTF-8.
    pub(crate) fn not_utf8(path: &str) -> Self {
        let (folder, name) = path.split_at(path.rfind('/').map_or(0, |slash| slash + 1));
        let out = format!("{folder}utf8-{name}");
        let [from, to] = [path, &out].map(shell_word);
        let encodings = "WINDOWS-1252 in western Europe, SHIFT_JIS in Japan, GBK in China";
        let advice =
            format!("convert it from its encoding ({encodings}): iconv -f WINDOWS-1252 -t UTF-8 {from} > {to}");
        Self::NotRead { path: path.to_owned(), format: "JSON that is not in UTF-8", advice }
    }

    /// A file is damaged at `place`.
    pub fn damaged(path: &str, place: impl Into<String>, what: impl Into<String>) -> Self {
        Self::Damaged { path: path.to_owned(), place: place.into(), what: what.into() }
    }

    /// A file is of no known format.
    pub fn unknown_format(path: &str, what: impl Into<String>) -> Self {
        Self::UnknownFormat { path: path.to_owned(), what: what.into() }
    }

    /// The content of a file is not supported.
    pub fn unsupported(path: &str, what: impl Into<String>) -> Self {
        Self::Unsupported { path: path.to_owned(), what: what.into() }
    }

    /// The coordinates of a file have no place in the city.
    pub fn misplaced(path: &str, what: impl Into<String>) -> Self {
        Self::Misplaced { path: path.to_owned(), what: what.into() }
    }

    /// A format whose library is left out of this program. `feature` of the bake has it.
    pub fn left_out(path: &str, feature: &str) -> Self {
        Self::unsupported(path, left_out(feature))
    }

    /// A folder has no city file.
    pub fn no_source(path: &Path) -> Self {
        Self::NoSource { path: path.display().to_string() }
    }
}

/// Why a format, or a part of one, whose library is left out of this program is not read.
pub fn left_out(feature: &str) -> String {
    format!("this program was built without the feature `{feature}`, which reads it")
}

fn all_left_out(objects: u64) -> String {
    if objects == 1 {
        "its only object is left out".into()
    } else {
        format!("all of its {objects} objects are left out")
    }
}

/// The message of a JSON error without its position.
pub fn json_message(error: &serde_json::Error) -> String {
    let text = error.to_string();
    match text.rfind(" at line ") {
        Some(end) => text[..end].to_owned(),
        None => text,
    }
}
