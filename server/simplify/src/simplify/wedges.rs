//! Wedges: the corners of a vertex that carry the same attribute values (Hoppe 1998).
//!
//! Where two wedges of a vertex meet at an edge, the attributes have a seam.

use super::quadric::Quadric;
use super::texture_quadric::TextureQuadric;
use crate::model::TriangleModel;
use glam::DVec3;
use insula_protocol::mesh::AttributeKind;
use insula_protocol::mesh::half_edge::HalfEdgeMesh;
use std::collections::HashMap;

/// The attribute values of all wedges.
#[derive(Debug)]
pub(super) struct WedgeValues {
    /// For each wedge, one value per layer. Not a number where corners have none.
    values: Vec<[f32; 4]>,
    /// Number of layers of the model.
    pub(super) layers: usize,
    /// The layer whose first two components are texture coordinates.
    texture_layer: Option<usize>,
    /// For each wedge; empty without texture coordinates.
    quadrics: Vec<TextureQuadric>,
}

/// Weight of the texture's squared slide over the surface against the squared distance of the surface.
const TEXTURE_WEIGHT: f64 = 0.1;
/// The value of corners without one.
const NOTHING: [f32; 4] = [f32::NAN; 4];

impl WedgeValues {
    /// For each half-edge of the pieces, the wedge of the corner that it starts from, and the values of the wedges. No
    /// two vertices share a wedge. Both are empty if the model has no layers.
    pub(super) fn number(model: &TriangleModel, pieces: &HalfEdgeMesh) -> (Vec<u32>, Self) {
        let layers = model.layers.len();
        let mut values = Vec::new();
        // In leaves, layers of no other kind carry texture coordinates and a material.
        let is_texture = |kind| matches!(kind, AttributeKind::TexCoord | AttributeKind::Other);
        let texture_layer = model.layers.iter().position(|layer| is_texture(layer.kind) && layer.width >= 2);
        if layers == 0 {
            return (Vec::new(), Self { values, layers, texture_layer, quadrics: Vec::new() });
        }
        let mut numbers: HashMap<(u32, Vec<[u32; 4]>), u32> = HashMap::new();
        let mut wedges = Vec::with_capacity(pieces.origin.len());
        for (h, &vertex) in pieces.origin.iter().enumerate() {
            let corner = pieces.corner[h] as usize;
            let of_corner: Vec<[f32; 4]> =
                model.layers.iter().map(|layer| layer.value(corner).unwrap_or(NOTHING)).collect();
            let bits = of_corner.iter().map(|value| value.map(f32::to_bits)).collect();
            let next = numbers.len() as u32;
            wedges.push(*numbers.entry((vertex, bits)).or_insert_with(|| {
                values.extend(of_corner);
                next
            }));
        }
        (wedges, Self { values, layers, texture_layer, quadrics: Vec::new() })
    }

    /// Adds the texture coordinates of a triangle to its wedges.
    pub(super) fn add_triangle(&mut self, corners: [DVec3; 3], wedges: [usize; 3]) {
        let Some(layer) = self.texture_layer else { return };
        if self.quadrics.is_empty() {
            self.quadrics = vec![TextureQuadric::default(); self.len()];
        }
        let uv = wedges.map(|wedge| {
            let [u, v, ..] = self.value(wedge, layer);
            [f64::from(u), f64::from(v)]
        });
        let quadric = TextureQuadric::triangle(corners, uv);
        wedges.into_iter().for_each(|wedge| self.quadrics[wedge] += quadric);
    }

    /// What a place of the merged wedges `a` and `b` costs, besides the distance of the surface.
    pub(super) fn texture_cost(&self, a: usize, b: usize) -> Quadric {
        let [Some(a), Some(b)] = [a, b].map(|wedge| self.quadrics.get(wedge)) else { return Quadric::default() };
        let mut sum = *a;
        sum += *b;
        sum.of_position(TEXTURE_WEIGHT)
    }

    /// Merges wedge `b` into `a`, which moves to `to`. Its texture coordinates become the best ones there.
    pub(super) fn merge_texture(&mut self, a: usize, b: usize, to: Option<DVec3>) {
        let (Some(layer), Some(&other)) = (self.texture_layer, self.quadrics.get(b)) else { return };
        self.quadrics[a] += other;
        if let Some([u, v]) = to.and_then(|to| self.quadrics[a].best_value(to)) {
            let value = &mut self.values[a * self.layers + layer];
            (value[0], value[1]) = (u as f32, v as f32);
        }
    }

    pub(super) fn len(&self) -> usize {
        self.values.len() / self.layers.max(1)
    }

    pub(super) fn value(&self, wedge: usize, layer: usize) -> [f32; 4] {
        self.values[wedge * self.layers + layer]
    }

    /// Moves the values of wedge `a` towards those of `b` by a share from 0 to 1.
    pub(super) fn blend(&mut self, a: usize, b: usize, share: f32) {
        for layer in 0..self.layers {
            let other = self.value(b, layer);
            let value = &mut self.values[a * self.layers + layer];
            *value = std::array::from_fn(|k| value[k] + (other[k] - value[k]) * share);
        }
    }
}
