//! Mesh and occluders on a grid of whole numbers, with normals: what the CPU and the GPU work on.

use crate::{MAX_COORDINATE, MAX_COUNT, OccludedMesh, OcclusionError, OcclusionSettings, UNIT, UNIT_SHIFT};
use glam::DVec3;

/// Binary logarithm of the steps that a texel is divided into. GPUs that follow Vulkan or Direct3D place corners of triangles
/// at least as finely, so that they fill the same texels.
pub(crate) const SUBTEXEL_BITS: u32 = 8;
/// Texels between the mesh and each border of a map.
const MARGIN_PX: u32 = 2;
/// Most steps of the grid from the centre to the farthest vertex.
const MAX_RADIUS_STEPS: u32 = 1 << 20;
/// A mesh with a smaller radius counts as a point.
const MIN_RADIUS: f64 = 1e-200;
/// Occluders farther from the mesh's centre are cut off, as a multiple of its radius, along each axis. At the edge of level
/// ground that is cut off, 1 degree above the true horizon opens.
pub const REACH_RADII: f64 = 60.0;

/// Mesh and occluders on a grid.
pub(crate) struct PreparedScene {
    /// Vertices of the mesh, then of the occluders, in steps from the centre.
    pub(crate) places: Vec<[i32; 3]>,
    /// Normals of the mesh's vertices, of length [`UNIT`], or 0.
    pub(crate) normals: Vec<[i32; 3]>,
    /// Triangles of the mesh, then of the occluders.
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) frame: MapFrame,
}

/// How the grid lies in a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct MapFrame {
    pub(crate) size_px: u32,
    /// Binary logarithm of the grid's steps in a step of a map, of which a texel has 2^[`SUBTEXEL_BITS`].
    pub(crate) shift: u32,
}

impl MapFrame {
    fn new(size_px: u32) -> Self {
        let radius = Self { size_px, shift: 0 }.radius_steps();
        Self { size_px, shift: (MAX_RADIUS_STEPS / radius).ilog2() }
    }

    /// Steps of the grid from the centre to the farthest vertex.
    fn radius_steps(self) -> u32 {
        (self.size_px / 2 - MARGIN_PX) << (SUBTEXEL_BITS + self.shift)
    }

    /// By how much products of an axis and a place are shifted to give steps of a map.
    pub(crate) fn product_shift(self) -> u32 {
        UNIT_SHIFT + self.shift
    }

    /// The middle of the map, in its steps.
    pub(crate) fn middle(self) -> i32 {
        (self.size_px << SUBTEXEL_BITS) as i32 / 2
    }

    /// Steps of the grid in a texel.
    pub(crate) fn texel_steps(self) -> f32 {
        (1u32 << (SUBTEXEL_BITS + self.shift)) as f32
    }
}

impl PreparedScene {
    /// Fails if settings, counts or coordinates are out of range.
    pub(crate) fn new(
        mesh: OccludedMesh<'_>,
        occluders: &[[[f64; 3]; 3]],
        settings: OcclusionSettings,
    ) -> Result<Self, OcclusionError> {
        check(mesh, occluders, settings)?;
        let bounds = mesh.positions.iter().map(|p| DVec3::from(*p));
        let low = bounds.clone().reduce(DVec3::min).unwrap_or_default();
        let high = bounds.clone().reduce(DVec3::max).unwrap_or_default();
        let centre = low + (high - low) / 2.0;
        let radius = bounds.map(|p| p.distance(centre)).fold(0.0, f64::max);
        let frame = MapFrame::new(settings.map_px);
        // Any grid does for a mesh that is a point.
        let per_unit = f64::from(frame.radius_steps()) / if radius > MIN_RADIUS { radius } else { 1.0 };
        let place = |p: DVec3| ((p - centre) * per_unit).round().as_ivec3().to_array();
        let mut places: Vec<[i32; 3]> = mesh.positions.iter().map(|p| place(DVec3::from(*p))).collect();
        let mut triangles = mesh.triangles.to_vec();
        let reach = radius.max(MIN_RADIUS) * REACH_RADII;
        for corners in occluders {
            let near = clip(corners.map(|p| DVec3::from(p) - centre), reach);
            let first = places.len() as u32;
            places.extend(near.iter().map(|p| place(*p + centre)));
            triangles.extend((2..near.len() as u32).map(|k| [first, first + k - 1, first + k]));
            // Clipping makes up to seven triangles of one.
            if places.len().max(triangles.len()) > MAX_COUNT {
                return Err(OcclusionError::TooMany);
            }
        }
        // Triangles that lie side by side in space do so in all maps, so that they find them in the cache.
        triangles.sort_by_cached_key(|triangle| morton(places[triangle[0] as usize]));
        Ok(Self { places, normals: normals(mesh, |p| (DVec3::from(p) - centre) * per_unit), triangles, frame })
    }
}

/// The place of a point on Morton's curve (Morton 1966). Occluders beyond the mesh share its ends.
fn morton(place: [i32; 3]) -> u32 {
    let spread = |value: i32| {
        let bits = ((value >> 12) + 256).clamp(0, 511) as u32;
        (0..9).fold(0, |sum, bit| sum | (bits >> bit & 1) << (3 * bit))
    };
    spread(place[0]) | spread(place[1]) << 1 | spread(place[2]) << 2
}

fn check(
    mesh: OccludedMesh<'_>,
    occluders: &[[[f64; 3]; 3]],
    settings: OcclusionSettings,
) -> Result<(), OcclusionError> {
    settings.check()?;
    let triangles = mesh.triangles.len().saturating_add(occluders.len());
    let vertices = mesh.positions.len().saturating_add(occluders.len().saturating_mul(3));
    if triangles.max(vertices) > MAX_COUNT {
        return Err(OcclusionError::TooMany);
    }
    // NaN fails too.
    let is_bad = |p: &[f64; 3]| !p.iter().all(|v| v.abs() <= MAX_COORDINATE);
    if let Some(at) = mesh.positions.iter().position(is_bad) {
        return Err(OcclusionError::Position(at));
    }
    if let Some(at) = occluders.iter().position(|corners| corners.iter().any(is_bad)) {
        return Err(OcclusionError::Occluder(at));
    }
    let is_missing = |triangle: &[u32; 3]| triangle.iter().any(|vertex| *vertex as usize >= mesh.positions.len());
    match mesh.triangles.iter().position(is_missing) {
        Some(at) => Err(OcclusionError::Triangle(at)),
        None => Ok(()),
    }
}

/// The part of a triangle within `reach` of the origin along each axis (Sutherland and Hodgman 1974): a polygon, or nothing.
fn clip(triangle: [DVec3; 3], reach: f64) -> Vec<DVec3> {
    let mut polygon = triangle.to_vec();
    for (axis, sign) in (0..3).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]) {
        let beyond = |p: DVec3| sign * p[axis] - reach;
        let mut inside = Vec::with_capacity(polygon.len() + 1);
        for (i, b) in polygon.iter().enumerate() {
            let a = polygon[(i + polygon.len() - 1) % polygon.len()];
            let (out_a, out_b) = (beyond(a), beyond(*b));
            if (out_a > 0.0) != (out_b > 0.0) {
                inside.push(a + (*b - a) * (out_a / (out_a - out_b)));
            }
            if out_b <= 0.0 {
                inside.push(*b);
            }
        }
        polygon = inside;
    }
    polygon
}

/// Normals of the vertices, weighted by the triangles' angles (Thürmer and Wüthrich 1998).
fn normals(mesh: OccludedMesh<'_>, place: impl Fn([f64; 3]) -> DVec3) -> Vec<[i32; 3]> {
    let mut sums = vec![DVec3::ZERO; mesh.positions.len()];
    for triangle in mesh.triangles {
        let corners = triangle.map(|vertex| place(mesh.positions[vertex as usize]));
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        for k in 0..3 {
            let [a, b] = [1, 2].map(|step| (corners[(k + step) % 3] - corners[k]).normalize_or_zero());
            sums[triangle[k] as usize] += normal * libm::acos(a.dot(b).clamp(-1.0, 1.0));
        }
    }
    let whole = |sum: &DVec3| (sum.normalize_or_zero() * UNIT).round().as_ivec3().to_array();
    sums.iter().map(whole).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn occluders_are_cut_off_at_their_reach() {
        let corner = |x: f64, y: f64| DVec3::new(x, y, 0.5);
        let inside = [corner(0.0, 0.0), corner(0.5, 0.0), corner(0.0, 0.5)];
        assert_eq!(clip(inside, 1.0), inside);
        assert!(clip([corner(2.0, 0.0), corner(3.0, 0.0), corner(2.0, 1.0)], 1.0).is_empty());
        let large = clip([corner(-9.0, -9.0), corner(90.0, -9.0), corner(-9.0, 90.0)], 1.0);
        let area: f64 = (2..large.len()).map(|k| (large[k - 1] - large[0]).cross(large[k] - large[0]).z / 2.0).sum();
        assert!((area - 4.0).abs() < 1e-9, "{large:?}");
    }

    #[test]
    fn numbers_stay_within_those_of_the_gpu() {
        let far = [[-1e15, -1e15, -1.0], [1e15, -1e15, -1.0], [0.0, 1e15, -1.0]];
        let mesh = OccludedMesh { positions: &[[1.0, 0.0, 0.0], [0.0; 3], [0.0, 1.0, 0.0]], triangles: &[[0, 1, 2]] };
        for map_px in [64, 100, 1000, 4096] {
            let settings = OcclusionSettings { map_px, ..OcclusionSettings::default() };
            let scene = PreparedScene::new(mesh, &[far], settings).unwrap();
            let (mesh, far) = scene.places.split_at(3);
            let most = |places: &[[i32; 3]]| places.as_flattened().iter().map(|v| v.abs()).max().unwrap_or(0);
            assert!(most(mesh) <= 1 << 20 && most(mesh) > 1 << 18, "{map_px}: {mesh:?}");
            // The product with an axis, after the split of the GPU, has 31 bits.
            assert!(!far.is_empty() && f64::from(most(far)) * 3f64.sqrt() * UNIT / 1024.0 < f64::from(i32::MAX));
        }
    }
}
