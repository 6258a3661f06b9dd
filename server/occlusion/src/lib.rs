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
mod settings;
mod sums;
#[cfg(test)]
mod tests;
mod visibility;

use glam::DVec3;
use prepared::PreparedScene;
pub use prepared::REACH_RADII;
pub use settings::{
    MAP_PX, MAX_COORDINATE, MAX_COUNT, OccludedMesh, Occlusion, OcclusionError, OcclusionSettings, VIEWS,
};
use std::f64::consts::PI;

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
