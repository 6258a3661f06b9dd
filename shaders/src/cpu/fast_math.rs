//! Arithmetic of the walk in one or two processor instructions. GPU twin: `shared/math.wgsl`.
//!
//! The standard library's `min` and `max` also define the result for a NaN, and its `floor` calls the system's library.
//! Here a NaN gives the second argument, as on most graphics devices.

use super::ray::MIN_DIRECTION;
use crate::lanes::{F, LaneFloats, LaneWords, Lanes, horner};
use glam::{IVec2, Vec2, Vec3};

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

/// The power of two of a number from 0 to 1 as a polynomial: coefficients of x^0 to x^2, and of x^3 to x^5. Relative error 1e-7.
pub(super) const EXP_LOW: Vec3 = Vec3::new(1.0, 0.693_151_7, 0.240_159_27);
pub(super) const EXP_HIGH: Vec3 = Vec3::new(0.055_818_675, 0.008_990_996_5, 0.001_879_318);
/// Least power of two that [`exp`] returns.
pub(super) const EXP_MIN: f32 = -126.0;

/// The exponential function, with a relative error of 4e-7 near 0.
#[inline(always)]
pub(super) fn exp<S: Lanes>(simd: S, v: F<S>) -> F<S> {
    let y = (v * std::f32::consts::LOG2_E).clamped(EXP_MIN, -EXP_MIN);
    let whole = y.floor();
    let (low, high) = (EXP_LOW, EXP_HIGH);
    let power = horner(simd, y - whole, [high.z, high.y, high.x, low.z, low.y, low.x]);
    power * ((whole + 127.0).whole() << 23).bits_to_floats()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::OneLane;

    #[test]
    fn the_exponential_function_agrees_with_the_standard_library() {
        for i in -8000..100 {
            let v = i as f32 / 100.0;
            let (found, expected) = (exp(OneLane, v), v.exp());
            assert!((found / expected - 1.0).abs() < 4e-7 * (1.0 + v.abs()), "{v}: {found}, not {expected}");
        }
        assert_eq!(exp(OneLane, 0.0), 1.0);
        assert!(exp(OneLane, f32::NEG_INFINITY) < 1e-37 && exp(OneLane, -1e9) < 1e-37);
    }

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
