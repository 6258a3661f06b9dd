//! Ambient occlusion of dense meshes: which share of its surroundings each vertex sees.
//!
//! After Mischitelli (*Tecniche di visualizzazione avanzata in tempo reale*, Ferrara 2007, chapter 3). For a vertex `p` with the normal `n`, occlusion
//! is the sum of `n.w` over the directions `w` above its tangent plane from which `p` is visible, divided by the sum of `n.w`
//! over all directions above it: 0 is closed, 1 is open. The directions are spread evenly over the sphere. From each, all
//! triangles are drawn into a depth map without perspective, and every vertex that faces it is compared with the map.
//!
//! Triangles occlude from both sides. Scans have holes, and a ray that enters one meets the back of a surface.
//!
//! [`cpu()`] defines the result. `gpu` (feature `gpu`) differs from it only by the rounding of depths within a triangle: places
//! in maps, the texels that triangles cover and all sums are whole numbers, which are the same everywhere. The result of
//! [`cpu()`] does not depend on the number of threads.

mod cpu;
mod depth_map;
#[cfg(feature = "gpu")]
mod gpu;
mod prepared;
mod sums;
#[cfg(test)]
mod tests;

use depth_map::{DepthMap, Projected};
use glam::DVec3;
pub use prepared::REACH_RADII;
use prepared::{MapFrame, PreparedScene, SUBTEXEL_BITS};
use std::f64::consts::PI;
use sums::COSINE_BITS;

/// Occlusion of a mesh's vertices, on all threads of the current rayon pool.
///
/// `occluders` are triangles in the mesh's coordinates that hide it but get no values, such as the ground that a statue
/// stands on. They are cut off beyond [`REACH_RADII`] radii of the mesh's bounding sphere. `watch` gets the number of views
/// that are done, from any thread; it cancels the work by `false`.
///
/// Fails if settings or counts are out of range, a coordinate is not finite or too large, a triangle has no vertex, or the
/// work was cancelled. Memory: 24 bytes a vertex and 12 a triangle, and for each thread 8 bytes a texel and up to 32 a
/// vertex; fewer threads work if that would exceed 2 GiB.
pub fn cpu(
    mesh: OccludedMesh<'_>,
    occluders: &[[[f64; 3]; 3]],
    settings: OcclusionSettings,
    watch: &(dyn Fn(u32) -> bool + Sync),
) -> Result<Occlusion, OcclusionError> {
    let scene = PreparedScene::new(mesh, occluders, settings)?;
    let sums = cpu::sums(&scene, &view_pairs(settings.pairs()), settings.bent_normals, watch)?;
    Ok(sums.finish(&scene, settings.bent_normals))
}

/// The same on the first graphics device that the environment allows.
///
/// Fails like [`cpu()`], and if there is no device, or it is too small for the mesh.
#[cfg(feature = "gpu")]
pub fn gpu(
    mesh: OccludedMesh<'_>,
    occluders: &[[[f64; 3]; 3]],
    settings: OcclusionSettings,
    watch: &(dyn Fn(u32) -> bool + Sync),
) -> Result<Occlusion, OcclusionError> {
    let scene = PreparedScene::new(mesh, occluders, settings)?;
    let sums = gpu::sums(&scene, &view_pairs(settings.pairs()), settings.bent_normals, watch)?;
    Ok(sums.finish(&scene, settings.bent_normals))
}

/// Length of a unit vector's whole numbers.
pub(crate) const UNIT: f64 = 16_384.0;
/// Its binary logarithm.
pub(crate) const UNIT_SHIFT: u32 = 14;

/// Two opposite directions, in whole numbers, so that the CPU and every GPU project a vertex to the same place, to the last bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ViewPair {
    /// Right, down and towards the viewer: nearly orthogonal vectors of length [`UNIT`].
    pub(crate) axes: [[i32; 3]; 3],
}

/// `count` pairs, spread evenly over the sphere: a spherical Fibonacci set on one half (Keinert et al. 2015, "Spherical
/// Fibonacci mapping"), and its opposites.
pub(crate) fn view_pairs(count: u32) -> Vec<ViewPair> {
    let golden_angle_rad = PI * (3.0 - 5f64.sqrt());
    let pair = |i: u32| {
        let z = 1.0 - (f64::from(i) + 0.5) / f64::from(count);
        let (sin, cos) = libm::sincos(f64::from(i) * golden_angle_rad);
        let r = (1.0 - z * z).sqrt();
        let whole = |v: DVec3| (v * UNIT).round().as_ivec3().to_array();
        let towards = whole(DVec3::new(r * cos, r * sin, z));
        // The other axes belong to the rounded direction.
        let axis = DVec3::from(towards.map(f64::from)).normalize_or(DVec3::Z);
        let (right, down) = axis.any_orthonormal_pair();
        ViewPair { axes: [whole(right), whole(down), towards] }
    };
    (0..count).map(pair).collect()
}

/// Scalar product with whole numbers, without rounding.
#[inline(always)]
pub(crate) fn dot(a: [i32; 3], b: [i32; 3]) -> i64 {
    i64::from(a[0]) * i64::from(b[0]) + i64::from(a[1]) * i64::from(b[1]) + i64::from(a[2]) * i64::from(b[2])
}

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

/// A vertex may lie this much behind a map's depth, in texels, besides what its surface is inclined by (3.3.1).
pub(crate) const BIAS_TEXELS: f32 = 0.75;
/// The same for each unit of the surface's slope in the map.
pub(crate) const BIAS_PER_SLOPE: f32 = 0.25;
/// Up to this slope.
pub(crate) const MAX_BIAS_SLOPE: f32 = 8.0;
/// Steeper surfaces are treated like those of this slope. Their cosine, and with it their weight, is small.
pub(crate) const MAX_SLOPE: f32 = 100.0;
/// By how much products of two unit vectors are shifted to give cosines.
pub(crate) const COSINE_SHIFT: u32 = 2 * UNIT_SHIFT - COSINE_BITS;

#[inline(always)]
pub(crate) fn project(place: [i32; 3], pair: ViewPair, frame: MapFrame) -> Projected {
    let (shift, middle) = (frame.product_shift(), frame.middle());
    let [right, down, towards] = pair.axes;
    [
        (dot(right, place) >> shift) as i32 + middle,
        (dot(down, place) >> shift) as i32 + middle,
        (dot(towards, place) >> UNIT_SHIFT) as i32,
    ]
}

/// The product of a vertex's normal with the first direction of a pair, and whether the vertex is seen from that direction
/// of the pair which it faces.
///
/// The map's depth belongs to the centre of a texel. It is compared with the depth that the vertex's tangent plane has
/// there, so that only the curvature remains for the bias to cover. Both sides of the inequality are multiplied by the
/// cosine.
#[inline(always)]
pub(crate) fn sees(
    normal: [i32; 3],
    [x, y, depth]: Projected,
    pair: ViewPair,
    frame: MapFrame,
    map: &DepthMap,
) -> (i32, bool) {
    let [right, down, towards] = pair.axes;
    let facing = dot_of_units(towards, normal);
    let (along_x, along_y) = (dot_of_units(right, normal) as f32, dot_of_units(down, normal) as f32);
    let along = (along_x * along_x + along_y * along_y).sqrt();
    let cosine = (facing.unsigned_abs() as f32).max(along / MAX_SLOPE);
    let [near, far] = map.depths(x >> SUBTEXEL_BITS, y >> SUBTEXEL_BITS);
    let in_front = if facing > 0 { near - depth as f32 } else { depth as f32 - far };
    let texel = frame.texel_steps();
    let plane = -(along_x * to_centre(x) + along_y * to_centre(y));
    let bias = BIAS_TEXELS * cosine + BIAS_PER_SLOPE * along.min(MAX_BIAS_SLOPE * cosine);
    (facing, in_front * cosine <= texel * (plane + bias))
}

/// From a step of a map to the centre of its texel, in texels.
#[inline(always)]
fn to_centre(step: i32) -> f32 {
    const TEXEL: i32 = 1 << SUBTEXEL_BITS;
    (TEXEL / 2 - (step & (TEXEL - 1))) as f32 / TEXEL as f32
}

/// Scalar product of two vectors whose lengths have at most 15 bits.
#[inline(always)]
fn dot_of_units(a: [i32; 3], b: [i32; 3]) -> i32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
