//! Wedges: the corners of a vertex that carry the same attribute values (Hoppe 1998).
//!
//! Where two wedges of a vertex meet at an edge, the attributes have a seam.

use super::quadric::Quadric;
use crate::model::TriangleModel;
use glam::DVec3;
use insula_protocol::mesh::AttributeKind;
use insula_protocol::mesh::half_edge::HalfEdgeMesh;
use std::collections::HashMap;
use std::ops::AddAssign;

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

/// Texture coordinates per corner.
const SIZE: usize = 2;

/// The sum of squared differences of texture coordinates, in squared lengths that the texture slides over the surface (Hoppe 1999, "New
/// quadric metric for simplifying meshes with appearance attributes").
///
/// On a triangle, each texture coordinate is a linear function of the position. A wedge sums up the squared differences of its
/// coordinates from those of all triangles that were merged into it. The best coordinates for a position have a closed form, so
/// what remains is a quadric of the position alone.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TextureQuadric {
    /// Of the squared functions.
    squares: Quadric,
    /// Weighted sums of the functions' slopes and offsets.
    slopes: [DVec3; SIZE],
    offsets: [f64; SIZE],
    weight: f64,
}

impl TextureQuadric {
    /// Of a triangle with the texture coordinates of its corners, weighted by its area. Empty if the triangle is degenerate or its
    /// texture coordinates are all equal or not finite.
    pub(super) fn triangle(p: [DVec3; 3], uv: [[f64; SIZE]; 3]) -> Self {
        let (e, f) = (p[1] - p[0], p[2] - p[0]);
        let [ee, ef, ff] = [e.dot(e), e.dot(f), f.dot(f)];
        let determinant = ee * ff - ef * ef;
        if determinant <= 0.0 {
            return Self::default();
        }
        // The slope lies in the plane, and its products with both edges are the differences of the values.
        let slopes: [DVec3; SIZE] = std::array::from_fn(|k| {
            let (along_e, along_f) = (uv[1][k] - uv[0][k], uv[2][k] - uv[0][k]);
            (e * (along_e * ff - along_f * ef) + f * (along_f * ee - along_e * ef)) / determinant
        });
        let offsets: [f64; SIZE] = std::array::from_fn(|k| uv[0][k] - slopes[k].dot(p[0]));
        // Turns differences of texture coordinates into lengths on the surface.
        let steepness = slopes.iter().map(|slope| slope.length_squared()).sum::<f64>() / SIZE as f64;
        let weight = 0.5 * determinant.sqrt() / steepness;
        if !(weight.is_finite() && offsets.iter().all(|offset| offset.is_finite())) {
            return Self::default();
        }
        let mut squares = Quadric::default();
        (0..SIZE).for_each(|k| squares += Quadric::linear(slopes[k], offsets[k], weight));
        Self { squares, slopes: slopes.map(|slope| slope * weight), offsets: offsets.map(|v| v * weight), weight }
    }

    /// The value for the best texture coordinates, as a function of the position, times `share`.
    pub(super) fn of_position(&self, share: f64) -> Quadric {
        let mut out = Quadric::default();
        if self.weight > 0.0 {
            out += self.squares * share;
            for (slope, offset) in self.slopes.iter().zip(self.offsets) {
                out += Quadric::linear(*slope, offset, -share / self.weight);
            }
        }
        out
    }

    /// The best texture coordinates at a position; `None` if the quadric is empty.
    pub(super) fn best_value(&self, p: DVec3) -> Option<[f64; SIZE]> {
        let value = |k: usize| (self.slopes[k].dot(p) + self.offsets[k]) / self.weight;
        (self.weight > 0.0).then(|| [value(0), value(1)])
    }
}

impl AddAssign for TextureQuadric {
    fn add_assign(&mut self, other: Self) {
        self.squares += other.squares;
        for k in 0..SIZE {
            self.slopes[k] += other.slopes[k];
            self.offsets[k] += other.offsets[k];
        }
        self.weight += other.weight;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_texture_costs_nothing_anywhere() {
        let uv = |p: DVec3| [0.3 * p.x - 0.1 * p.y + 5.0, 0.2 * p.y];
        let corners = [DVec3::ZERO, DVec3::X * 4.0, DVec3::new(1.0, 3.0, 0.0), DVec3::new(-2.0, 1.0, 0.0)];
        let triangle = |a: usize, b: usize, c: usize| {
            let p = [a, b, c].map(|k| corners[k]);
            TextureQuadric::triangle(p, p.map(uv))
        };
        let mut sum = triangle(0, 1, 2);
        sum += triangle(0, 2, 3);
        let at = DVec3::new(0.7, 1.1, 0.0);
        let [u, v] = sum.best_value(at).unwrap();
        assert!((u - uv(at)[0]).abs() < 1e-12 && (v - uv(at)[1]).abs() < 1e-12);
        assert!(sum.of_position(1.0).cost(at) < 1e-9);
        assert!(
            TextureQuadric::triangle([DVec3::ZERO, DVec3::X, DVec3::X * 2.0], [[0.0; 2]; 3]).best_value(at).is_none()
        );
        assert!(TextureQuadric::triangle([DVec3::ZERO, DVec3::X, DVec3::Y], [[0.5; 2]; 3]).best_value(at).is_none());
    }

    #[test]
    fn a_bent_texture_costs_its_slide_over_the_surface() {
        // Left of x = 0 the texture moves half as fast as on the right. Beyond it, both continuations differ by x / 2.
        let uv = |p: DVec3| [if p.x > 0.0 { p.x } else { 0.5 * p.x }, p.y];
        let p = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        let (left, right) = ([p(0.0, 0.0), p(0.0, 2.0), p(-2.0, 0.0)], [p(0.0, 0.0), p(2.0, 0.0), p(0.0, 2.0)]);
        let mut sum = TextureQuadric::triangle(left, left.map(uv));
        sum += TextureQuadric::triangle(right, right.map(uv));
        let cost = |x: f64| sum.of_position(1.0).cost(p(x, 0.0));
        assert!(cost(0.0) < 1e-12 && cost(1.0) > 0.1, "{} {}", cost(0.0), cost(1.0));
        assert!((cost(2.0) / cost(1.0) - 4.0).abs() < 1e-9);
    }
}
