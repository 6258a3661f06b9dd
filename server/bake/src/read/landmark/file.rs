//! The file that places landmarks: what stands where, how large, and of which stone.
//!
//! ```json
//! {"landmarks": [{
//!   "mesh": "nefertiti.obj", "name": "Bust", "lon": 4.357, "lat": 52.011, "heading": 30, "target-height": 2.5,
//!   "up": "y", "stone": {"preset": "carrara"}, "attribution": "...", "licence": "CC BY 4.0"
//! }]}
//! ```

use insula_source::error::InputError;
use insula_source::source::read_file;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Larger files are refused.
const MAX_FILE_BYTES: u64 = 1 << 20;
/// Most landmarks of a file.
const MAX_LANDMARKS: usize = 1024;
/// A landmark that is larger, in metres, is a mistake in its scale.
const MAX_HEIGHT_M: f64 = 10_000.0;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LandmarkFile {
    landmarks: Vec<LandmarkEntry>,
}

/// An entry as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct LandmarkEntry {
    mesh: PathBuf,
    name: Option<String>,
    position: Option<Vec<f64>>,
    lon: Option<f64>,
    lat: Option<f64>,
    height: Option<f64>,
    on_ground: Option<bool>,
    #[serde(default)]
    heading: f64,
    scale: Option<f64>,
    target_height: Option<f64>,
    #[serde(default)]
    up: Up,
    stone: Option<serde_json::Value>,
    attribution: Option<String>,
    licence: Option<String>,
}

/// The vertical axis of a mesh file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Up {
    Y,
    #[default]
    Z,
}

/// Where a landmark stands: the middle of its base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Position {
    /// In the city's coordinate system.
    City([f64; 2]),
    /// Degrees east and north.
    Earth([f64; 2]),
}

/// Size of a landmark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Size {
    /// Metres of a unit of the file.
    Scale(f64),
    /// Metres from its lowest to its highest point.
    Height(f64),
}

/// A landmark to be read.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::read) struct LandmarkPlan {
    pub(in crate::read) mesh: PathBuf,
    /// For people; also its identifier.
    pub(super) name: String,
    pub(super) position: Position,
    /// Height of its lowest point in metres above the city's vertical datum; `None` on the ground.
    pub(super) height_m: Option<f64>,
    /// Degrees by which it is turned clockwise.
    pub(super) heading_deg: f64,
    pub(super) size: Size,
    pub(super) up: Up,
    /// JSON text of the stone's parameters; `None` if it keeps its own colours.
    pub(super) stone: Option<String>,
    pub(super) attribution: Option<String>,
    pub(super) licence: Option<String>,
}

/// The landmarks of a file, with meshes relative to its folder. Fails if it cannot be read, or if an entry is invalid.
pub(in crate::read) fn read_plans(path: &Path) -> Result<Vec<LandmarkPlan>, InputError> {
    let label = path.display().to_string();
    let bytes = read_file(path, MAX_FILE_BYTES)?;
    let file: LandmarkFile = serde_json::from_slice(&bytes).map_err(|error| InputError::json(&label, &error))?;
    if file.landmarks.len() > MAX_LANDMARKS {
        return Err(InputError::unsupported(&label, format!("it has more than {MAX_LANDMARKS} landmarks")));
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let plan = |(i, entry): (usize, LandmarkEntry)| {
        entry.into_plan(folder).map_err(|what| InputError::unsupported(&label, format!("landmark {}: {what}", i + 1)))
    };
    file.landmarks.into_iter().enumerate().map(plan).collect()
}

impl LandmarkEntry {
    /// Fails with what is wrong.
    fn into_plan(self, folder: &Path) -> Result<LandmarkPlan, &'static str> {
        let is_finite = |v: &f64| v.is_finite();
        let (position, own_height) = match (self.position.as_deref(), self.lon.zip(self.lat)) {
            (Some([x, y]), None) => (Position::City([*x, *y]), None),
            (Some([x, y, z]), None) => (Position::City([*x, *y]), Some(*z)),
            (None, Some((lon, lat))) if lon.abs() <= 180.0 && lat.abs() <= 90.0 => (Position::Earth([lon, lat]), None),
            _ => return Err("give position as [x, y] or [x, y, z] in the city's system, or lon and lat in degrees"),
        };
        let height_m = match (self.on_ground, own_height.or(self.height)) {
            (Some(true), _) | (None, None) => None,
            (_, Some(height)) => Some(height),
            (Some(false), None) => return Err("give a height, or let it stand on the ground"),
        };
        let size = match (self.scale, self.target_height) {
            (None, Some(height)) => Size::Height(height),
            (scale, None) => Size::Scale(scale.unwrap_or(1.0)),
            _ => return Err("give scale or target-height, not both"),
        };
        let (Size::Scale(length) | Size::Height(length)) = size;
        let (Position::City(place) | Position::Earth(place)) = position;
        let is_valid = length > 0.0 && length <= MAX_HEIGHT_M && place.iter().chain(&height_m).all(is_finite);
        if !is_valid || !self.heading.is_finite() {
            return Err("a number is out of range");
        }
        let stem = self.mesh.file_stem().map(|stem| stem.to_string_lossy().into_owned());
        Ok(LandmarkPlan {
            name: self.name.or(stem).filter(|name| !name.trim().is_empty()).ok_or("it has no name")?,
            mesh: folder.join(self.mesh),
            position,
            height_m,
            heading_deg: self.heading,
            size,
            up: self.up,
            stone: self.stone.map(|value| match value {
                serde_json::Value::String(preset) => serde_json::json!({ "preset": preset }).to_string(),
                other => other.to_string(),
            }),
            attribution: self.attribution,
            licence: self.licence,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(text: &str) -> Result<LandmarkPlan, &'static str> {
        serde_json::from_str::<LandmarkEntry>(text).unwrap().into_plan(Path::new("data"))
    }

    #[test]
    fn an_entry_says_where_and_how_large() {
        let bust =
            plan(r#"{"mesh": "bust.ply", "position": [85000, 447000], "target-height": 2.5, "stone": "carrara"}"#)
                .unwrap();
        assert_eq!((bust.name.as_str(), bust.mesh.as_path()), ("bust", Path::new("data/bust.ply")));
        assert_eq!((bust.position, bust.height_m), (Position::City([85000.0, 447_000.0]), None));
        assert_eq!((bust.size, bust.stone.as_deref()), (Size::Height(2.5), Some(r#"{"preset":"carrara"}"#)));
        let earth = plan(r#"{"mesh": "a.stl", "lon": 4.3, "lat": 52, "height": 3, "up": "y"}"#).unwrap();
        assert_eq!((earth.position, earth.height_m), (Position::Earth([4.3, 52.0]), Some(3.0)));
        assert_eq!((earth.size, earth.up), (Size::Scale(1.0), Up::Y));
        let ground = plan(r#"{"mesh": "a.stl", "position": [1, 2, 3], "on-ground": true}"#).unwrap();
        assert_eq!(ground.height_m, None);
    }

    #[test]
    fn an_invalid_entry_is_refused() {
        for text in [
            r#"{"mesh": "a.stl"}"#,
            r#"{"mesh": "a.stl", "position": [1]}"#,
            r#"{"mesh": "a.stl", "position": [1, 2], "lon": 1, "lat": 2}"#,
            r#"{"mesh": "a.stl", "lon": 1, "lat": 92}"#,
            r#"{"mesh": "a.stl", "position": [1, 2], "scale": 1, "target-height": 2}"#,
            r#"{"mesh": "a.stl", "position": [1, 2], "scale": 0}"#,
            r#"{"mesh": "a.stl", "position": [1, 2], "target-height": 1e6}"#,
            r#"{"mesh": "a.stl", "position": [1, 2], "on-ground": false}"#,
        ] {
            assert!(plan(text).is_err(), "{text}");
        }
    }
}
