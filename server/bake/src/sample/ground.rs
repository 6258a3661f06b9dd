//! Generated ground: its heights at the vertices of a coarse grid, and how much of the sky it sees there.
//!
//! It takes no part in the sampling of columns, because readers make its columns from these values
//! (`insula_protocol::blockmap::ground`).

use super::local_block::{GROUND_MARGIN_CELLS, LocalBlock};
use super::rasterise::rasterise;
use super::visibility_map::VisibilityMap;
use crate::columns::voxels::VoxelGround;
use glam::{Vec2, Vec3, Vec3Swizzles};
use insula_protocol::TileId;
use insula_protocol::blockmap::ground::{SQUARE_CELLS, SQUARES, VERTEX_COUNT, VERTICES, is_rising_diagonal};

/// Distance of the points whose sky is measured, in cells.
const POINT_CELLS: usize = 2;
/// Height of these points above the ground, in cells.
const LIFT_CELLS: f32 = 0.05;
/// Points that see a smaller share of the sky are in buildings: lines that are nearly level pass under their walls.
const LEAST_SKY: f32 = 0.02;
/// Number of no triangle of a block.
const NO_TRIANGLE: u32 = u32::MAX - 1;

/// A point on the ground.
#[derive(Debug, Clone, Copy)]
struct LightPoint {
    position: Vec3,
    /// Sum of the upward parts of the directions from which it is visible.
    cosines: f32,
}

/// The generated ground of a block.
#[derive(Debug)]
pub(super) struct LocalGround {
    /// Number of vertices along x and y.
    size: [usize; 2],
    /// Height of each vertex; NaN beyond the ground.
    heights_m: Vec<f32>,
    /// Whether each vertex is a corner of a triangle.
    is_corner: Vec<bool>,
    /// Whether the square to the north-east of each vertex has ground.
    has_ground: Vec<bool>,
    points: Vec<LightPoint>,
    /// What `cosines` is for a point in the open.
    open_cosines: f32,
}

impl LocalGround {
    /// `None` if the block has no generated ground.
    pub(super) fn new(block: &LocalBlock) -> Option<Self> {
        if block.ground.is_empty() {
            return None;
        }
        let size = block.cells.map(|n| n / SQUARE_CELLS + 1);
        let square_m = SQUARE_CELLS as f32 * block.cell_m;
        let at_vertex = |x: usize, y: usize| Vec2::new(x as f32, y as f32) * square_m;
        let vertices = || (0..size[0] * size[1]).map(|i| [i % size[0], i / size[0]]);
        let surface = InterpolatedGround { triangles: &block.ground };
        let heights_m = vertices().map(|[x, y]| surface.height_at(at_vertex(x, y)).unwrap_or(f32::NAN)).collect();
        let has_ground = vertices().map(|[x, y]| {
            // The middles of both triangles.
            let [a, b] = if is_rising_diagonal(x, y) { [[0.7, 0.3], [0.3, 0.7]] } else { [[0.3, 0.3], [0.7, 0.7]] };
            let is_covered = |at: [f32; 2]| surface.height_at(at_vertex(x, y) + Vec2::from(at) * square_m).is_some();
            x + 1 < size[0] && y + 1 < size[1] && (is_covered(a) || is_covered(b))
        });
        let has_ground = has_ground.collect();
        let mut is_corner = vec![false; size[0] * size[1]];
        for corner in block.ground.iter().flatten() {
            let [x, y] = [corner.x, corner.y].map(|v| (v / square_m).round());
            if x >= 0.0 && y >= 0.0 && (x as usize) < size[0] && (y as usize) < size[1] {
                is_corner[y as usize * size[0] + x as usize] = true;
            }
        }
        let points = light_points(block, &surface);
        Some(Self { size, heights_m, is_corner, has_ground, points, open_cosines: 0.0 })
    }

    /// Adds what the points see in the direction of a map.
    pub(super) fn add_direction(&mut self, block: &LocalBlock, map: &VisibilityMap) {
        let cosine = map.direction().z;
        self.open_cosines += cosine;
        for point in &mut self.points {
            if map.is_visible(block, point.position, Vec3::Z, NO_TRIANGLE) {
                point.cosines += cosine;
            }
        }
    }

    /// The ground of a leaf; `None` if it has none.
    pub(super) fn of_leaf(&self, block: &LocalBlock, leaf: TileId) -> Option<VoxelGround> {
        let first = [leaf.x() - block.first_leaf[0], leaf.y() - block.first_leaf[1]].map(|n| n as usize * SQUARES);
        let index = |x: usize, y: usize| (first[1] + y) * self.size[0] + first[0] + x;
        let bit = |i: usize| u64::from(self.has_ground[index(i % SQUARES, i / SQUARES)]) << i;
        let squares = (0..SQUARES * SQUARES).map(bit).fold(0, |all, bit| all | bit);
        let vertices = |of: &dyn Fn(usize, usize) -> f32| std::array::from_fn(|i| of(i % VERTICES, i / VERTICES));
        let heights_m = vertices(&|x, y| self.heights_m[index(x, y)]);
        let square_m = SQUARE_CELLS as f32 * block.cell_m;
        let sky = vertices(&|x, y| {
            let at = Vec2::new((first[0] + x) as f32, (first[1] + y) as f32) * square_m;
            self.sky_at(at, GROUND_MARGIN_CELLS as f32 * block.cell_m)
        });
        let corner = |i: usize| u128::from(self.is_corner[index(i % VERTICES, i / VERTICES)]) << i;
        let corners = (0..VERTEX_COUNT).map(corner).fold(0, |all, bit| all | bit);
        VoxelGround::new(heights_m, sky, squares, Some(corners))
    }

    /// Mean share of the sky around a point, without points in buildings; NaN if there are no others.
    fn sky_at(&self, at: Vec2, reach_m: f32) -> f32 {
        let least_cosines = LEAST_SKY * self.open_cosines;
        let (mut sum, mut weight) = (0.0, 0.0);
        for point in self.points.iter().filter(|point| point.cosines > least_cosines) {
            let tent = 1.0 - (point.position.xy() - at).abs() / reach_m;
            if tent.x > 0.0 && tent.y > 0.0 {
                sum += tent.x * tent.y * point.cosines;
                weight += tent.x * tent.y;
            }
        }
        sum / weight / self.open_cosines
    }
}

/// Points in and around the block on the ground, except where it passes under given terrain: nobody sees it there.
fn light_points(block: &LocalBlock, surface: &InterpolatedGround<'_>) -> Vec<LightPoint> {
    let margin = GROUND_MARGIN_CELLS.div_ceil(POINT_CELLS);
    let size = block.cells.map(|n| n / POINT_CELLS + 2 * margin);
    let step_m = POINT_CELLS as f32 * block.cell_m;
    let corner = Vec2::splat(-(margin as f32) * step_m);
    let at = |x: usize, y: usize| (Vec2::new(x as f32, y as f32) + 0.5) * step_m + corner;
    let mut heights_m: Vec<Option<f32>> =
        (0..size[0] * size[1]).map(|i| surface.height_at(at(i % size[0], i / size[0]))).collect();
    for triangle in block.triangles.iter().filter(|triangle| triangle.is_terrain && triangle.normal.z > 1e-4) {
        let (n, origin) = (triangle.normal, triangle.corners[0]);
        rasterise(triangle.corners.map(|c| (c.xy() - corner).to_array()), step_m, size, |y, first, end| {
            for x in first..end {
                let terrain_m = origin.z - n.xy().dot(at(x, y) - origin.xy()) / n.z;
                let height_m = &mut heights_m[y * size[0] + x];
                *height_m = height_m.filter(|height_m| *height_m > terrain_m);
            }
        });
    }
    let point = |(i, height_m): (usize, Option<f32>)| {
        let position = at(i % size[0], i / size[0]).extend(height_m? + LIFT_CELLS * block.cell_m);
        Some(LightPoint { position, cosines: 0.0 })
    };
    heights_m.into_iter().enumerate().filter_map(point).collect()
}

/// Triangles that do not overlap, seen from above.
struct InterpolatedGround<'a> {
    triangles: &'a [[Vec3; 3]],
}

impl InterpolatedGround<'_> {
    fn height_at(&self, p: Vec2) -> Option<f32> {
        /// Share of a triangle's size by which it reaches over its edges.
        const SLACK: f32 = 1e-4;
        self.triangles.iter().find_map(|[a, b, c]| {
            let (ab, ac, ap) = (b.xy() - a.xy(), c.xy() - a.xy(), p - a.xy());
            let area = ab.perp_dot(ac);
            let (u, v) = (ap.perp_dot(ac) / area, ab.perp_dot(ap) / area);
            (u >= -SLACK && v >= -SLACK && u + v <= 1.0 + SLACK).then_some(a.z + u * (b.z - a.z) + v * (c.z - a.z))
        })
    }
}
