//! What a block is sampled from, and with what settings.

use super::nearest;
use crate::scene::{Scene, grid::Grid};
use insula_protocol::TileId;
use serde::Serialize;

/// Who draws the maps of the nearest triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum VisibilityBackend {
    /// The processor.
    #[default]
    Cpu,
    /// A graphics device. Texels on the edges of triangles may differ, so the tiles are not the same byte for byte.
    Gpu,
}

impl VisibilityBackend {
    /// Whether it can be had here. Errors: built without feature `gpu`, or no device works; says what to do.
    pub fn check(self) -> Result<(), String> {
        match self {
            Self::Cpu => Ok(()),
            Self::Gpu => nearest::check(),
        }
    }
}

/// What decides a bake's result besides its sources; hashed into the manifest.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SampleSettings {
    /// Directions over the upper half of the sphere: ambient occlusion, and sightings from above.
    pub sky_directions: u32,
    /// Directions from a little under the horizon: sightings of undersides. Steeper ones would look into shells without a
    /// floor, which no viewer above the ground can.
    pub low_directions: u32,
    /// Width of the rim around a block whose triangles only cast occlusion.
    pub margin_m: f64,
    /// Who draws what is seen.
    pub visibility: VisibilityBackend,
}

impl Default for SampleSettings {
    fn default() -> Self {
        Self { sky_directions: 128, low_directions: 32, margin_m: 64.0, visibility: VisibilityBackend::Cpu }
    }
}

/// The work of one call.
#[derive(Debug, Clone, Copy)]
pub struct BlockInput<'a> {
    /// The city.
    pub scene: &'a Scene,
    /// Its nodes.
    pub grid: &'a Grid,
    /// Indices of the triangles that touch the block or its margin, ascending.
    pub triangles: &'a [u32],
    /// The leaves of the block that may hold something.
    pub leaves: &'a [TileId],
}
