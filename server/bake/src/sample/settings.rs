//! Input and settings of the sampling of a block.

use super::nearest;
use crate::scene::Scene;
use crate::scene::grid::CityGrid;
use insula_protocol::TileId;
use serde::Serialize;

/// What draws the visibility maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum VisibilityBackend {
    #[default]
    Cpu,
    /// A GPU. Texels on the edges of triangles may differ from the CPU's, so the tiles are not identical byte for byte.
    Gpu,
}

impl VisibilityBackend {
    /// Checks that the backend can be used on this machine.
    ///
    /// # Errors
    ///
    /// Fails if the program was built without feature `gpu`, or if no device works. The message says which.
    pub fn check(self) -> Result<(), String> {
        match self {
            Self::Cpu => Ok(()),
            Self::Gpu => nearest::check(),
        }
    }
}

/// What decides the result of a bake besides its sources. The manifest contains a hash of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SampleSettings {
    /// Number of directions over the upper half of the sphere. They give ambient occlusion and what is visible from
    /// above.
    pub sky_directions: u32,
    /// Number of directions from a little below the horizon. They give what is visible of undersides. Steeper
    /// directions would look into shells without a floor, which no viewer above the ground can do.
    pub low_directions: u32,
    /// Width of the margin around a block. Its triangles only occlude.
    pub margin_m: f64,
    /// What draws the visibility maps.
    pub visibility: VisibilityBackend,
}

impl Default for SampleSettings {
    fn default() -> Self {
        Self { sky_directions: 128, low_directions: 32, margin_m: 64.0, visibility: VisibilityBackend::Cpu }
    }
}

impl SampleSettings {
    /// With this many directions over the upper half of the sphere, and a quarter as many from below the horizon.
    pub fn with_views(views: u32) -> Self {
        Self { sky_directions: views, low_directions: views / 4, ..Self::default() }
    }
}

/// One block of leaves to sample.
#[derive(Debug, Clone, Copy)]
pub struct BlockInput<'a> {
    /// The city, or the part of it around the block.
    pub scene: &'a Scene,
    /// CityGrid of the whole city.
    pub grid: &'a CityGrid,
    /// Indices of the triangles that touch the block or its margin, ascending.
    pub triangles: &'a [u32],
    /// The leaves of the block that are not known to be empty.
    pub leaves: &'a [TileId],
}
