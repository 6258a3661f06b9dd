//! A leaf's triangles on the grid that all leaves of a city share.
//!
//! In: a block's scene, a leaf. Out: [`Surface`]. Next: `chain`.
//!
//! The grid's step is a 4,096th of a leaf's side; its points are counted from the leaf's corner and from the city's height
//! zero, so that both neighbours of a border have the same points there. Only a leaf that is more than sixteen times as high
//! as wide has a coarser one.

use std::collections::HashMap;

use insula_protocol::{
    TileId,
    mesh::{AttributeKind, POSITION_BITS, PositionGrid as Points},
};

use super::cut::{self, Corner};
use crate::{
    model::{CornerLayer, TriangleModel},
    scene::{Scene, grid::CityGrid},
};

/// Steps along a leaf's side.
pub(super) const STEPS: u32 = 4096;

/// A leaf's triangles; positions are counted in steps from `points.min`.
#[derive(Debug, Clone)]
pub(super) struct Surface {
    /// Where the steps lie.
    pub(super) points: Points,
    /// Steps along the leaf's side: [`STEPS`] but in very high leaves.
    pub(super) steps: u32,
    /// With one layer: `Other` (u, v and material) if any material has a picture, else `Colour`. Two corners have the same value
    /// only if they are at the same vertex.
    pub(super) model: TriangleModel,
}

impl Surface {
    /// Whether it wears pictures.
    pub(super) fn is_textured(&self) -> bool {
        self.model.layers[0].kind == AttributeKind::Other
    }

    /// Clips the scene's triangles to the leaf's square. `None` if nothing with any area is left.
    pub(super) fn gather(scene: &Scene, grid: &CityGrid, id: TileId) -> Option<Self> {
        let pieces = pieces(scene, grid, id);
        let textured = pieces.iter().any(|piece| picture_of(scene, piece.material));
        let side_m = grid.node_side_m(id.level());
        let (mut z_low, mut z_high) = (f64::INFINITY, f64::NEG_INFINITY);
        for corner in pieces.iter().flat_map(|piece| &piece.polygon) {
            (z_low, z_high) = (z_low.min(corner.p[2]), z_high.max(corner.p[2]));
        }
        let most = f64::from((1u32 << POSITION_BITS.end()) - 2);
        let fits = |steps: &u32| (z_high - z_low) / (side_m / f64::from(*steps)) < most;
        let steps = (0..=12).map(|halved| STEPS >> halved).find(fits)?;
        let step = side_m / f64::from(steps);
        let count = |v: f64| (v / step + 0.5).floor() as i64;
        let first = [i64::from(id.x()) * i64::from(steps), i64::from(id.y()) * i64::from(steps), count(z_low)];
        let highest = (count(z_high) - first[2]).max(i64::from(steps));
        let bits = POSITION_BITS.into_iter().find(|bits| highest < 1i64 << bits)?;
        let mut surface = Self {
            points: Points { min: [0.0, 0.0, first[2] as f64 * step], step, bits },
            steps,
            model: TriangleModel::default(),
        };
        let mut builder = Builder::default();
        for piece in &pieces {
            let places: Vec<[i64; 3]> = piece
                .polygon
                .iter()
                .map(|corner| {
                    let at: [i64; 3] = std::array::from_fn(|axis| count(corner.p[axis]) - first[axis]);
                    [at[0].clamp(0, steps.into()), at[1].clamp(0, steps.into()), at[2].max(0)]
                })
                .collect();
            let value = |corner: &Corner| match (textured, picture_of(scene, piece.material)) {
                (true, true) => [corner.uv[0], corner.uv[1], piece.material as f32],
                (true, false) => [0.0, 0.0, piece.material as f32],
                (false, _) => colour(scene, piece.material).map(|v| f32::from(v) / 255.0),
            };
            for k in 1..piece.polygon.len() - 1 {
                builder.add([0, k, k + 1].map(|i| (places[i], value(&piece.polygon[i]))));
            }
        }
        let kind = if textured { AttributeKind::Other } else { AttributeKind::Colour };
        surface.model = builder.finish(kind);
        (!surface.model.triangles.is_empty()).then_some(surface)
    }

    /// Whether a vertex of the surface, or of one with fewer triangles, lies on the leaf's border.
    pub(super) fn is_on_border(&self, position: [f64; 3]) -> bool {
        let last = f64::from(self.steps);
        position[..2].iter().any(|v| *v <= 0.0 || *v >= last)
    }
}

/// What of a source triangle lies in the leaf.
struct Piece {
    polygon: Vec<Corner>,
    material: u32,
}

fn pieces(scene: &Scene, grid: &CityGrid, id: TileId) -> Vec<Piece> {
    let side_m = grid.node_side_m(id.level());
    let low = [id.x(), id.y()].map(|v| f64::from(v) * side_m);
    let high = [id.x() + 1, id.y() + 1].map(|v| f64::from(v) * side_m);
    let mut pieces = Vec::new();
    for triangle in &scene.triangles {
        let corner = |k: usize| Corner {
            p: std::array::from_fn(|axis| f64::from(triangle.corners[k][axis]) - grid.corner[axis]),
            uv: triangle.uv[k],
        };
        let corners = [corner(0), corner(1), corner(2)];
        let outside = |axis: usize| {
            corners.iter().all(|c| c.p[axis] < low[axis]) || corners.iter().all(|c| c.p[axis] > high[axis])
        };
        if outside(0) || outside(1) {
            continue;
        }
        let polygon = cut::to_square(corners, low, high);
        if polygon.len() >= 3 {
            pieces.push(Piece { polygon, material: triangle.material });
        }
    }
    pieces
}

pub(super) fn picture_of(scene: &Scene, material: u32) -> bool {
    scene.materials.get(material as usize).is_some_and(|material| material.texture.is_some())
}

pub(super) fn colour(scene: &Scene, material: u32) -> [u8; 3] {
    scene.materials.get(material as usize).map_or([128; 3], |material| material.rgb)
}

/// Vertices at one point become one, triangles without area are left out.
#[derive(Default)]
struct Builder {
    model: TriangleModel,
    vertices: HashMap<[i64; 3], u32>,
    wedges: HashMap<(u32, [u32; 3]), u32>,
    values: Vec<[f32; 4]>,
    corners: Vec<u32>,
}

impl Builder {
    fn add(&mut self, corners: [([i64; 3], [f32; 3]); 3]) {
        let [a, b, c] = corners.map(|(place, _)| place);
        if a == b || b == c || c == a {
            return;
        }
        let triangle = corners.map(|(place, _)| {
            *self.vertices.entry(place).or_insert_with(|| {
                self.model.positions.push(place.map(|v| v as f64));
                self.model.positions.len() as u32 - 1
            })
        });
        self.model.triangles.push(triangle);
        for (vertex, (_, value)) in triangle.into_iter().zip(corners) {
            let number = *self.wedges.entry((vertex, value.map(f32::to_bits))).or_insert_with(|| {
                self.values.push([value[0], value[1], value[2], 0.0]);
                self.values.len() as u32 - 1
            });
            self.corners.push(number);
        }
    }

    fn finish(self, kind: AttributeKind) -> TriangleModel {
        let layer = CornerLayer { kind, width: 3, values: self.values, corners: self.corners };
        TriangleModel { layers: vec![layer], ..self.model }
    }
}
