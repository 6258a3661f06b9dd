//! What is computed, the limits of it, and why it can fail.

/// Fewest and most directions.
pub const VIEWS: std::ops::RangeInclusive<u32> = 1..=4096;
/// Smallest and largest side of a depth map, in texels.
pub const MAP_PX: std::ops::RangeInclusive<u32> = 64..=4096;
/// Most vertices, and most triangles, of mesh and occluders together.
pub const MAX_COUNT: usize = 1 << 26;
/// Larger coordinates are refused. Below it, all intermediate numbers are finite.
pub const MAX_COORDINATE: f64 = 1e15;

/// How finely occlusion is sampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OcclusionSettings {
    /// Number of directions, within [`VIEWS`]. They come in opposite pairs: an odd number counts as the next one.
    pub views: u32,
    /// Side of a depth map in texels, within [`MAP_PX`].
    pub map_px: u32,
    /// Whether the mean visible directions are wanted as well.
    pub bent_normals: bool,
}

impl Default for OcclusionSettings {
    /// Those of the report (Mischitelli 2007, 3.6.1).
    fn default() -> Self {
        Self { views: 256, map_px: 1024, bent_normals: false }
    }
}

impl OcclusionSettings {
    /// Number of pairs of opposite directions.
    pub(crate) fn pairs(self) -> u32 {
        self.views.div_ceil(2)
    }

    /// Fails if a number is out of its range.
    pub(crate) fn check(self) -> Result<(), OcclusionError> {
        if !VIEWS.contains(&self.views) {
            return Err(OcclusionError::Views(self.views));
        }
        if !MAP_PX.contains(&self.map_px) {
            return Err(OcclusionError::MapPx(self.map_px));
        }
        Ok(())
    }
}

/// A mesh whose vertices get values.
#[derive(Debug, Clone, Copy)]
pub struct OccludedMesh<'a> {
    /// Vertices in any unit. Vertices at the same position should be one, because normals are per vertex.
    pub positions: &'a [[f64; 3]],
    /// Triples of vertices, counter-clockwise from outside.
    pub triangles: &'a [[u32; 3]],
}

/// How open a mesh is at its vertices.
#[derive(Debug, Clone, PartialEq)]
pub struct Occlusion {
    /// For each vertex the cosine-weighted share of its hemisphere that is visible: 0 is closed, 1 open. Vertices without a
    /// normal (no triangle, or only degenerate ones) have 1.
    pub share: Vec<f32>,
    /// For each vertex the mean of the visible directions, weighted like the share, as a unit vector; its normal where nothing is visible, 0 where it
    /// has none. `None` unless [`OcclusionSettings::bent_normals`].
    pub bent_normals: Option<Vec<[f32; 3]>>,
}

/// Why there is no occlusion.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum OcclusionError {
    #[error("{0} views are asked for, 1 to 4096 are possible")]
    Views(u32),
    #[error("depth maps of {0} texels are asked for, 64 to 4096 are possible")]
    MapPx(u32),
    #[error("more than {MAX_COUNT} vertices or triangles")]
    TooMany,
    #[error("vertex {0} has a coordinate that is not finite, or beyond 10^15")]
    Position(usize),
    #[error("occluder {0} has a coordinate that is not finite, or beyond 10^15")]
    Occluder(usize),
    #[error("triangle {0} refers to a vertex that does not exist")]
    Triangle(usize),
    #[error("cancelled")]
    Cancelled,
    /// The device failed, or there is none.
    #[error("{0}")]
    Gpu(String),
}
