//! Values of all rays of a packet, and the arithmetic of [`fast_math`](crate::cpu::fast_math) on them.

use crate::cpu::fast_math::{fast_max, fast_min};
use crate::cpu::ray::MIN_DIRECTION;
use crate::layout::PAGE_WORDS;
use fearless_simd::prelude::*;
use glam::Vec3;

pub(super) type F<S> = <S as Simd>::f32s;
pub(super) type I<S> = <S as Simd>::i32s;
pub(super) type U<S> = <S as Simd>::u32s;
/// Two words of half of the rays.
type L<S> = <S as Simd>::u64s;
pub(super) type M<S> = <S as Simd>::mask32s;

/// Two numbers of each ray.
#[derive(Clone, Copy)]
pub(super) struct Vec2s<S: Simd> {
    pub(super) x: F<S>,
    pub(super) y: F<S>,
}

/// Three numbers of each ray.
#[derive(Clone, Copy)]
pub(super) struct Vec3s<S: Simd> {
    pub(super) x: F<S>,
    pub(super) y: F<S>,
    pub(super) z: F<S>,
}

/// Two whole numbers of each ray.
#[derive(Clone, Copy)]
pub(super) struct IVec2s<S: Simd> {
    pub(super) x: I<S>,
    pub(super) y: I<S>,
}

impl<S: Simd> Vec3s<S> {
    #[inline(always)]
    pub(super) fn splat(simd: S, v: Vec3) -> Self {
        Self { x: splat(simd, v.x), y: splat(simd, v.y), z: splat(simd, v.z) }
    }

    #[inline(always)]
    pub(super) fn map(self, f: impl Fn(F<S>) -> F<S>) -> Self {
        Self { x: f(self.x), y: f(self.y), z: f(self.z) }
    }

    #[inline(always)]
    pub(super) fn zip(self, other: Self, f: impl Fn(F<S>, F<S>) -> F<S>) -> Self {
        Self { x: f(self.x, other.x), y: f(self.y, other.y), z: f(self.z, other.z) }
    }

    #[inline(always)]
    pub(super) fn add(self, other: Self) -> Self {
        self.zip(
            other,
            #[inline(always)]
            |a, b| a + b,
        )
    }

    #[inline(always)]
    pub(super) fn sub(self, other: Self) -> Self {
        self.zip(
            other,
            #[inline(always)]
            |a, b| a - b,
        )
    }

    #[inline(always)]
    pub(super) fn mul(self, other: Self) -> Self {
        self.zip(
            other,
            #[inline(always)]
            |a, b| a * b,
        )
    }

    #[inline(always)]
    pub(super) fn scale(self, factor: F<S>) -> Self {
        self.map(
            #[inline(always)]
            |v| v * factor,
        )
    }

    #[inline(always)]
    pub(super) fn dot(self, other: Self) -> F<S> {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline(always)]
    pub(super) fn select(mask: M<S>, yes: Self, no: Self) -> Self {
        yes.zip(
            no,
            #[inline(always)]
            |yes, no| mask.select(yes, no),
        )
    }

    /// The vector of one ray.
    #[inline(always)]
    pub(super) fn lane(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x[lane], self.y[lane], self.z[lane])
    }

    #[inline(always)]
    pub(super) fn set_lane(&mut self, lane: usize, v: Vec3) {
        (self.x[lane], self.y[lane], self.z[lane]) = (v.x, v.y, v.z);
    }
}

/// A closure that is always inlined: code that is not compiled for the instruction set itself would call each instruction.
#[inline(always)]
pub(super) fn always<F>(closure: F) -> F {
    closure
}

#[inline(always)]
pub(super) fn splat<S: Simd>(simd: S, v: f32) -> F<S> {
    F::<S>::splat(simd, v)
}

#[inline(always)]
pub(super) fn splat_i<S: Simd>(simd: S, v: i32) -> I<S> {
    I::<S>::splat(simd, v)
}

#[inline(always)]
pub(super) fn splat_u<S: Simd>(simd: S, v: u32) -> U<S> {
    U::<S>::splat(simd, v)
}

#[inline(always)]
pub(super) fn to_u<S: Simd>(v: I<S>) -> U<S> {
    v.bitcast()
}

#[inline(always)]
pub(super) fn to_i<S: Simd>(v: U<S>) -> I<S> {
    v.bitcast()
}

#[inline(always)]
pub(super) fn float<S: Simd>(v: I<S>) -> F<S> {
    v.to_float()
}

/// Whole parts of values from 0 to 2^31, without that.
#[inline(always)]
pub(super) fn whole<S: Simd>(v: F<S>) -> U<S> {
    to_u::<S>(v.to_int())
}

/// Of values below 2^31.
#[inline(always)]
pub(super) fn float_u<S: Simd>(v: U<S>) -> F<S> {
    float::<S>(to_i::<S>(v))
}

/// The lesser and the greater of two numbers, as `fast_math` has them.
pub(super) trait FastExtremes<S: Simd>: SimdFloat<S, Element = f32> {
    #[inline(always)]
    fn fast_min(self, other: Self) -> Self {
        if !cfg!(target_arch = "wasm32") {
            return self.min(other);
        }
        // `f32x4.min` is seven instructions on x86-64, and `f32x4.pmin`, which LLVM makes of this loop, is one.
        let mut out = self;
        for lane in 0..Self::LEN {
            out[lane] = fast_min(self[lane], other[lane]);
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
            out[lane] = fast_max(self[lane], other[lane]);
        }
        out
    }
}

impl<S: Simd, V: SimdFloat<S, Element = f32>> FastExtremes<S> for V {}

/// The floor, clamped to whole numbers from `low` to `high`.
#[inline(always)]
pub(super) fn floor_of<S: Simd>(v: F<S>, low: F<S>, high: F<S>) -> F<S> {
    v.floor().fast_max(low).fast_min(high)
}

/// The same as an integer.
#[inline(always)]
pub(super) fn floor_clamped<S: Simd>(v: F<S>, low: F<S>, high: F<S>) -> I<S> {
    floor_of::<S>(v, low, high).to_int()
}

/// Whether any of the bits is set.
#[inline(always)]
pub(super) fn has<S: Simd>(simd: S, v: U<S>, bits: u32) -> M<S> {
    (v & bits).simd_ne(splat_u(simd, 0))
}

/// `v`, or the least value that is not zero.
#[inline(always)]
pub(super) fn nonzero<S: Simd>(simd: S, v: F<S>) -> F<S> {
    let least = splat(simd, MIN_DIRECTION);
    v.abs().simd_lt(least).select(least, v)
}

/// Most rays of a packet.
const MAX_LANES: usize = 16;

/// The words of the rays.
///
/// Like `from_fn` of vectors, in a loop: `from_fn` and `map` of arrays are compiled without the instruction set, and then call the
/// closure for each element, with all vectors in memory.
#[expect(clippy::needless_range_loop, reason = "iterators may be calls, too")]
#[inline(always)]
fn words_of<S: Simd>(simd: S, word: impl Fn(usize) -> u32) -> U<S> {
    let mut words = [0; MAX_LANES];
    for lane in 0..U::<S>::LEN {
        words[lane] = word(lane);
    }
    U::<S>::from_slice(simd, &words[..U::<S>::LEN])
}

/// Two words of half of the rays.
#[expect(clippy::needless_range_loop, reason = "iterators may be calls, too")]
#[inline(always)]
fn halves_of<S: Simd>(simd: S, two_words: impl Fn(usize) -> u64) -> U<S> {
    let mut all = [0; MAX_LANES / 2];
    for i in 0..L::<S>::LEN {
        all[i] = two_words(i);
    }
    L::<S>::from_slice(simd, &all[..L::<S>::LEN]).bitcast::<U<S>>()
}

/// `map` of four values, which is inlined.
#[inline(always)]
pub(super) fn map4<T, R>([a, b, c, d]: [T; 4], function: impl Fn(T) -> R) -> [R; 4] {
    [function(a), function(b), function(c), function(d)]
}

/// Words at some addresses; 0 outside of `words`.
#[inline(always)]
pub(super) fn gather<S: Simd>(simd: S, words: &[u32], at: U<S>) -> U<S> {
    let last = splat_u(simd, (words.len().min(1 << 31) as u32).saturating_sub(1));
    // Lanes outside read the last word: a branch that depends on the lane would often be predicted wrongly.
    let inside = at.min(last);
    let found = words_of(
        simd,
        #[inline(always)]
        |lane| words.get(inside[lane] as usize).copied().unwrap_or(0),
    );
    at.simd_le(last).select(found, splat_u(simd, 0))
}

/// The same for the lanes of `mask`; 0 in the others.
#[inline(always)]
pub(super) fn gather_where<S: Simd>(simd: S, words: &[u32], at: U<S>, mask: M<S>) -> U<S> {
    gather(simd, words, mask.select(at, splat_u(simd, u32::MAX)))
}

/// Words of a page at some places in it. Higher bits of `at` are ignored, so that no lane needs a test.
#[inline(always)]
pub(super) fn gather_page<S: Simd>(simd: S, page: &[u32; PAGE_WORDS], at: U<S>) -> U<S> {
    words_of(
        simd,
        #[inline(always)]
        |lane| page[at[lane] as usize % PAGE_WORDS],
    )
}

/// Two words of each ray, which are read at once.
#[inline(always)]
pub(super) fn pairs<S: Simd>(simd: S, pair: impl Fn(usize) -> [u32; 2]) -> [U<S>; 2] {
    let half = F::<S>::LEN / 2;
    let part = always(
        #[inline(always)]
        |first: usize| {
            halves_of(
                simd,
                #[inline(always)]
                |i| bytemuck::cast(pair(first + i)),
            )
        },
    );
    let (low, high) = part(0).deinterleave(part(half));
    [low, high]
}

/// Four words of each ray, which are read at once.
#[inline(always)]
pub(super) fn quadruples<S: Simd>(simd: S, quadruple: impl Fn(usize) -> [u32; 4]) -> [U<S>; 4] {
    let quarter = F::<S>::LEN / 4;
    let part = always(
        #[inline(always)]
        |first: usize| {
            halves_of(
                simd,
                #[inline(always)]
                |i| bytemuck::cast::<[u32; 4], [u64; 2]>(quadruple(first + i / 2))[i % 2],
            )
        },
    );
    let (a, b) = part(0).deinterleave(part(quarter));
    let (c, d) = part(2 * quarter).deinterleave(part(3 * quarter));
    let ((even, third), (odd, fourth)) = (a.deinterleave(c), b.deinterleave(d));
    [even, odd, third, fourth]
}

/// The numbers of the lanes.
#[inline(always)]
pub(super) fn lane_numbers<S: Simd>(simd: S) -> U<S> {
    words_of(
        simd,
        #[inline(always)]
        |lane| lane as u32,
    )
}

/// The first lane of a mask; the last lane of an empty one.
#[inline(always)]
pub(super) fn first_lane<S: Simd>(mask: M<S>) -> usize {
    (mask.to_bitmask().trailing_zeros() as usize).min(F::<S>::LEN - 1)
}

/// The lanes of a mask in ascending order.
#[inline(always)]
pub(super) fn lanes_of<S: Simd>(mask: M<S>) -> impl Iterator<Item = usize> {
    let mut bits = mask.to_bitmask();
    std::iter::from_fn(move || {
        let lane = bits.trailing_zeros() as usize;
        let is_some = bits != 0;
        bits &= bits.wrapping_sub(1);
        is_some.then_some(lane)
    })
}
