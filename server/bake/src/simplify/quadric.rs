//! Squared distances to planes, summed up (Garland and Heckbert 1997).
//!
//! In: triangles. Out: where a vertex is best, and what that costs. Next: `simplify`.

use glam::DVec3;
use std::ops::AddAssign;

/// A sum of weighted squared distances to planes, as a function of a point.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Quadric {
    // xx, yy, zz, xy, xz, yz of the matrix, then the vector, then the constant.
    a: [f64; 6],
    b: DVec3,
    c: f64,
    /// Sum of the weights of surfaces, without those that only hold borders and seams.
    pub(super) area: f64,
}

impl Quadric {
    /// Of a plane through `point`; `weight` is over the square of the length of `normal`.
    #[inline]
    fn plane(normal: DVec3, point: DVec3, weight: f64) -> Self {
        let d = -normal.dot(point);
        let (n, w) = (normal, normal * weight);
        Self {
            a: [n.x * w.x, n.y * w.y, n.z * w.z, n.x * w.y, n.x * w.z, n.y * w.z],
            b: w * d,
            c: d * d * weight,
            area: 0.0,
        }
    }

    /// Of a triangle, weighted by its area.
    #[inline]
    pub(super) fn triangle(p: [DVec3; 3]) -> Self {
        let cross = (p[1] - p[0]).cross(p[2] - p[0]);
        let length = cross.length();
        if length <= 0.0 {
            return Self::default();
        }
        Self { area: 0.5 * length, ..Self::plane(cross, p[0], 0.5 / length) }
    }

    /// Of a plane that stands upright on a triangle along its edge from `p[0]` to `p[1]`, weighted by the edge's length
    /// squared.
    pub(super) fn fence(p: [DVec3; 3], weight: f64) -> Self {
        let edge = p[1] - p[0];
        let outward = edge.cross((p[1] - p[0]).cross(p[2] - p[0]));
        let length = outward.length();
        if length <= 0.0 {
            return Self::default();
        }
        Self::plane(outward / length, p[0], weight * edge.length_squared())
    }

    /// What a point costs: area times squared distance.
    pub(super) fn cost(&self, p: DVec3) -> f64 {
        let [xx, yy, zz, xy, xz, yz] = self.a;
        let squares = xx * p.x * p.x + yy * p.y * p.y + zz * p.z * p.z;
        let mixed = xy * p.x * p.y + xz * p.x * p.z + yz * p.y * p.z;
        (squares + 2.0 * (mixed + self.b.dot(p)) + self.c).max(0.0)
    }

    /// The point that costs least; where planes leave it open, as near to `near` as they let it.
    pub(super) fn best(&self, near: DVec3) -> Option<DVec3> {
        let [xx, yy, zz, xy, xz, yz] = self.a;
        // Held a little to `near`: that is what makes it one point, and what keeps it from flying away.
        let hold = (xx + yy + zz) * 1e-4;
        let (xx, yy, zz) = (xx + hold, yy + hold, zz + hold);
        let b = near * hold - self.b;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_planes_meet_in_a_point() {
        let at = DVec3::new(3.0, -2.0, 7.0);
        let mut sum = Quadric::default();
        for normal in [DVec3::X, DVec3::Y, DVec3::new(0.6, 0.0, 0.8)] {
            sum += Quadric::plane(normal, at, 2.0);
        }
        let best = sum.best(DVec3::new(3.5, -2.0, 7.0)).unwrap();
        assert!((best - at).length() < 0.01, "{best}");
        assert!(sum.cost(at) < 1e-9 && (sum.cost(at + DVec3::Y) - 2.0).abs() < 1e-9);
    }

    #[test]
    fn on_one_plane_it_stays_near() {
        let sum = Quadric::triangle([DVec3::ZERO, DVec3::X, DVec3::Y]);
        let best = sum.best(DVec3::new(0.3, 0.4, 1.0)).unwrap();
        assert!((best - DVec3::new(0.3, 0.4, 0.0)).length() < 1e-3, "{best}");
        assert_eq!(sum.area, 0.5);
    }
}
