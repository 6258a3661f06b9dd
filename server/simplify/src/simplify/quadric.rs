//! Quadrics: sums of squared distances to planes (Garland and Heckbert 1997, 4).

use glam::DVec3;
use std::ops::{AddAssign, Mul};

/// Weight of the term that pulls the best point towards the middle of its edge, as a share of the matrix's trace.
const REGULARISATION: f64 = 1e-4;

/// A sum of weighted squared distances to planes, as a function `p.Ap + 2b.p + c` of a point.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Quadric {
    /// xx, yy, zz, xy, xz, yz of the symmetric matrix.
    a: [f64; 6],
    b: DVec3,
    c: f64,
    /// Sum of the weights of triangles, without those of border and seam planes.
    pub(super) area: f64,
}

impl Quadric {
    /// Of the plane through `point`. `weight` is divided by the squared length of `normal`.
    #[inline]
    fn plane(normal: DVec3, point: DVec3, weight: f64) -> Self {
        Self::linear(normal, -normal.dot(point), weight)
    }

    /// The sum of the weighted square of a linear function `slope.p + offset`.
    pub(super) fn linear(slope: DVec3, offset: f64, weight: f64) -> Self {
        let (n, w) = (slope, slope * weight);
        Self {
            a: [n.x * w.x, n.y * w.y, n.z * w.z, n.x * w.y, n.x * w.z, n.y * w.z],
            b: w * offset,
            c: offset * offset * weight,
            area: 0.0,
        }
    }

    /// Of the plane of a triangle, weighted by its area.
    #[inline]
    pub(super) fn triangle(p: [DVec3; 3]) -> Self {
        let cross = (p[1] - p[0]).cross(p[2] - p[0]);
        let length = cross.length();
        if length <= 0.0 {
            return Self::default();
        }
        Self { area: 0.5 * length, ..Self::plane(cross, p[0], 0.5 / length) }
    }

    /// Of the plane perpendicular to a triangle along its edge from `p[0]` to `p[1]`. Its weight is `weight` times the
    /// squared length of the edge.
    pub(super) fn perpendicular(p: [DVec3; 3], weight: f64) -> Self {
        let edge = p[1] - p[0];
        let outward = edge.cross((p[1] - p[0]).cross(p[2] - p[0]));
        let length = outward.length();
        if length <= 0.0 {
            return Self::default();
        }
        Self::plane(outward / length, p[0], weight * edge.length_squared())
    }

    /// The value at a point: area times squared distance.
    pub(super) fn cost(&self, p: DVec3) -> f64 {
        let [xx, yy, zz, xy, xz, yz] = self.a;
        let squares = xx * p.x * p.x + yy * p.y * p.y + zz * p.z * p.z;
        let mixed = xy * p.x * p.y + xz * p.x * p.z + yz * p.y * p.z;
        (squares + 2.0 * (mixed + self.b.dot(p)) + self.c).max(0.0)
    }

    /// The point with the least cost; among points of equal cost, the one nearest to `near`. `None` if there is no such
    /// point or it is not finite.
    pub(super) fn best_point(&self, near: DVec3) -> Option<DVec3> {
        let [xx, yy, zz, xy, xz, yz] = self.a;
        // The term that pulls towards `near` makes the matrix invertible.
        let pull = (xx + yy + zz) * REGULARISATION;
        let (xx, yy, zz) = (xx + pull, yy + pull, zz + pull);
        let b = near * pull - self.b;
        let (i, j, k) = (yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy);
        let determinant = xx * i + xy * j + xz * k;
        if determinant <= 0.0 || !determinant.is_finite() {
            return None;
        }
        let x = b.x * i + b.y * j + b.z * k;
        let y = b.x * j + b.y * (xx * zz - xz * xz) + b.z * (xz * xy - xx * yz);
        let z = b.x * k + b.y * (xy * xz - xx * yz) + b.z * (xx * yy - xy * xy);
        Some(DVec3::new(x, y, z) / determinant)
    }
}

impl AddAssign for Quadric {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        for k in 0..self.a.len() {
            self.a[k] += other.a[k];
        }
        self.b += other.b;
        self.c += other.c;
        self.area += other.area;
    }
}

impl Mul<f64> for Quadric {
    type Output = Self;

    /// The area is not scaled.
    fn mul(self, share: f64) -> Self {
        Self { a: self.a.map(|v| v * share), b: self.b * share, c: self.c * share, area: self.area }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn best_point_of_three_planes_is_their_intersection() {
        let at = DVec3::new(3.0, -2.0, 7.0);
        let mut sum = Quadric::default();
        for normal in [DVec3::X, DVec3::Y, DVec3::new(0.6, 0.0, 0.8)] {
            sum += Quadric::plane(normal, at, 2.0);
        }
        let best = sum.best_point(DVec3::new(3.5, -2.0, 7.0)).unwrap();
        assert!((best - at).length() < 0.01, "{best}");
        assert!(sum.cost(at) < 1e-9 && (sum.cost(at + DVec3::Y) - 2.0).abs() < 1e-9);
    }

    #[test]
    fn best_point_of_one_plane_is_the_projection() {
        let sum = Quadric::triangle([DVec3::ZERO, DVec3::X, DVec3::Y]);
        let best = sum.best_point(DVec3::new(0.3, 0.4, 1.0)).unwrap();
        assert!((best - DVec3::new(0.3, 0.4, 0.0)).length() < 1e-3, "{best}");
        assert_eq!(sum.area, 0.5);
    }
}
