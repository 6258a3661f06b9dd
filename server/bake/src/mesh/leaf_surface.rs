//! A leaf's triangles on the grid of points that all leaves of a city share.
//!
//! The step of the grid is 1/4096 of a leaf's side. Points are counted from the leaf's corner and from the city's
//! height zero, so both neighbours of a border have the same points on it. Only a leaf that is more than sixteen times
//! as tall as wide gets a coarser step, because a coordinate has at most 16 bits.

use std::collections::HashMap;

use insula_protocol::{
    TileId,
    mesh::{AttributeKind, POSITION_BITS, PositionGrid as PointGrid},
};

use super::{
    materials::{base_colour, texture_of},
    square_clip::{PolygonVertex, clip_to_square},
};
use crate::{
    model::{CornerLayer, TriangleModel},
    scene::{Scene, grid::CityGrid},
};

/// Steps along a leaf's side.
pub(super) const STEPS: u32 = 4096;
/// How often the number of steps may be halved in tall leaves.
const MAX_HALVINGS: u32 = 12;

/// A leaf's triangles. Positions are whole steps from `points.min`.
#[derive(Debug, Clone)]
pub(super) struct LeafSurface {
    pub(super) points: PointGrid,
    /// Steps along the leaf's side: [`STEPS`] except in very tall leaves.
    pub(super) steps: u32,
    /// Has one layer: `Other` (u, v and material) if any material has a texture, else `Colour`. Two corners share a
    /// value only if they are at the same vertex.
    pub(super) model: TriangleModel,
    /// Number in the city of each triangle's object.
    pub(super) objects: Vec<u32>,
}

impl LeafSurface {
    /// Clips the scene's triangles to the leaf's square and rounds them to the grid. `None` if no triangle with any
    /// area is left, or if the leaf is too tall for any grid.
    pub(super) fn gather(scene: &Scene, grid: &CityGrid, id: TileId) -> Option<Self> {
        let polygons = clip_triangles(scene, grid, id);
        if polygons.is_empty() {
            return None;
        }
        let lattice = LeafLattice::around(&polygons, grid, id)?;
        let is_textured = polygons.iter().any(|polygon| texture_of(scene, polygon.material).is_some());
        let mut builder = SurfaceBuilder::default();
        for ClippedTriangle { vertices, material, object } in &polygons {
            let value = |uv: [f32; 2]| match (is_textured, texture_of(scene, *material).is_some()) {
                (true, true) => [uv[0], uv[1], *material as f32],
                (true, false) => [0.0, 0.0, *material as f32],
                (false, _) => base_colour(scene, *material).map(|v| f32::from(v) / 255.0),
            };
            let corners: Vec<SurfaceCorner> = vertices
                .iter()
                .map(|vertex| SurfaceCorner { point: lattice.round(vertex.p), value: value(vertex.uv) })
                .collect();
            for k in 1..corners.len() - 1 {
                builder.add([corners[0], corners[k], corners[k + 1]], *object);
            }
        }
        let (model, objects) = builder.finish(if is_textured { AttributeKind::Other } else { AttributeKind::Colour });
        let points = PointGrid {
            min: [0.0, 0.0, lattice.first[2] as f64 * lattice.step_m],
            step: lattice.step_m,
            bits: lattice.bits,
        };
        (!model.triangles.is_empty()).then_some(Self { points, steps: lattice.steps, model, objects })
    }

    /// Whether any of its materials has a texture.
    pub(super) fn is_textured(&self) -> bool {
        self.model.layers[0].kind == AttributeKind::Other
    }

    /// Whether a position, in steps, lies on the leaf's border.
    pub(super) fn is_on_border(&self, position: [f64; 3]) -> bool {
        let last = f64::from(self.steps);
        position[..2].iter().any(|v| *v <= 0.0 || *v >= last)
    }
}

/// The part of a source triangle in the leaf: a convex polygon.
struct ClippedTriangle {
    vertices: Vec<PolygonVertex>,
    material: u32,
    /// Number in the city.
    object: u32,
}

fn clip_triangles(scene: &Scene, grid: &CityGrid, id: TileId) -> Vec<ClippedTriangle> {
    let side_m = grid.node_side_m(id.level());
    let low = [id.x(), id.y()].map(|v| f64::from(v) * side_m);
    let high = [id.x() + 1, id.y() + 1].map(|v| f64::from(v) * side_m);
    let mut polygons = Vec::new();
    for (i, triangle) in (0..).zip(&scene.triangles) {
        let vertex = |k: usize| PolygonVertex {
            p: std::array::from_fn(|axis| f64::from(triangle.corners[k][axis]) - grid.corner[axis]),
            uv: triangle.uv[k],
        };
        let corners = [vertex(0), vertex(1), vertex(2)];
        let is_outside = |axis: usize| {
            corners.iter().all(|c| c.p[axis] < low[axis]) || corners.iter().all(|c| c.p[axis] > high[axis])
        };
        if is_outside(0) || is_outside(1) {
            continue;
        }
        let vertices = clip_to_square(corners, low, high);
        if vertices.len() >= 3 {
            let object = scene.object_number(i);
            polygons.push(ClippedTriangle { vertices, material: triangle.material, object });
        }
    }
    polygons
}

/// The part of the city's point grid that a leaf covers.
struct LeafLattice {
    step_m: f64,
    /// Steps along the leaf's side.
    steps: u32,
    /// The leaf's lowest point, in steps from the grid's corner and height zero.
    first: [i64; 3],
    /// Bits of a coordinate.
    bits: u8,
}

impl LeafLattice {
    /// With the finest step that leaves the polygons' heights within 16 bits.
    fn around(polygons: &[ClippedTriangle], grid: &CityGrid, id: TileId) -> Option<Self> {
        let side_m = grid.node_side_m(id.level());
        let (mut z_low, mut z_high) = (f64::INFINITY, f64::NEG_INFINITY);
        for vertex in polygons.iter().flat_map(|polygon| &polygon.vertices) {
            (z_low, z_high) = (z_low.min(vertex.p[2]), z_high.max(vertex.p[2]));
        }
        let max_height = f64::from((1u32 << POSITION_BITS.end()) - 2);
        let fits = |steps: &u32| (z_high - z_low) / (side_m / f64::from(*steps)) < max_height;
        let steps = (0..=MAX_HALVINGS).map(|halvings| STEPS >> halvings).find(fits)?;
        let step_m = side_m / f64::from(steps);
        let first =
            [i64::from(id.x()) * i64::from(steps), i64::from(id.y()) * i64::from(steps), count_steps(z_low, step_m)];
        let highest = (count_steps(z_high, step_m) - first[2]).max(i64::from(steps));
        let bits = POSITION_BITS.into_iter().find(|bits| highest < 1i64 << bits)?;
        Some(Self { step_m, steps, first, bits })
    }

    /// The nearest point, in steps from the leaf's lowest one.
    fn round(&self, p: [f64; 3]) -> [i64; 3] {
        let at: [i64; 3] = std::array::from_fn(|axis| count_steps(p[axis], self.step_m) - self.first[axis]);
        let steps = i64::from(self.steps);
        [at[0].clamp(0, steps), at[1].clamp(0, steps), at[2].max(0)]
    }
}

/// A length as the nearest whole number of steps.
fn count_steps(v: f64, step_m: f64) -> i64 {
    (v / step_m + 0.5).floor() as i64
}

/// A corner of a triangle on the grid.
#[derive(Debug, Clone, Copy)]
struct SurfaceCorner {
    point: [i64; 3],
    /// What the corner carries: colour, or texture coordinates and material.
    value: [f32; 3],
}

/// Joins vertices at one point, and equal values at one vertex.
#[derive(Default)]
struct SurfaceBuilder {
    model: TriangleModel,
    vertices: HashMap<[i64; 3], u32>,
    value_numbers: HashMap<(u32, [u32; 3]), u32>,
    values: Vec<[f32; 4]>,
    corners: Vec<u32>,
    objects: Vec<u32>,
}

impl SurfaceBuilder {
    /// Adds a triangle, unless two of its corners are at one point.
    fn add(&mut self, corners: [SurfaceCorner; 3], object: u32) {
        let [a, b, c] = corners.map(|corner| corner.point);
        if a == b || b == c || c == a {
            return;
        }
        let triangle = corners.map(|corner| {
            *self.vertices.entry(corner.point).or_insert_with(|| {
                self.model.positions.push(corner.point.map(|v| v as f64));
                self.model.positions.len() as u32 - 1
            })
        });
        self.model.triangles.push(triangle);
        self.objects.push(object);
        for (vertex, corner) in triangle.into_iter().zip(corners) {
            let value = corner.value;
            let number = *self.value_numbers.entry((vertex, value.map(f32::to_bits))).or_insert_with(|| {
                self.values.push([value[0], value[1], value[2], 0.0]);
                self.values.len() as u32 - 1
            });
            self.corners.push(number);
        }
    }

    fn finish(self, kind: AttributeKind) -> (TriangleModel, Vec<u32>) {
        let layer = CornerLayer { kind, width: 3, values: self.values, corners: self.corners };
        (TriangleModel { layers: vec![layer], ..self.model }, self.objects)
    }
}
