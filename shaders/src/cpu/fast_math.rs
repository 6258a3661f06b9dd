//! Arithmetic of the walk in one or two processor instructions. GPU twin: `shared/math.wgsl`.
//!
//! The standard library's `min` and `max` also define the result for a NaN, and its `floor` calls the system's library.
//! Here a NaN gives the second argument, as on most graphics devices.

use super::ray::MIN_DIRECTION;
use glam::{IVec2, Vec2};

#[inline]
pub(super) fn fast_min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline]
pub(super) fn fast_max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The floor of a value in the range of `i32`.
#[inline]
pub(super) fn floor(v: f32) -> i32 {
    let towards_zero = v as i32;
    towards_zero.saturating_sub(i32::from(v < towards_zero as f32))
}

#[inline]
pub(super) fn floor2(v: Vec2) -> IVec2 {
    IVec2::new(floor(v.x), floor(v.y))
}

/// `v`, or the least value that is not zero.
#[inline]
pub(super) fn nonzero(v: f32) -> f32 {
    if v.abs() < MIN_DIRECTION { MIN_DIRECTION } else { v }
}

/// The same for each component.
#[inline]
pub(super) fn nonzero2(v: Vec2) -> Vec2 {
    Vec2::new(nonzero(v.x), nonzero(v.y))
}

/// 1 along the axes on which the ray's coordinate grows, else 0.
#[inline]
pub(super) fn ahead_of(d: Vec2) -> Vec2 {
    Vec2::new(f32::from(d.x > 0.0), f32::from(d.y > 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_give_what_the_standard_library_gives_and_nan_the_second_argument() {
        let numbers =
            [0.0, -0.0, 0.25, -0.25, 1.0, -1.0, 2.75, -2.75, 8_388_607.5, -8_388_607.5, 3e9, -3e9, 1e-30, -1e-30];
        for a in numbers.into_iter().chain([f32::INFINITY, f32::NEG_INFINITY]) {
            assert_eq!(floor(a), a.floor() as i32, "{a}");
            for b in numbers {
                assert_eq!((fast_min(a, b), fast_max(a, b)), (a.min(b), a.max(b)), "{a} {b}");
            }
        }
        assert_eq!((fast_min(f32::NAN, 1.0), fast_max(f32::NAN, 1.0), floor(f32::NAN)), (1.0, 1.0, 0));
    }
}
