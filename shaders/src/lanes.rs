//! Numbers of one ray, or of all rays of a packet: for both, the functions of the CPU's pictures have one text.
//!
//! A function of [`Lanes`] is scalar code with [`OneLane`], and code for packets with an instruction set of `fearless_simd`. Each lane
//! computes the same in the same order, so that the results are the same to the last bit.
//!
//! Such a function is inlined always, and so are its closures: code between a function that is compiled for an instruction set
//! and the instruction would otherwise call each instruction. Nor does it map arrays by closures, which LLVM does not inline.

use fearless_simd::prelude::*;
use glam::{Mat3, Vec3};
use std::ops::{Add, AddAssign, BitAnd, BitOr, BitXor, Div, Mul, MulAssign, Neg, Not, Shl, Shr, Sub};

/// A closure that is always inlined.
macro_rules! always {
    ($($closure:tt)*) => { $crate::lanes::closure(#[inline(always)] $($closure)*) };
}

/// The same of a closure that is called once, as one that may be called again is not: by a function in between, which is not inlined.
macro_rules! once {
    ($($closure:tt)*) => { $crate::lanes::closure_of_one_call(#[inline(always)] $($closure)*) };
}

pub(crate) use {always, once};

#[inline(always)]
pub(crate) fn closure<F>(closure: F) -> F {
    closure
}

#[inline(always)]
pub(crate) fn closure_of_one_call<R, F: FnOnce() -> R>(closure: F) -> F {
    closure
}

/// Functions that are always inlined.
macro_rules! inlined {
    ($($function:item)*) => { $(#[inline(always)] $function)* };
}

/// One ray.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OneLane;

/// One ray, or those of a packet: the types of their numbers, and how these are made.
pub(crate) trait Lanes: Copy {
    type F: LaneFloats<Self>;
    type I: LaneInts<Self>;
    type U: LaneWords<Self>;
    type M: LaneMask<Self>;

    fn splat(self, v: f32) -> Self::F;
    fn splat_i(self, v: i32) -> Self::I;
    fn splat_u(self, v: u32) -> Self::U;
    fn splat_m(self, v: bool) -> Self::M;
    /// Two words of each ray, which are read at once.
    fn pairs(self, pair: impl Fn(usize) -> [u32; 2]) -> [Self::U; 2];
    /// Four words of each ray, which are read at once.
    fn quadruples(self, quadruple: impl Fn(usize) -> [u32; 4]) -> [Self::U; 4];
    /// What the scalar code computes for each of some rays; 0 for the others.
    fn each(self, lanes: Self::M, value: impl Fn(usize) -> f32) -> Self::F;
    /// Calls a closure as a function, which all share that call it.
    fn call<R>(self, function: impl FnOnce() -> R) -> R;
}

pub(crate) type F<S> = <S as Lanes>::F;
pub(crate) type I<S> = <S as Lanes>::I;
pub(crate) type U<S> = <S as Lanes>::U;
pub(crate) type M<S> = <S as Lanes>::M;

/// Floating-point numbers. What is compared with NaN gives the other number, or is false.
#[rustfmt::skip]
pub(crate) trait LaneFloats<S: Lanes>:
    Copy + Neg<Output = Self> + AddAssign + MulAssign<f32>
    + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
    + Add<f32, Output = Self> + Sub<f32, Output = Self> + Mul<f32, Output = Self> + Div<f32, Output = Self>
{
    fn abs(self) -> Self;
    fn sqrt(self) -> Self;
    fn floor(self) -> Self;
    fn at_least(self, low: f32) -> Self;
    fn at_most(self, high: f32) -> Self;
    fn min_of(self, other: Self) -> Self;
    fn max_of(self, other: Self) -> Self;
    fn above(self, v: f32) -> S::M;
    fn below(self, v: f32) -> S::M;
    fn at_or_above(self, v: f32) -> S::M;
    fn at_or_below(self, v: f32) -> S::M;
    fn is_less(self, other: Self) -> S::M;
    /// Towards zero, of values in the range of `i32`.
    fn to_ints(self) -> S::I;
    fn to_bits(self) -> S::U;
    fn lane(&self, lane: usize) -> f32;
    fn set_lane(&mut self, lane: usize, v: f32);

    inlined! {
        fn clamped(self, low: f32, high: f32) -> Self { self.at_least(low).at_most(high) }

        /// 1 less the numbers.
        fn rest(self) -> Self { -self + 1.0 }

        /// These where `share` is 0, `other` where it is 1, with the operations of glam.
        fn lerp(self, other: Self, share: Self) -> Self { self * share.rest() + other * share }

        /// Whole parts of values from 0 to 2^31, without that; words of two's complement of others.
        fn whole(self) -> S::U { self.to_ints().to_words() }
    }
}

/// Whole numbers.
#[rustfmt::skip]
pub(crate) trait LaneInts<S: Lanes>:
    Copy + Neg<Output = Self> + Add<Output = Self>
    + Add<i32, Output = Self> + Sub<i32, Output = Self> + Mul<i32, Output = Self>
{
    fn at_least(self, low: i32) -> Self;
    fn at_most(self, high: i32) -> Self;
    fn to_floats(self) -> S::F;
    fn to_words(self) -> S::U;
}

/// Words of 32 bits.
#[rustfmt::skip]
pub(crate) trait LaneWords<S: Lanes>:
    Copy + Add<Output = Self> + BitOr<Output = Self> + BitXor<Output = Self>
    + Add<u32, Output = Self> + Sub<u32, Output = Self> + Mul<u32, Output = Self>
    + Shl<u32, Output = Self> + Shr<u32, Output = Self>
    + BitAnd<u32, Output = Self> + BitOr<u32, Output = Self> + BitXor<u32, Output = Self>
{
    fn wrapping_add(self, other: Self) -> Self;
    fn wrapping_mul(self, factor: u32) -> Self;
    fn at_most(self, high: u32) -> Self;
    fn to_ints(self) -> S::I;
    fn bits_to_floats(self) -> S::F;
    fn lane(&self, lane: usize) -> u32;
    fn all_are(self, v: u32) -> bool;

    inlined! {
        /// Of words below 2^31.
        fn to_floats(self) -> S::F { self.to_ints().to_floats() }
    }
}

/// Some of the rays.
pub(crate) trait LaneMask<S: Lanes>:
    Copy + BitAnd<Output = Self> + BitOr<Output = Self> + BitXor<Output = Self> + Not<Output = Self>
{
    fn select(self, yes: S::F, no: S::F) -> S::F;
    fn select_i(self, yes: S::I, no: S::I) -> S::I;
    fn any(self) -> bool;
}

impl Lanes for OneLane {
    type F = f32;
    type I = i32;
    type U = u32;
    type M = bool;

    inlined! {
        fn splat(self, v: f32) -> f32 { v }
        fn splat_i(self, v: i32) -> i32 { v }
        fn splat_u(self, v: u32) -> u32 { v }
        fn splat_m(self, v: bool) -> bool { v }
        fn pairs(self, pair: impl Fn(usize) -> [u32; 2]) -> [u32; 2] { pair(0) }
        fn quadruples(self, quadruple: impl Fn(usize) -> [u32; 4]) -> [u32; 4] { quadruple(0) }
        fn each(self, lanes: bool, value: impl Fn(usize) -> f32) -> f32 { if lanes { value(0) } else { 0.0 } }
    }

    #[inline(never)]
    fn call<R>(self, function: impl FnOnce() -> R) -> R {
        function()
    }
}

impl LaneFloats<OneLane> for f32 {
    inlined! {
        fn abs(self) -> f32 { f32::abs(self) }
        fn sqrt(self) -> f32 { f32::sqrt(self) }
        fn at_least(self, low: f32) -> f32 { if self > low { self } else { low } }
        fn at_most(self, high: f32) -> f32 { if self < high { self } else { high } }
        fn min_of(self, other: f32) -> f32 { if self < other { self } else { other } }
        fn max_of(self, other: f32) -> f32 { if self > other { self } else { other } }
        fn above(self, v: f32) -> bool { self > v }
        fn below(self, v: f32) -> bool { self < v }
        fn at_or_above(self, v: f32) -> bool { self >= v }
        fn at_or_below(self, v: f32) -> bool { self <= v }
        fn is_less(self, other: f32) -> bool { self < other }
        fn to_ints(self) -> i32 { self as i32 }
        fn to_bits(self) -> u32 { f32::to_bits(self) }
        fn lane(&self, _: usize) -> f32 { *self }
        fn set_lane(&mut self, _: usize, v: f32) { *self = v; }
    }

    /// Without the call of a library that the standard library's needs where processors have no instruction.
    #[inline(always)]
    fn floor(self) -> f32 {
        const ALL_WHOLE: f32 = 8_388_608.0;
        let towards_zero = self as i32 as f32;
        let below = if self < towards_zero { towards_zero - 1.0 } else { towards_zero };
        if f32::abs(self) < ALL_WHOLE { below } else { self }
    }
}

impl LaneInts<OneLane> for i32 {
    inlined! {
        fn at_least(self, low: i32) -> i32 { self.max(low) }
        fn at_most(self, high: i32) -> i32 { self.min(high) }
        fn to_floats(self) -> f32 { self as f32 }
        fn to_words(self) -> u32 { self as u32 }
    }
}

impl LaneWords<OneLane> for u32 {
    inlined! {
        fn wrapping_add(self, other: u32) -> u32 { u32::wrapping_add(self, other) }
        fn wrapping_mul(self, factor: u32) -> u32 { u32::wrapping_mul(self, factor) }
        fn at_most(self, high: u32) -> u32 { self.min(high) }
        fn to_ints(self) -> i32 { self as i32 }
        fn bits_to_floats(self) -> f32 { f32::from_bits(self) }
        fn lane(&self, _: usize) -> u32 { *self }
        fn all_are(self, v: u32) -> bool { self == v }
    }
}

impl LaneMask<OneLane> for bool {
    inlined! {
        fn select(self, yes: f32, no: f32) -> f32 { if self { yes } else { no } }
        fn select_i(self, yes: i32, no: i32) -> i32 { if self { yes } else { no } }
        fn any(self) -> bool { self }
    }
}

/// Two words of half of the rays.
type L<S> = <S as Simd>::u64s;

/// Most rays of a packet.
pub(crate) const MAX_LANES: usize = 16;

/// Two words of half of the rays.
///
/// A loop, because `from_fn` and `map` of arrays are compiled without the instruction set, and then call the closure for each element, with
/// all vectors in memory.
#[expect(clippy::needless_range_loop, reason = "iterators may be calls, too")]
#[inline(always)]
fn halves_of<S: Simd>(simd: S, two_words: impl Fn(usize) -> u64) -> S::u32s {
    let mut all = [0; MAX_LANES / 2];
    for i in 0..L::<S>::LEN {
        all[i] = two_words(i);
    }
    L::<S>::from_slice(simd, &all[..L::<S>::LEN]).bitcast::<S::u32s>()
}

impl<S: Simd> Lanes for S {
    type F = S::f32s;
    type I = S::i32s;
    type U = S::u32s;
    type M = S::mask32s;

    inlined! {
        fn splat(self, v: f32) -> S::f32s { S::f32s::splat(self, v) }
        fn splat_i(self, v: i32) -> S::i32s { S::i32s::splat(self, v) }
        fn splat_u(self, v: u32) -> S::u32s { S::u32s::splat(self, v) }
        fn splat_m(self, v: bool) -> S::mask32s { S::mask32s::splat(self, v) }
        fn call<R>(self, function: impl FnOnce() -> R) -> R { self.vectorize(function) }
    }

    #[inline(always)]
    fn pairs(self, pair: impl Fn(usize) -> [u32; 2]) -> [S::u32s; 2] {
        let half = S::f32s::LEN / 2;
        let part = always!(|first: usize| halves_of(self, always!(|i: usize| bytemuck::cast(pair(first + i)))));
        let (low, high) = part(0).deinterleave(part(half));
        [low, high]
    }

    #[inline(always)]
    fn quadruples(self, quadruple: impl Fn(usize) -> [u32; 4]) -> [S::u32s; 4] {
        let quarter = S::f32s::LEN / 4;
        let part = always!(|first: usize| {
            halves_of(self, always!(|i: usize| bytemuck::cast::<[u32; 4], [u64; 2]>(quadruple(first + i / 2))[i % 2]))
        });
        let (a, b) = part(0).deinterleave(part(quarter));
        let (c, d) = part(2 * quarter).deinterleave(part(3 * quarter));
        let ((even, third), (odd, fourth)) = (a.deinterleave(c), b.deinterleave(d));
        [even, odd, third, fourth]
    }

    #[inline(always)]
    fn each(self, lanes: S::mask32s, value: impl Fn(usize) -> f32) -> S::f32s {
        let mut values = S::f32s::splat(self, 0.0);
        let mut bits = lanes.to_bitmask();
        while bits != 0 {
            let lane = bits.trailing_zeros() as usize;
            values[lane] = value(lane);
            bits &= bits - 1;
        }
        values
    }
}

impl<S, V> LaneFloats<S> for V
where
    S: Simd<f32s = V>,
    V: SimdFloat<S, Element = f32, Mask = S::mask32s, ByteVector = S::u8s>,
{
    inlined! {
        fn abs(self) -> Self { SimdBase::abs(self) }
        fn sqrt(self) -> Self { SimdFloat::sqrt(self) }
        fn floor(self) -> Self { SimdFloat::floor(self) }
        fn at_least(self, low: f32) -> Self { self.fast_max(Self::splat(self.token(), low)) }
        fn at_most(self, high: f32) -> Self { self.fast_min(Self::splat(self.token(), high)) }
        fn min_of(self, other: Self) -> Self { self.fast_min(other) }
        fn max_of(self, other: Self) -> Self { self.fast_max(other) }
        fn above(self, v: f32) -> S::mask32s { self.simd_gt(Self::splat(self.token(), v)) }
        fn below(self, v: f32) -> S::mask32s { self.simd_lt(Self::splat(self.token(), v)) }
        fn at_or_above(self, v: f32) -> S::mask32s { self.simd_ge(Self::splat(self.token(), v)) }
        fn at_or_below(self, v: f32) -> S::mask32s { self.simd_le(Self::splat(self.token(), v)) }
        fn is_less(self, other: Self) -> S::mask32s { self.simd_lt(other) }
        fn to_ints(self) -> S::i32s { self.to_int() }
        fn to_bits(self) -> S::u32s { self.bitcast() }
        fn lane(&self, lane: usize) -> f32 { self[lane] }
        fn set_lane(&mut self, lane: usize, v: f32) { self[lane] = v; }
    }
}

impl<S, V> LaneInts<S> for V
where
    S: Simd<i32s = V>,
    V: SimdInt<S, Element = i32, ByteVector = S::u8s> + Neg<Output = V>,
{
    inlined! {
        fn at_least(self, low: i32) -> Self { self.max(Self::splat(self.token(), low)) }
        fn at_most(self, high: i32) -> Self { self.min(Self::splat(self.token(), high)) }
        fn to_floats(self) -> S::f32s { self.to_float() }
        fn to_words(self) -> S::u32s { self.bitcast() }
    }
}

impl<S, V> LaneWords<S> for V
where
    S: Simd<u32s = V>,
    V: SimdInt<S, Element = u32, ByteVector = S::u8s>,
{
    inlined! {
        fn wrapping_add(self, other: Self) -> Self { self + other }
        fn wrapping_mul(self, factor: u32) -> Self { self * factor }
        fn at_most(self, high: u32) -> Self { self.min(Self::splat(self.token(), high)) }
        fn to_ints(self) -> S::i32s { self.bitcast() }
        fn bits_to_floats(self) -> S::f32s { self.bitcast() }
        fn lane(&self, lane: usize) -> u32 { self[lane] }
        fn all_are(self, v: u32) -> bool { self.simd_eq(Self::splat(self.token(), v)).all_true() }
    }
}

impl<S, V> LaneMask<S> for V
where
    S: Simd<mask32s = V>,
    V: SimdMask<S> + Select<S::f32s> + Select<S::i32s>,
{
    inlined! {
        fn select(self, yes: S::f32s, no: S::f32s) -> S::f32s { Select::select(self, yes, no) }
        fn select_i(self, yes: S::i32s, no: S::i32s) -> S::i32s { Select::select(self, yes, no) }
        fn any(self) -> bool { self.any_true() }
    }
}

/// The lesser and the greater of two numbers, as `fast_math` has them.
pub(crate) trait FastExtremes<S: Simd>: SimdFloat<S, Element = f32> {
    #[inline(always)]
    fn fast_min(self, other: Self) -> Self {
        if !cfg!(target_arch = "wasm32") {
            return self.min(other);
        }
        // `f32x4.min` is seven instructions on x86-64, and `f32x4.pmin`, which LLVM makes of this loop, is one.
        let mut out = self;
        for lane in 0..Self::LEN {
            out[lane] = if self[lane] < other[lane] { self[lane] } else { other[lane] };
        }
        out
    }

    #[inline(always)]
    fn fast_max(self, other: Self) -> Self {
        if !cfg!(target_arch = "wasm32") {
            return self.max(other);
        }
        let mut out = self;
        for lane in 0..Self::LEN {
            out[lane] = if self[lane] > other[lane] { self[lane] } else { other[lane] };
        }
        out
    }
}

impl<S: Simd, V: SimdFloat<S, Element = f32>> FastExtremes<S> for V {}

/// Two numbers of each ray.
#[derive(Clone, Copy)]
pub(crate) struct Vec2s<S: Lanes> {
    pub(crate) x: F<S>,
    pub(crate) y: F<S>,
}

/// Three numbers of each ray.
#[derive(Clone, Copy)]
pub(crate) struct Vec3s<S: Lanes> {
    pub(crate) x: F<S>,
    pub(crate) y: F<S>,
    pub(crate) z: F<S>,
}

/// Operators of vectors with vectors and with constants.
macro_rules! vec3s_operators {
    ($($operator:ident $function:ident)*) => { $(
        impl<S: Lanes> $operator for Vec3s<S> {
            type Output = Self;

            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                let function = <F<S> as $operator>::$function;
                Self { x: function(self.x, other.x), y: function(self.y, other.y), z: function(self.z, other.z) }
            }
        }

        impl<S: Lanes> $operator<f32> for Vec3s<S> {
            type Output = Self;

            #[inline(always)]
            fn $function(self, v: f32) -> Self {
                let function = <F<S> as $operator<f32>>::$function;
                Self { x: function(self.x, v), y: function(self.y, v), z: function(self.z, v) }
            }
        }
    )* };
}

vec3s_operators! { Add add Sub sub Mul mul Div div }

impl<S: Lanes> Neg for Vec3s<S> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self { x: -self.x, y: -self.y, z: -self.z }
    }
}

impl<S: Lanes> Vec3s<S> {
    inlined! {
        pub(crate) fn new(x: F<S>, y: F<S>, z: F<S>) -> Self { Self { x, y, z } }
        pub(crate) fn splat(simd: S, v: Vec3) -> Self { Self::new(simd.splat(v.x), simd.splat(v.y), simd.splat(v.z)) }
        pub(crate) fn map(self, f: impl Fn(F<S>) -> F<S>) -> Self { Self::new(f(self.x), f(self.y), f(self.z)) }
        pub(crate) fn floor(self) -> Self { Self::new(self.x.floor(), self.y.floor(), self.z.floor()) }
        pub(crate) fn scale(self, v: F<S>) -> Self { Self::new(self.x * v, self.y * v, self.z * v) }
        pub(crate) fn dot(self, other: Self) -> F<S> { self.x * other.x + self.y * other.y + self.z * other.z }
        pub(crate) fn max_element(self) -> F<S> { self.x.max_of(self.y).max_of(self.z) }
        /// The vector of one ray.
        pub(crate) fn lane(&self, lane: usize) -> Vec3 {
            Vec3::new(self.x.lane(lane), self.y.lane(lane), self.z.lane(lane))
        }
    }

    /// The product with a matrix, as of glam.
    #[inline(always)]
    pub(crate) fn transformed(self, matrix: &Mat3) -> Self {
        let Mat3 { x_axis: x, y_axis: y, z_axis: z } = *matrix;
        Self {
            x: self.x * x.x + self.y * y.x + self.z * z.x,
            y: self.x * x.y + self.y * y.y + self.z * z.y,
            z: self.x * x.z + self.y * y.z + self.z * z.z,
        }
    }

    #[inline(always)]
    pub(crate) fn clamped(self, low: f32, high: f32) -> Self {
        Self::new(self.x.clamped(low, high), self.y.clamped(low, high), self.z.clamped(low, high))
    }

    #[inline(always)]
    pub(crate) fn lerp(self, other: Self, share: F<S>) -> Self {
        Self::new(self.x.lerp(other.x, share), self.y.lerp(other.y, share), self.z.lerp(other.z, share))
    }

    #[inline(always)]
    pub(crate) fn select(mask: M<S>, yes: Self, no: Self) -> Self {
        Self::new(mask.select(yes.x, no.x), mask.select(yes.y, no.y), mask.select(yes.z, no.z))
    }

    /// Of length 1, or the `fallback`.
    #[inline(always)]
    pub(crate) fn normalize_or(self, simd: S, fallback: Self) -> Self {
        let recip = simd.splat(1.0) / self.dot(self).sqrt();
        Self::select(recip.below(f32::INFINITY) & recip.above(0.0), self.scale(recip), fallback)
    }

    #[inline(always)]
    pub(crate) fn set_lane(&mut self, lane: usize, v: Vec3) {
        self.x.set_lane(lane, v.x);
        self.y.set_lane(lane, v.y);
        self.z.set_lane(lane, v.z);
    }
}

impl From<Vec3> for Vec3s<OneLane> {
    #[inline(always)]
    fn from(v: Vec3) -> Self {
        Self { x: v.x, y: v.y, z: v.z }
    }
}

impl From<Vec3s<OneLane>> for Vec3 {
    #[inline(always)]
    fn from(v: Vec3s<OneLane>) -> Self {
        Self::new(v.x, v.y, v.z)
    }
}

/// A polynomial, its highest power first.
#[inline(always)]
pub(crate) fn horner<S: Lanes, const N: usize>(simd: S, x: F<S>, factors: [f32; N]) -> F<S> {
    let mut sum = simd.splat(factors[0]);
    for factor in &factors[1..] {
        sum = sum * x + *factor;
    }
    sum
}
