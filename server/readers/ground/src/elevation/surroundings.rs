//! The land around a city: heights and pictures by square, read while it is baked.

use super::Elevation;
use super::drape::{Drape, GroundPictures};
use super::lattice::MapGrid;
use insula_source::error::InputError;
use serde::{Deserialize, Serialize};
use std::array;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Points along each side of the grid by which the range of heights is known.
const OVERVIEW_POINTS: usize = 1024;
/// Pixels along the side of a window that is read at once.
const MAX_WINDOW_PIXELS: f64 = 4096.0;

/// The land around a city.
#[derive(Debug, Clone, PartialEq)]
pub struct SurroundingsOptions {
    /// Elevation models of it, and pictures; none without any.
    pub files: Vec<PathBuf>,
    /// It reaches this far beyond the city.
    pub reach_m: f64,
}

impl Default for SurroundingsOptions {
    /// Land at a distance of 30 km is within the haze.
    fn default() -> Self {
        Self { files: Vec::new(), reach_m: 30_000.0 }
    }
}

/// Colours where there is no picture, 8-bit sRGB.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LandColours {
    pub land: [u8; 3],
    pub water: [u8; 3],
}

/// The land around a city.
pub struct FarModels {
    elevation: Mutex<Elevation>,
    pub colours: LandColours,
    /// Lowest and highest corner on the map.
    pub bounds: [[f64; 2]; 2],
    /// World height of the lowest and highest point.
    pub z_range_m: [f64; 2],
    /// Hash of what decides how it looks.
    pub hash: [u8; 32],
}

/// What is known of the land once it was measured.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LandFacts {
    /// As in [`FarModels`].
    pub bounds: [[f64; 2]; 2],
    pub z_range_m: [f64; 2],
    pub hash: [u8; 32],
}

/// A square grid of points on the map.
#[derive(Debug, Clone, Copy)]
pub struct LandSquare {
    /// World position of the south-western point.
    pub corner: [f64; 2],
    pub step_m: f64,
    /// Points along each side.
    pub points: usize,
}

impl FarModels {
    /// The land as far as the models reach, and at most as far as wanted beyond `city`, its lowest and highest corner.
    /// The models must be settled. `None` if none is for the surroundings, or without a city. Fails if one cannot be
    /// read.
    pub fn new(
        elevation: Elevation,
        city: Option<[[f64; 2]; 2]>,
        options: &SurroundingsOptions,
        colours: LandColours,
    ) -> Result<Option<Self>, InputError> {
        let models = || elevation.models.iter().filter(|model| model.is_surroundings);
        let bounds = models().filter_map(|model| Some(model.placed.as_ref()?.bounds)).reduce(|a, b| {
            [array::from_fn(|axis| a[0][axis].min(b[0][axis])), array::from_fn(|axis| a[1][axis].max(b[1][axis]))]
        });
        let (Some([low, high]), Some(city)) = (bounds, city) else { return Ok(None) };
        let low: [f64; 2] = array::from_fn(|axis| low[axis].max(city[0][axis] - options.reach_m));
        let high: [f64; 2] = array::from_fn(|axis| high[axis].min(city[1][axis] + options.reach_m));
        if !(low[0] < high[0] && low[1] < high[1]) {
            return Ok(None);
        }
        let side_m = (high[0] - low[0]).max(high[1] - low[1]);
        let step_m = side_m / (OVERVIEW_POINTS - 1) as f64;
        let heights = elevation.read_in_parts(LandSquare { corner: low, step_m, points: OVERVIEW_POINTS })?;
        let known = || heights.iter().copied().filter(|height| height.is_finite()).map(f64::from);
        let z_range_m = [known().fold(f64::INFINITY, f64::min), known().fold(f64::NEG_INFINITY, f64::max)];
        if z_range_m[0] > z_range_m[1] {
            return Ok(None);
        }
        let mut hasher = blake3::Hasher::new();
        for number in low.into_iter().chain(high) {
            hasher.update(&number.to_le_bytes());
        }
        for height in &heights {
            hasher.update(&height.to_le_bytes());
        }
        for picture in &elevation.pictures {
            hasher.update(picture.label.as_bytes());
        }
        let hash = *hasher.finalize().as_bytes();
        Ok(Some(Self { elevation: Mutex::new(elevation), colours, bounds: [low, high], z_range_m, hash }))
    }

    /// What another process needs to open the same land.
    pub fn facts(&self) -> LandFacts {
        LandFacts { bounds: self.bounds, z_range_m: self.z_range_m, hash: self.hash }
    }

    /// The land of which this is known. The models must be settled.
    pub fn known(elevation: Elevation, colours: LandColours, facts: LandFacts) -> Self {
        let LandFacts { bounds, z_range_m, hash } = facts;
        Self { elevation: Mutex::new(elevation), colours, bounds, z_range_m, hash }
    }

    /// Heights of a square by row from the south; NaN where none is known. Fails if a raster cannot be read.
    pub fn heights(&self, square: LandSquare) -> Result<Vec<f32>, InputError> {
        self.lock().read_in_parts(square)
    }

    /// The pictures over the rectangle from `low` to `high`, as [`Elevation::drape`].
    pub fn picture(&self, bounds: [[f64; 2]; 2], texel_m: f64) -> Result<Option<Drape>, InputError> {
        self.lock().drape(bounds, &GroundPictures::photos(self.colours.land, texel_m))
    }

    fn lock(&self) -> MutexGuard<'_, Elevation> {
        // What a panicking reader leaves behind are blocks of heights, which are complete or absent.
        self.elevation.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Elevation {
    /// Whether there is an elevation model of the land around the city.
    pub(super) fn has_surroundings(&self) -> bool {
        self.models.iter().any(|model| model.is_surroundings)
    }

    /// Heights of a square, in parts for which no window of a fine raster is too large.
    fn read_in_parts(&self, LandSquare { corner, step_m, points }: LandSquare) -> Result<Vec<f32>, InputError> {
        let pixels_per_step = (step_m / self.step_m()).max(1.0);
        let part = ((MAX_WINDOW_PIXELS / pixels_per_step) as usize).clamp(1, points);
        let mut heights = vec![f32::NAN; points * points];
        for y in (0..points).step_by(part) {
            for x in (0..points).step_by(part) {
                let size = [x, y].map(|first| part.min(points - first));
                let corner = [(0, x), (1, y)].map(|(axis, first)| corner[axis] + first as f64 * step_m);
                let found = self.read(&MapGrid { corner, step_m, size })?;
                for (row, values) in found.chunks_exact(size[0]).enumerate() {
                    let start = (y + row) * points + x;
                    heights[start..start + size[0]].copy_from_slice(values);
                }
            }
        }
        Ok(heights)
    }
}
