//! Words of the rays of a packet, and the arithmetic of their walk. More is in [`lanes`](crate::lanes).

use crate::cpu::ray::MIN_DIRECTION;
use crate::lanes::MAX_LANES;
pub(super) use crate::lanes::{F, FastExtremes, I, Lanes, M, U, Vec2s, Vec3s, always, once};
use crate::layout::PAGE_WORDS;
use fearless_simd::prelude::*;

/// Two whole numbers of each ray.
#[derive(Clone, Copy)]
pub(super) struct IVec2s<S: Simd> {
    pub(super) x: I<S>,
    pub(super) y: I<S>,
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

/// The words of the rays. Like `from_fn` of vectors, but in a loop.
#[expect(clippy::needless_range_loop, reason = "iterators may be calls, too")]
#[inline(always)]
fn words_of<S: Simd>(simd: S, word: impl Fn(usize) -> u32) -> U<S> {
    let mut words = [0; MAX_LANES];
    for lane in 0..U::<S>::LEN {
        words[lane] = word(lane);
    }
    U::<S>::from_slice(simd, &words[..U::<S>::LEN])
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
    let found = words_of(simd, always!(|lane: usize| words.get(inside[lane] as usize).copied().unwrap_or(0)));
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
    words_of(simd, always!(|lane: usize| page[at[lane] as usize % PAGE_WORDS]))
}

/// The numbers of the lanes.
#[inline(always)]
pub(super) fn lane_numbers<S: Simd>(simd: S) -> U<S> {
    words_of(simd, always!(|lane: usize| lane as u32))
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
