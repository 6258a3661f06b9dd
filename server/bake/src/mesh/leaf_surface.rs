//! A leaf's triangles on the grid of points that all leaves of a city share.
//!
//! The step of the grid is 1/4096 of a leaf's side. Points are counted from the leaf's corner and from the city's
//! height zero, so both neighbours of a border have the same points on it. Only a leaf that is more than sixteen times
//! as tall as wide gets a coarser step, because a coordinate has at most 16 bits.
//!
//! The triangles of landmarks are small, so leaves with one get a step of 1/32768. On borders that no landmark crosses their
//! points are those of the coarser grid, which the neighbours have.

use super::square_clip::{PolygonVertex, clip_to_square};
use super::{base_colour, texture_of};
use crate::scene::grid::CityGrid;
use crate::scene::{Landmark, Scene};
use insula_protocol::TileId;
use insula_protocol::mesh::{AttributeKind, POSITION_BITS, PositionGrid as PointGrid};
use insula_protocol::mesh_tile::{LandmarkObject, MAX_ANCHOR_M, MAX_LANDMARKS};
use insula_simplify::model::{CornerLayer, TriangleModel};
use std::collections::HashMap;

/// Steps along a leaf's side.
pub(super) const STEPS: u32 = 4096;
/// Steps of a leaf with a landmark for each step of another one.
const FINE_STEPS: u32 = 8;
/// How often the number of steps may be halved in tall leaves.
const MAX_HALVINGS: u32 = 12;

/// A leaf's triangles. Positions are whole steps from `points.min`.
#[derive(Debug, Clone)]
pub(super) struct LeafSurface {
    pub(super) points: PointGrid,
    /// Steps along the leaf's side: [`STEPS`], more with a landmark, fewer in very tall leaves.
    pub(super) steps: u32,
    /// Has one layer: `Other` (u, v and material) if any material has a texture, else `Colour`. Two corners share a
    /// value only if they are at the same vertex.
    pub(super) model: TriangleModel,
    /// Number in the city of each triangle's object.
    pub(super) objects: Vec<u32>,
    /// The landmarks in the leaf, ascending by number.
    pub(super) landmarks: Vec<LandmarkObject>,
}

impl LeafSurface {
    /// Clips the scene's triangles to the leaf's square and rounds them to the grid. `None` if no triangle with any
    /// area is left, or if the leaf is too tall for any grid.
    pub(super) fn gather(scene: &Scene, grid: &CityGrid, id: TileId) -> Option<Self> {
        let polygons = clip_triangles(scene, grid, id);
        if polygons.is_empty() {
            return None;
        }
        let lattice = LeafLattice::around(&polygons, grid, id, borders_of_landmarks(scene, grid, id))?;
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
        let landmarks = landmarks_in(scene, grid, id, &objects);
        (!model.triangles.is_empty()).then_some(Self { points, steps: lattice.steps, model, objects, landmarks })
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

/// The landmarks among `objects`, with anchors in the coordinates of the leaf's mesh.
fn landmarks_in(scene: &Scene, grid: &CityGrid, id: TileId, objects: &[u32]) -> Vec<LandmarkObject> {
    let side_m = grid.node_side_m(id.level());
    let low = [f64::from(id.x()) * side_m, f64::from(id.y()) * side_m, 0.0];
    let found = |landmark: &Landmark| {
        let object = scene.numbers.get(landmark.object as usize).copied().filter(|object| objects.contains(object))?;
        let anchor_m = std::array::from_fn(|k| (f64::from(landmark.anchor_m[k]) - grid.corner[k] - low[k]) as f32);
        let is_near = anchor_m.iter().all(|v: &f32| v.abs() <= MAX_ANCHOR_M);
        Some(LandmarkObject { object, stone: landmark.stone, anchor_m }).filter(|_| is_near)
    };
    let mut landmarks: Vec<LandmarkObject> = scene.landmarks.iter().filter_map(found).collect();
    landmarks.sort_by_key(|landmark| landmark.object);
    landmarks.truncate(MAX_LANDMARKS);
    landmarks
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

/// Which borders of a leaf a landmark crosses: west, south, east, north; `None` if no landmark is in the leaf. The leaf on the other
/// side gets the same, because it has the same triangles there.
fn borders_of_landmarks(scene: &Scene, grid: &CityGrid, id: TileId) -> Option<[bool; 4]> {
    if scene.landmarks.is_empty() {
        return None;
    }
    let side_m = grid.node_side_m(id.level());
    let low = [f64::from(id.x()) * side_m, f64::from(id.y()) * side_m];
    let mut is_any = false;
    let mut crosses = [false; 4];
    for triangle in scene.triangles.iter().filter(|triangle| scene.landmark(triangle.object).is_some()) {
        let range = |axis: usize| {
            let values = triangle.corners.map(|corner| f64::from(corner[axis]) - grid.corner[axis] - low[axis]);
            [values.into_iter().fold(f64::MAX, f64::min), values.into_iter().fold(f64::MIN, f64::max)]
        };
        let ranges = [range(0), range(1)];
        let meets = |axis: usize| ranges[axis][0] <= side_m && ranges[axis][1] >= 0.0;
        if !(meets(0) && meets(1)) {
            continue;
        }
        is_any = true;
        for (border, at) in [(0, 0.0), (1, 0.0), (2, side_m), (3, side_m)] {
            crosses[border] |= ranges[border % 2][0] <= at && ranges[border % 2][1] >= at;
        }
    }
    is_any.then_some(crosses)
}

/// The part of the city's point grid that a leaf covers.
struct LeafLattice {
    step_m: f64,
    /// Steps of the grid on the western, southern, eastern and northern border.
    border_steps: [i64; 4],
    /// Steps along the leaf's side.
    steps: u32,
    /// The leaf's lowest point, in steps from the grid's corner and height zero.
    first: [i64; 3],
    /// Bits of a coordinate.
    bits: u8,
}

impl LeafLattice {
    /// With the finest step that leaves the polygons' heights within 16 bits. `landmarks` as [`borders_of_landmarks`] says.
    fn around(polygons: &[ClippedTriangle], grid: &CityGrid, id: TileId, landmarks: Option<[bool; 4]>) -> Option<Self> {
        let side_m = grid.node_side_m(id.level());
        let (mut z_low, mut z_high) = (f64::INFINITY, f64::NEG_INFINITY);
        for vertex in polygons.iter().flat_map(|polygon| &polygon.vertices) {
            (z_low, z_high) = (z_low.min(vertex.p[2]), z_high.max(vertex.p[2]));
        }
        let max_height = f64::from((1u32 << POSITION_BITS.end()) - 2);
        let fits = |steps: &u32| (z_high - z_low) / (side_m / f64::from(*steps)) < max_height;
        let finest = if landmarks.is_some() { FINE_STEPS * STEPS } else { STEPS };
        let steps = (0..=MAX_HALVINGS).map(|halvings| finest >> halvings).find(fits)?;
        let coarse = i64::from(steps / STEPS).max(1);
        let border_steps = landmarks.unwrap_or_default().map(|is_fine| if is_fine { 1 } else { coarse });
        let step_m = side_m / f64::from(steps);
        let first =
            [i64::from(id.x()) * i64::from(steps), i64::from(id.y()) * i64::from(steps), count_steps(z_low, step_m)];
        let highest = (count_steps(z_high, step_m) - first[2]).max(i64::from(steps));
        let bits = POSITION_BITS.into_iter().find(|bits| highest < 1i64 << bits)?;
        Some(Self { step_m, border_steps, steps, first, bits })
    }

    /// The nearest point, in steps from the leaf's lowest one.
    fn round(&self, p: [f64; 3]) -> [i64; 3] {
        let steps = i64::from(self.steps);
        let at = |unit: i64| -> [i64; 3] {
            let counted = |axis: usize| unit * count_steps(p[axis], unit as f64 * self.step_m) - self.first[axis];
            [counted(0).clamp(0, steps), counted(1).clamp(0, steps), counted(2).max(0)]
        };
        let point = at(1);
        let is_on = [point[0] == 0, point[1] == 0, point[0] == steps, point[1] == steps];
        let unit = (0..4).filter(|border| is_on[*border]).map(|border| self.border_steps[border]).max();
        match unit {
            Some(unit) if unit > 1 => at(unit),
            _ => point,
        }
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
