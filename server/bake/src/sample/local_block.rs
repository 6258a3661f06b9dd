//! A block's triangles in coordinates of the block.

use super::settings::{BlockInput, SampleSettings};
use crate::scene::ObjectKind;
use glam::{DMat3, DVec3, Vec3};
use insula_protocol::NODE_CELLS;

/// Surfaces whose normal has a larger z are tops, those with a smaller z than its negative undersides, all others
/// walls.
pub(super) const MIN_TOP_NORMAL_Z: f32 = 0.35;
/// Light of the ground's vertices is measured up to this distance along both axes, in cells. Points outside of the block count,
/// too, so that blocks agree on the vertices of their common border.
pub(super) const GROUND_MARGIN_CELLS: usize = 6;

/// A triangle in metres from the block's south-west corner and the grid's height zero.
#[derive(Debug, Clone, Copy)]
pub(super) struct LocalTriangle {
    pub(super) corners: [Vec3; 3],
    /// Unit normal by the source's corner order; terrain's always points up.
    pub(super) normal: Vec3,
    pub(super) area_m2: f32,
    pub(super) is_terrain: bool,
    /// Index into the scene's objects.
    pub(super) object: u32,
    /// Lowest point of its object.
    pub(super) object_bottom_m: f32,
    /// Whether its object is a closed shell with outward normals. Then its back is never visible.
    pub(super) is_closed: bool,
    /// Index into the scene's triangles.
    pub(super) source: u32,
}

impl LocalTriangle {
    pub(super) fn lowest_m(&self) -> f32 {
        self.corners.iter().fold(f32::MAX, |low, corner| low.min(corner.z))
    }

    pub(super) fn highest_m(&self) -> f32 {
        self.corners.iter().fold(f32::MIN, |high, corner| high.max(corner.z))
    }

    /// Lower and upper corner of the bounding box.
    pub(super) fn bounds(&self) -> [Vec3; 2] {
        let low = self.corners.iter().fold(Vec3::MAX, |low, corner| low.min(*corner));
        let high = self.corners.iter().fold(Vec3::MIN, |high, corner| high.max(*corner));
        [low, high]
    }

    /// Whether the triangle is steep enough to be part of a wall.
    pub(super) fn is_wall(&self) -> bool {
        !self.is_terrain && self.normal.z.abs() <= MIN_TOP_NORMAL_Z
    }
}

/// A rectangle of whole leaves with all triangles in and around it.
#[derive(Debug)]
pub(super) struct LocalBlock {
    /// Triangles of one object follow each other.
    pub(super) triangles: Vec<LocalTriangle>,
    /// Corners of the triangles of generated ground.
    pub(super) ground: Vec<[Vec3; 3]>,
    pub(super) cell_m: f32,
    /// Width and height in cells.
    pub(super) cells: [usize; 2],
    /// x and y of the south-west leaf, in leaves of the city.
    pub(super) first_leaf: [u32; 2],
    /// Lowest and highest point of the triangles that overlap the block.
    pub(super) z_range_m: [f32; 2],
    /// Number of directions above the horizon from which visibility is tested.
    pub(super) sky_directions: u32,
    /// All triangles are terrain of one height.
    pub(super) is_level: bool,
}

impl LocalBlock {
    /// `None` if the input has no leaves.
    pub(super) fn new(input: &BlockInput<'_>, settings: &SampleSettings) -> Option<Self> {
        let xs = input.leaves.iter().map(|leaf| leaf.x());
        let ys = input.leaves.iter().map(|leaf| leaf.y());
        let first_leaf = [xs.clone().min()?, ys.clone().min()?];
        let leaves = [xs.max()? - first_leaf[0] + 1, ys.max()? - first_leaf[1] + 1];
        let side_m = input.grid.node_side_m(input.grid.depth);
        let origin = [
            input.grid.corner[0] + f64::from(first_leaf[0]) * side_m,
            input.grid.corner[1] + f64::from(first_leaf[1]) * side_m,
            input.grid.corner[2],
        ];
        let (ground, mut triangles): (Vec<LocalTriangle>, Vec<LocalTriangle>) =
            input.triangles.iter().filter_map(|i| local_triangle(input, *i, origin)).partition(|triangle| {
                input.scene.objects[triangle.object as usize].kind == ObjectKind::GeneratedGround
            });
        mark_closed_shells(&mut triangles);
        let extent_m = leaves.map(|n| (f64::from(n) * side_m) as f32);
        let z_m = triangles.first().map_or(0.0, |triangle| triangle.corners[0].z);
        let is_level = ground.is_empty()
            && triangles.iter().all(|triangle| triangle.is_terrain && triangle.corners.iter().all(|c| c.z == z_m));
        Some(Self {
            z_range_m: z_range_m(triangles.iter().chain(&ground), extent_m),
            is_level,
            triangles,
            ground: ground.into_iter().map(|triangle| triangle.corners).collect(),
            cell_m: input.grid.cell_m as f32,
            cells: leaves.map(|n| n as usize * NODE_CELLS),
            first_leaf,
            sky_directions: settings.sky_directions,
        })
    }

    /// Width and height in metres.
    pub(super) fn extent_m(&self) -> [f32; 2] {
        self.cells.map(|n| n as f32 * self.cell_m)
    }
}

/// `None` for triangles without area or with coordinates that are not finite.
fn local_triangle(input: &BlockInput<'_>, index: u32, origin: [f64; 3]) -> Option<LocalTriangle> {
    let triangle = input.scene.triangles.get(index as usize)?;
    let object = input.scene.objects.get(triangle.object as usize)?;
    let corners = triangle
        .corners
        .map(|c| Vec3::from_array(std::array::from_fn(|axis| (f64::from(c[axis]) - origin[axis]) as f32)));
    let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let length = cross.length();
    if !length.is_finite() || length <= 1e-9 {
        return None;
    }
    let is_terrain = object.kind.is_terrain();
    let normal = cross / length;
    Some(LocalTriangle {
        corners,
        normal: if is_terrain && normal.z < 0.0 { -normal } else { normal },
        area_m2: length * 0.5,
        is_terrain,
        object: triangle.object,
        object_bottom_m: (f64::from(object.base_z_m) - origin[2]) as f32,
        is_closed: false,
        source: index,
    })
}

/// Sets `is_closed`. Relies on the triangles of an object following each other.
fn mark_closed_shells(triangles: &mut [LocalTriangle]) {
    for object in triangles.chunk_by_mut(|a, b| a.object == b.object) {
        let is_closed = !object[0].is_terrain && is_closed_shell(object);
        object.iter_mut().for_each(|triangle| triangle.is_closed = is_closed);
    }
}

/// Whether an object's triangles form a closed surface with outward normals.
///
/// By the divergence theorem, over a closed surface the integral of the normal is zero, and the integral of position
/// times normal is the volume times the unit matrix. This needs no shared vertices, so a corner in the middle of
/// another polygon's edge does no harm.
fn is_closed_shell(triangles: &[LocalTriangle]) -> bool {
    /// Share of the surface that may be missing; ten times as much of the volume.
    const TOLERANCE: f64 = 1e-4;
    let origin = triangles[0].corners[0].as_dvec3();
    let (mut normal_sum, mut area_m2, mut moment) = (DVec3::ZERO, 0.0, DMat3::ZERO);
    for triangle in triangles {
        let [a, b, c] = triangle.corners.map(|corner| corner.as_dvec3() - origin);
        let normal = (b - a).cross(c - a) * 0.5;
        let centroid = (a + b + c) / 3.0;
        normal_sum += normal;
        area_m2 += normal.length();
        moment += DMat3::from_cols(centroid * normal.x, centroid * normal.y, centroid * normal.z);
    }
    let volume_m3 = (moment.x_axis.x + moment.y_axis.y + moment.z_axis.z) / 3.0;
    let residual = (moment - DMat3::from_diagonal(DVec3::splat(volume_m3))).to_cols_array();
    let largest_residual = residual.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    volume_m3 > 0.0 && normal_sum.length() < TOLERANCE * area_m2 && largest_residual < TOLERANCE * 10.0 * volume_m3
}

/// Lowest and highest point of the triangles that overlap the block; `[0, 0]` if none does.
fn z_range_m<'a>(triangles: impl Iterator<Item = &'a LocalTriangle>, extent_m: [f32; 2]) -> [f32; 2] {
    let overlaps = |triangle: &&LocalTriangle| {
        let [low, high] = triangle.bounds();
        low.x < extent_m[0] && low.y < extent_m[1] && high.x > 0.0 && high.y > 0.0
    };
    let range = triangles
        .filter(overlaps)
        .flat_map(|triangle| triangle.corners)
        .fold([f32::MAX, f32::MIN], |[low, high], c| [low.min(c.z), high.max(c.z)]);
    if range[0] > range[1] { [0.0; 2] } else { range }
}

#[cfg(test)]
mod tests {
    use crate::sample::local_block::*;

    /// A box of 4 x 3 x 2 m. Triangles 0 and 1 are the floor, 2 and 3 the top, the others the walls.
    fn shell() -> Vec<LocalTriangle> {
        let corner = |i: usize| Vec3::new((i & 1) as f32 * 4.0, (i >> 1 & 1) as f32 * 3.0, (i >> 2) as f32 * 2.0);
        const FACES: [[usize; 4]; 6] =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [3, 2, 6, 7], [2, 0, 4, 6], [1, 3, 7, 5]];
        FACES.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(|t| triangle(t.map(corner))).collect()
    }

    fn triangle(corners: [Vec3; 3]) -> LocalTriangle {
        LocalTriangle {
            corners,
            normal: Vec3::Z,
            area_m2: 1.0,
            is_terrain: false,
            object: 0,
            object_bottom_m: 0.0,
            is_closed: false,
            source: 0,
        }
    }

    #[test]
    fn only_complete_shells_with_outward_normals_are_closed() {
        assert!(is_closed_shell(&shell()));
        let inside_out: Vec<_> = shell().iter().map(|t| triangle([t.corners[0], t.corners[2], t.corners[1]])).collect();
        assert!(!is_closed_shell(&inside_out));
        for missing in [0..1, 0..2, 0..4, 4..8, 0..12] {
            let mut open = shell();
            open.drain(missing);
            assert!(open.is_empty() || !is_closed_shell(&open));
        }
        let mut split = shell();
        // One half of the top, split at the middle of an edge that the wall below does not split.
        let [a, b, c] = split[2].corners;
        split[2] = triangle([a, (a + b) * 0.5, c]);
        split.push(triangle([(a + b) * 0.5, b, c]));
        assert!(is_closed_shell(&split));
    }
}
