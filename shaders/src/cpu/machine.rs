//! Least, most and floor as a processor has them: an instruction or two each.
//!
//! In: numbers. Out: numbers. Next: the walks, which do little else.
//!
//! The standard library's also say what becomes of what is no number, and ask the system's library for a floor. Here, what is no
//! number gives the second argument, as on most graphics devices.

use glam::{IVec2, Vec2};

/// The smaller of two.
pub(super) fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The larger of two.
pub(super) fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The largest whole number that is not larger; within the range of an `i32`.
pub(super) fn floor(v: f32) -> i32 {
    let towards_zero = v as i32;
    towards_zero.saturating_sub(i32::from(v < towards_zero as f32))
}

/// The same of both.
pub(super) fn floor2(v: Vec2) -> IVec2 {
    IVec2::new(floor(v.x), floor(v.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_the_standard_library_has_them() {
        let numbers =
            [0.0, -0.0, 0.25, -0.25, 1.0, -1.0, 2.75, -2.75, 8_388_607.5, -8_388_607.5, 3e9, -3e9, 1e-30, -1e-30];
        for a in numbers.into_iter().chain([f32::INFINITY, f32::NEG_INFINITY]) {
            assert_eq!(floor(a), a.floor() as i32, "{a}");
            for b in numbers {
                assert_eq!((least(a, b), most(a, b)), (a.min(b), a.max(b)), "{a} {b}");
            }
        }
        assert_eq!((least(f32::NAN, 1.0), most(f32::NAN, 1.0), floor(f32::NAN)), (1.0, 1.0, 0));
    }
}
