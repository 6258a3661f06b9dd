//! Quadrics of texture coordinates (Hoppe 1999, "New quadric metric for simplifying meshes with appearance attributes").
//!
//! On a triangle, each texture coordinate is a linear function of the position. A wedge sums up the squared differences of its
//! coordinates from those of all triangles that were merged into it. The best coordinates for a position have a closed form, so
//! what remains is a quadric of the position alone.

use super::quadric::Quadric;
use glam::DVec3;
use std::ops::AddAssign;

/// Texture coordinates per corner.
const SIZE: usize = 2;

/// The sum of squared differences of texture coordinates, in squared lengths that the texture slides over the surface.
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
