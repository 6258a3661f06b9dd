//! Directions of the views, and the projections along them, in whole numbers.
//!
//! Whole numbers make the CPU and every GPU project a vertex to the same place, to the last bit.

use glam::DVec3;
use std::f64::consts::PI;

/// Length of a unit vector's whole numbers.
pub(crate) const UNIT: f64 = 16_384.0;
/// Its binary logarithm.
pub(crate) const UNIT_SHIFT: u32 = 14;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ViewPair {
    /// Right, down and towards the viewer: nearly orthogonal vectors of length [`UNIT`].
    pub(crate) axes: [[i32; 3]; 3],
}

/// `count` pairs, spread evenly over the sphere: a spherical Fibonacci set on one half (Keinert et al. 2015, "Spherical
/// Fibonacci mapping"), and its opposites.
pub(crate) fn view_pairs(count: u32) -> Vec<ViewPair> {
    let golden_angle_rad = PI * (3.0 - 5f64.sqrt());
    let pair = |i: u32| {
        let z = 1.0 - (f64::from(i) + 0.5) / f64::from(count);
        let (sin, cos) = libm::sincos(f64::from(i) * golden_angle_rad);
        let r = (1.0 - z * z).sqrt();
        let whole = |v: DVec3| (v * UNIT).round().as_ivec3().to_array();
        let towards = whole(DVec3::new(r * cos, r * sin, z));
        // The other axes belong to the rounded direction.
        let axis = DVec3::from(towards.map(f64::from)).normalize_or(DVec3::Z);
        let (right, down) = axis.any_orthonormal_pair();
        ViewPair { axes: [whole(right), whole(down), towards] }
    };
    (0..count).map(pair).collect()
}

/// Scalar product with whole numbers, without rounding.
#[inline(always)]
pub(crate) fn dot(a: [i32; 3], b: [i32; 3]) -> i64 {
    i64::from(a[0]) * i64::from(b[0]) + i64::from(a[1]) * i64::from(b[1]) + i64::from(a[2]) * i64::from(b[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_distinct_even_and_nearly_orthogonal() {
        for count in [1, 2, 32, 128, 2048] {
            let pairs = view_pairs(count);
            for ViewPair { axes: [x, y, z] } in &pairs {
                for (a, b) in [(x, y), (y, z), (z, x)] {
                    assert!(dot(*a, *b).abs() < 3 * UNIT as i64, "{pairs:?}");
                }
                assert!((dot(*z, *z) as f64).sqrt() - UNIT < 1.0);
            }
            // The second moments of an even set of lines are those of the sphere.
            for k in 0..3 {
                let moment = pairs.iter().map(|p| (f64::from(p.axes[2][k]) / UNIT).powi(2)).sum::<f64>();
                assert!(count < 32 || (moment / f64::from(count) - 1.0 / 3.0).abs() < 0.02, "{count}: {moment}");
            }
        }
    }
}
