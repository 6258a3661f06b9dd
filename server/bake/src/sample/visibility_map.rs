//! A map of the nearest triangle of a block, seen from one direction.
//!
//! The map is an orthographic projection with texels of half a cell. It stores the number of the nearest triangle per
//! texel. A point is visible unless the planes of the triangles in the four texels around it pass in front of it.
//! Comparing depths at texel centres instead, as shadow maps do, would let light leak along slanted surfaces.

use super::local_block::{GROUND_MARGIN_CELLS, LocalBlock, LocalTriangle, MIN_TOP_NORMAL_Z};
use super::nearest::{self, FacingTriangle};
use super::rasterise::rasterise;
use super::settings::VisibilityBackend;
use glam::{Vec2, Vec3};

/// Side of a texel, in cells.
const TEXEL_CELLS: f32 = 0.5;
/// A triangle occludes a point if it is nearer to the viewer by more than this, in cells.
const TOLERANCE_CELLS: f32 = 0.02;
/// A top that lies at most this far above another, in cells, is a layer on the same ground, such as a road on land use. Seen nearly
/// edge-on, the texels that show it lie far beside it.
const LAYER_CELLS: f32 = 0.3;

/// A point of a triangle whose visibility is tested.
#[derive(Debug, Clone, Copy)]
struct SurfacePoint {
    position: Vec3,
    /// Unit normal of the side that faces the viewer.
    normal: Vec3,
    /// Index into the block's triangles.
    triangle: u32,
}

/// The nearest triangles as seen from one direction.
#[derive(Debug, Default)]
pub(super) struct VisibilityMap {
    backend: VisibilityBackend,
    /// Axis of the map's columns.
    u: Vec3,
    /// Axis of the map's rows.
    v: Vec3,
    /// Unit vector towards the viewer.
    w: Vec3,
    /// Map coordinates (u, v) of the corner of the first texel.
    corner: Vec2,
    texel_m: f32,
    texels_per_m: f32,
    size: [usize; 2],
    /// Index of the nearest triangle plus one, 0 where there is none.
    ids: Vec<u32>,
    /// Distance of the nearest triangle along `w`.
    depths: Vec<f32>,
    /// Plane of each triangle: `w = x * u + y * v + z` in metres from `corner`.
    planes: Vec<Vec3>,
    tolerance_m: f32,
    layer_m: f32,
}

impl VisibilityMap {
    pub(super) fn new(backend: VisibilityBackend) -> Self {
        Self { backend, ..Self::default() }
    }

    /// Unit vector towards the viewer.
    pub(super) fn direction(&self) -> Vec3 {
        self.w
    }

    /// Draws the block as seen from `direction`. A GPU that fails is replaced by the CPU.
    pub(super) fn draw(&mut self, block: &LocalBlock, direction: Vec3) {
        self.aim(block, direction);
        if block.is_level {
            // Nothing is in front of anything: what lies outside of the map is visible.
            self.size = [0; 2];
            return;
        }
        self.planes.clear();
        self.planes.resize(block.triangles.len(), Vec3::ZERO);
        if self.backend == VisibilityBackend::Gpu
            && let Some(ids) = self.draw_on_device(block)
        {
            self.ids = ids;
            return;
        }
        self.ids.clear();
        self.ids.resize(self.size[0] * self.size[1], 0);
        self.depths.clear();
        self.depths.resize(self.size[0] * self.size[1], f32::NEG_INFINITY);
        for (index, triangle) in block.triangles.iter().enumerate() {
            if let Some(corners) = self.project(triangle, index) {
                self.draw_triangle(corners, index);
            }
        }
    }

    fn draw_on_device(&mut self, block: &LocalBlock) -> Option<Vec<u32>> {
        let mut facing: Vec<FacingTriangle> = Vec::with_capacity(block.triangles.len());
        for (index, triangle) in block.triangles.iter().enumerate() {
            if let Some(corners) = self.project(triangle, index) {
                let corner = |i: usize| (corners[i] / self.texel_m).extend(triangle.corners[i].dot(self.w));
                facing.push(FacingTriangle { corners: std::array::from_fn(corner), number: index as u32 + 1 });
            }
        }
        nearest::draw(&facing, self.size)
    }

    /// Sets the map's axes, and its extent to the projection of the block's box with a margin of one cell, or that of the
    /// ground's points.
    fn aim(&mut self, block: &LocalBlock, direction: Vec3) {
        self.w = direction;
        // Walls are mostly taller than wide. With rows that run upwards they fill fewer and longer runs.
        self.v = direction.cross(Vec3::Z).normalize_or(Vec3::Y);
        self.u = self.v.cross(direction);
        self.texel_m = block.cell_m * TEXEL_CELLS;
        self.texels_per_m = 1.0 / self.texel_m;
        self.tolerance_m = block.cell_m * TOLERANCE_CELLS;
        self.layer_m = block.cell_m * LAYER_CELLS;
        let [width_m, height_m] = block.extent_m();
        let margin_cells = if block.ground.is_empty() { 1 } else { GROUND_MARGIN_CELLS + 1 };
        let margin_m = margin_cells as f32 * block.cell_m;
        let (mut low, mut high) = (Vec2::MAX, Vec2::MIN);
        for i in 0..8 {
            let corner = Vec3::new(
                if i & 1 == 0 { -margin_m } else { width_m + margin_m },
                if i & 2 == 0 { -margin_m } else { height_m + margin_m },
                block.z_range_m[i >> 2] + if i & 4 == 0 { -margin_m } else { margin_m },
            );
            let p = self.flatten(corner);
            (low, high) = (low.min(p), high.max(p));
        }
        self.corner = low - self.texel_m;
        let size = ((high - self.corner) / self.texel_m).ceil() + 2.0;
        self.size = [size.x as usize, size.y as usize];
    }

    fn flatten(&self, p: Vec3) -> Vec2 {
        Vec2::new(p.dot(self.u), p.dot(self.v))
    }

    /// Stores the triangle's plane and returns its corners in metres from the map's corner; `None` for triangles that
    /// are seen edge-on, and for backs that can never be nearest.
    fn project(&mut self, triangle: &LocalTriangle, index: usize) -> Option<[Vec2; 3]> {
        let cos = triangle.normal.dot(self.w);
        // The nearest surface of a closed shell always faces the viewer, and so does terrain.
        let is_one_sided = triangle.is_terrain || triangle.is_closed;
        if cos.abs() < 1e-3 || (is_one_sided && cos < 0.0) {
            return None;
        }
        let corners = triangle.corners.map(|c| self.flatten(c) - self.corner);
        // n.p is constant on the plane, so w = (n.c - n.u * u - n.v * v) / n.w.
        let (a, b) = (-triangle.normal.dot(self.u) / cos, -triangle.normal.dot(self.v) / cos);
        let first = corners[0];
        self.planes[index] = Vec3::new(a, b, triangle.corners[0].dot(self.w) - a * first.x - b * first.y);
        Some(corners)
    }

    fn draw_triangle(&mut self, corners: [Vec2; 3], index: usize) {
        let plane = self.planes[index];
        let width = self.size[0];
        let (texel_m, ids, depths) = (self.texel_m, &mut self.ids, &mut self.depths);
        rasterise(corners.map(|c| [c.x, c.y]), texel_m, self.size, |row, first, end| {
            let base = plane.y * (row as f32 + 0.5) * texel_m + plane.z;
            let run = row * width + first..row * width + end;
            let along = plane.x * texel_m;
            let start = (first as f32 + 0.5) * along + base;
            // Without branches, so that the compiler vectorises the loop.
            for (i, (depth, id)) in depths[run.clone()].iter_mut().zip(&mut ids[run]).enumerate() {
                let w = i as i32 as f32 * along + start;
                let is_nearer = w > *depth;
                *depth = if is_nearer { w } else { *depth };
                *id = if is_nearer { index as u32 + 1 } else { *id };
            }
        });
    }

    /// The ids of the four texels around a point of the map; `None` outside.
    #[inline]
    fn ids_around(&self, at: Vec2) -> Option<[u32; 4]> {
        let texel = at * self.texels_per_m - 0.5;
        if texel.x < 0.0 || texel.y < 0.0 {
            return None;
        }
        let (x, y) = (texel.x as usize, texel.y as usize);
        if x + 1 >= self.size[0] || y + 1 >= self.size[1] {
            return None;
        }
        let first = y * self.size[0] + x;
        let second = first + self.size[0];
        Some([self.ids[first], self.ids[first + 1], self.ids[second], self.ids[second + 1]])
    }

    /// Whether a texel around `p` shows the surface of `triangle`: the triangle itself, or one that continues it.
    pub(super) fn shows_surface(&self, block: &LocalBlock, p: Vec3, triangle: &LocalTriangle) -> bool {
        let continues = |id: u32| {
            let other = &block.triangles[id as usize - 1];
            let is_near = other.normal.dot(other.corners[0] - p).abs() < block.cell_m;
            is_near && other.normal.dot(triangle.normal).abs() > 0.7
        };
        let ids = self.ids_around(self.flatten(p) - self.corner);
        ids.is_some_and(|ids| ids.iter().any(|id| *id != 0 && continues(*id)))
    }

    /// Whether the viewer sees a point of `triangle`: none of the triangles in the four texels around it occludes it.
    /// `normal` is the unit normal of the side that faces the viewer.
    #[inline]
    pub(super) fn is_visible(&self, block: &LocalBlock, position: Vec3, normal: Vec3, triangle: u32) -> bool {
        let at = self.flatten(position) - self.corner;
        let Some(ids) = self.ids_around(at) else { return true };
        // The struct is built only here: passed to this function, it costs every call a stalled load.
        ids == [triangle + 1; 4] || !self.is_occluded_by(block, SurfacePoint { position, normal, triangle }, at, ids)
    }

    fn is_occluded_by(&self, block: &LocalBlock, point: SurfacePoint, at: Vec2, ids: [u32; 4]) -> bool {
        let w = point.position.dot(self.w);
        let mut last = point.triangle + 1;
        for id in ids {
            if id == 0 || id == point.triangle + 1 || id == last {
                continue;
            }
            last = id;
            let plane = self.planes[id as usize - 1];
            if plane.x * at.x + plane.y * at.y + plane.z <= w + self.tolerance_m {
                continue;
            }
            // The plane is evaluated past the triangle's edges. A triangle wholly behind the surface of the point
            // cannot occlude it, and a layer beside it hardly does.
            let other = &block.triangles[id as usize - 1];
            let are_tops = point.normal.z > MIN_TOP_NORMAL_Z && other.normal.z > MIN_TOP_NORMAL_Z;
            let least_m = if are_tops { self.layer_m } else { self.tolerance_m };
            if other.corners.iter().any(|c| point.normal.dot(*c - point.position) > least_m) {
                return true;
            }
        }
        false
    }
}
