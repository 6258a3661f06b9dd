//! The street grid. Distances of streets vary a little.

use crate::rng::Rng;

/// Mean distance of streets along x and y.
pub const PITCH_M: [f64; 2] = [88.0, 72.0];
/// Largest displacement of a street.
pub const JITTER_M: f64 = 7.0;
/// Half the width of a street, and of every fifth one.
const HALF_STREET_M: [f64; 2] = [4.5, 10.0];

/// Centre line of a street. `axis` 0: northbound streets, at x; 1: eastbound streets, at y.
pub fn street(axis: usize, i: i32) -> f64 {
    f64::from(i) * PITCH_M[axis] + Rng::new(key(i, 7 + axis as i32)).range(-JITTER_M, JITTER_M)
}

pub fn half_street(i: i32) -> f64 {
    HALF_STREET_M[usize::from(i.rem_euclid(5) == 0)]
}

/// A seed made of two numbers.
pub fn key(a: i32, b: i32) -> u64 {
    u64::from(a as u32) << 32 | u64::from(b as u32)
}
