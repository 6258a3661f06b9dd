//! A number that counts its own operations, so that an algorithm of a library can be stopped after a number of steps.
//!
//! Ear clipping takes quadratic or cubic time for hostile polygons, and its library has no limit. Its type of number is
//! a parameter, though. Every loop of it subtracts or compares, so the count bounds its time, independent of the machine.

use num_traits::{Float, Num, NumCast, One, ToPrimitive, Zero};
use std::cell::Cell;
use std::cmp::Ordering;
use std::num::FpCategory;
use std::ops::{Add, Div, Mul, Neg, Rem, Sub};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

thread_local! {
    static STEPS_LEFT: Cell<u64> = const { Cell::new(u64::MAX) };
}

/// Thrown when the steps are used up.
struct StepsUsedUp;

/// Runs `work`; `None` if its [`CountedFloat`]s need more than `steps` operations. Then `work`'s state is undefined but
/// safe to drop.
pub fn with_steps<R>(steps: u64, work: impl FnOnce() -> R) -> Option<R> {
    STEPS_LEFT.set(steps);
    let result = catch_unwind(AssertUnwindSafe(work));
    STEPS_LEFT.set(u64::MAX);
    match result {
        Ok(result) => Some(result),
        Err(panic) if panic.is::<StepsUsedUp>() => None,
        Err(panic) => resume_unwind(panic),
    }
}

#[inline]
fn step() {
    // One access: without optimisation across units, each is a call.
    STEPS_LEFT.with(|steps| match steps.get().checked_sub(1) {
        Some(left) => steps.set(left),
        // Not `panic!`, whose hook would print a message.
        None => resume_unwind(Box::new(StepsUsedUp)),
    });
}

/// An `f64` that counts subtractions and comparisons.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CountedFloat(pub(super) f64);

impl PartialOrd for CountedFloat {
    #[inline]
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        step();
        self.0.partial_cmp(&other.0)
    }
}

impl Sub for CountedFloat {
    type Output = Self;

    #[inline]
    fn sub(self, other: Self) -> Self {
        step();
        Self(self.0 - other.0)
    }
}

macro_rules! operators {
    ($($operator:ident $function:ident),*) => {$(
        impl $operator for CountedFloat {
            type Output = Self;

            #[inline]
            fn $function(self, other: Self) -> Self {
                Self(self.0.$function(other.0))
            }
        }
    )*};
}

operators!(Add add, Mul mul, Div div, Rem rem);

impl Neg for CountedFloat {
    type Output = Self;

    #[inline]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl Zero for CountedFloat {
    #[inline]
    fn zero() -> Self {
        Self(0.0)
    }

    #[inline]
    fn is_zero(&self) -> bool {
        self.0 == 0.0
    }
}

impl One for CountedFloat {
    fn one() -> Self {
        Self(1.0)
    }
}

impl Num for CountedFloat {
    type FromStrRadixErr = <f64 as Num>::FromStrRadixErr;

    fn from_str_radix(text: &str, radix: u32) -> Result<Self, Self::FromStrRadixErr> {
        f64::from_str_radix(text, radix).map(Self)
    }
}

impl ToPrimitive for CountedFloat {
    fn to_i64(&self) -> Option<i64> {
        self.0.to_i64()
    }

    fn to_u64(&self) -> Option<u64> {
        self.0.to_u64()
    }

    #[inline]
    fn to_f64(&self) -> Option<f64> {
        Some(self.0)
    }
}

impl NumCast for CountedFloat {
    fn from<T: ToPrimitive>(number: T) -> Option<Self> {
        number.to_f64().map(Self)
    }
}

macro_rules! constants {
    ($($function:ident),*) => {$(
        #[inline]
        fn $function() -> Self {
            Self(<f64 as Float>::$function())
        }
    )*};
}

macro_rules! unary {
    ($($function:ident),*) => {$(
        #[inline]
        fn $function(self) -> Self {
            Self(Float::$function(self.0))
        }
    )*};
}

macro_rules! binary {
    ($($function:ident),*) => {$(
        #[inline]
        fn $function(self, other: Self) -> Self {
            Self(Float::$function(self.0, other.0))
        }
    )*};
}

macro_rules! questions {
    ($($function:ident),*) => {$(
        fn $function(self) -> bool {
            Float::$function(self.0)
        }
    )*};
}

impl Float for CountedFloat {
    constants!(nan, infinity, neg_infinity, neg_zero, min_value, min_positive_value, epsilon, max_value);
    unary!(
        floor, ceil, round, trunc, fract, abs, signum, recip, sqrt, exp, exp2, ln, log2, log10, cbrt, sin, cos, tan,
        asin, acos, atan, exp_m1, ln_1p, sinh, cosh, tanh, asinh, acosh, atanh
    );
    binary!(powf, log, max, min, abs_sub, hypot, atan2);
    questions!(is_nan, is_infinite, is_finite, is_normal, is_sign_positive, is_sign_negative);

    fn classify(self) -> FpCategory {
        self.0.classify()
    }

    fn mul_add(self, a: Self, b: Self) -> Self {
        Self(self.0.mul_add(a.0, b.0))
    }

    fn powi(self, n: i32) -> Self {
        Self(self.0.powi(n))
    }

    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = Float::sin_cos(self.0);
        (Self(sin), Self(cos))
    }

    fn integer_decode(self) -> (u64, i16, i8) {
        Float::integer_decode(self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_ends_when_its_steps_are_used_up() {
        let subtract = |n: u32| (0..n).fold(CountedFloat(0.0), |sum, _| sum - CountedFloat(1.0)).0;
        assert_eq!(with_steps(100, || subtract(100)), Some(-100.0));
        assert_eq!(with_steps(100, || subtract(101)), None);
        assert_eq!(subtract(1000), -1000.0, "no limit afterwards");
    }
}
