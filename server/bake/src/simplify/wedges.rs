//! Wedges: the corners of a vertex that carry the same attribute values (Hoppe 1998).
//!
//! Where two wedges of a vertex meet at an edge, the attributes have a seam.

use crate::model::TriangleModel;
use insula_protocol::mesh::half_edge::HalfEdgeMesh;
use std::collections::HashMap;

/// The attribute values of all wedges.
#[derive(Debug)]
pub(super) struct WedgeValues {
    /// For each wedge, one value per layer.
    values: Vec<[f32; 4]>,
    /// Number of layers of the model.
    pub(super) layers: usize,
}

impl WedgeValues {
    /// For each half-edge of the pieces, the wedge of the corner that it starts from, and the values of the wedges. No
    /// two vertices share a wedge. Both are empty if the model has no layers.
    pub(super) fn number(model: &TriangleModel, pieces: &HalfEdgeMesh) -> (Vec<u32>, Self) {
        let layers = model.layers.len();
        let mut values = Vec::new();
        if layers == 0 {
            return (Vec::new(), Self { values, layers });
        }
        let mut numbers: HashMap<(u32, Vec<[u32; 4]>), u32> = HashMap::new();
        let mut wedges = Vec::with_capacity(pieces.origin.len());
        for (h, &vertex) in pieces.origin.iter().enumerate() {
            let corner = pieces.corner[h] as usize;
            let of_corner: Vec<[f32; 4]> =
                model.layers.iter().map(|layer| layer.values[layer.corners[corner] as usize]).collect();
            let bits = of_corner.iter().map(|value| value.map(f32::to_bits)).collect();
            let next = numbers.len() as u32;
            wedges.push(*numbers.entry((vertex, bits)).or_insert_with(|| {
                values.extend(of_corner);
                next
            }));
        }
        (wedges, Self { values, layers })
    }

    /// Number of wedges.
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
