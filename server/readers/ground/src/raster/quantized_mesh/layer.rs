//! `layer.json`: how the tiles are named and where they lie.
//!
//! Its `bounds` are not read: many writers state the world there, and Cesium does not use them either.

use super::super::error::RasterError;
use super::template::{Template, USUAL};
use super::tiling::{MAX_LEVEL, Projection};
use serde::Deserialize;

/// Further templates are not read. They are mirrors of the first one.
const MAX_TEMPLATES: usize = 16;

/// What `layer.json` says.
pub(super) struct Layer {
    pub(super) projection: Projection,
    /// Rows are counted from the south, as in TMS, and not from the north.
    pub(super) is_tms: bool,
    /// At least one.
    pub(super) templates: Vec<Template>,
}

/// The file. Other entries are left out.
#[derive(Deserialize)]
struct LayerJson {
    format: Option<String>,
    projection: Option<String>,
    scheme: Option<String>,
    tiles: Option<Vec<String>>,
    version: Option<Version>,
    available: Option<Vec<Vec<AvailableRange>>>,
}

/// The version of the tiles, which names may have.
#[derive(Deserialize)]
#[serde(untagged)]
enum Version {
    Text(String),
    Number(serde_json::Number),
}

/// Tiles of a level that exist. Rows are from the south.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct AvailableRange {
    start_x: u32,
    start_y: u32,
    end_x: u32,
    end_y: u32,
}

impl Layer {
    /// Fails if the text is not JSON, names another format, projection or scheme, or has absurd ranges of tiles.
    pub(super) fn read(bytes: &[u8]) -> Result<Self, RasterError> {
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let json: LayerJson = serde_json::from_slice(bytes)
            .map_err(|error| RasterError::damaged(format!("its layer.json is invalid: {error}")))?;
        check_format(json.format.as_deref())?;
        check_available(json.available.as_deref().unwrap_or_default())?;
        let projection = match json.projection.as_deref() {
            None | Some("" | "EPSG:4326") => Projection::Geographic,
            Some("EPSG:3857") => Projection::WebMercator,
            Some(other) => return Err(RasterError::unsupported(format!("tiles of the projection {other}"))),
        };
        let is_tms = match json.scheme.as_deref() {
            None | Some("" | "tms") => true,
            // Cesium's word, and that of TileJSON.
            Some("slippyMap" | "xyz") => false,
            Some(other) => return Err(RasterError::unsupported(format!("tiles numbered by the scheme {other}"))),
        };
        let version = match &json.version {
            None => String::new(),
            Some(Version::Text(text)) => text.clone(),
            Some(Version::Number(number)) => number.to_string(),
        };
        let texts = json.tiles.unwrap_or_default();
        // Copies of a terrain may have the usual names in place of those on its server.
        let texts = texts.iter().take(MAX_TEMPLATES).map(String::as_str).chain([USUAL]);
        let mut templates: Vec<Template> = Vec::new();
        for template in texts.filter_map(|text| Template::new(text, &version)) {
            if !templates.contains(&template) {
                templates.push(template);
            }
        }
        Ok(Self { projection, is_tms, templates })
    }
}

/// Later versions 1.x are read too, as Cesium does.
fn check_format(format: Option<&str>) -> Result<(), RasterError> {
    match format {
        None => Ok(()),
        Some(format) if format.starts_with("quantized-mesh-1.") => Ok(()),
        Some(format) => Err(RasterError::unsupported(format!("tiles of the format {format}"))),
    }
}

/// The ranges are checked only. Which tiles exist is known by the files: a folder may have a part of a terrain, or more
/// than its `layer.json` lists.
fn check_available(levels: &[Vec<AvailableRange>]) -> Result<(), RasterError> {
    for (level, ranges) in levels.iter().enumerate() {
        let level = u8::try_from(level).ok().filter(|level| *level <= MAX_LEVEL);
        // No tiling has more columns or rows.
        let most = level.map_or(0, |level| Projection::Geographic.columns(level));
        let is_valid = |range: &AvailableRange| {
            let AvailableRange { start_x, start_y, end_x, end_y } = *range;
            start_x <= end_x && start_y <= end_y && end_x.max(end_y) < most
        };
        if !ranges.iter().all(is_valid) {
            return Err(RasterError::damaged("the ranges of available tiles in its layer.json are invalid"));
        }
    }
    Ok(())
}
