//! Gradient noise at the points of a packet. The scalar code is [`noise`](crate::cpu::noise).

use super::lanes::{F, I, M, U, Vec3s, always, float_u, splat, splat_u, to_u};
use crate::cpu::noise::{MIN_FOOTPRINT, NOISE_ABS, NOISE_ABS_VARIANCE, NOISE_SCALE, NOISE_VARIANCE, OCTAVE_TURN};
use fearless_simd::prelude::*;
use glam::Vec3;

/// Slope and value of noise.
#[derive(Clone, Copy)]
pub(super) struct Noises<S: Simd> {
    pub(super) slope: Vec3s<S>,
    pub(super) value: F<S>,
}

/// [`NoiseSum`](crate::cpu::noise::NoiseSum) of each ray.
#[derive(Clone, Copy)]
pub(super) struct NoiseSums<S: Simd> {
    pub(super) value: F<S>,
    pub(super) hidden: F<S>,
}

/// A sum of octaves: how many, their persistence, and whether of absolute values.
#[derive(Clone, Copy)]
pub(super) struct Octaves {
    pub(super) count: u32,
    pub(super) persistence: f32,
    pub(super) is_folded: bool,
}

/// [`scramble`](crate::cpu::night::scramble).
#[inline(always)]
pub(super) fn scramble<S: Simd>(word: U<S>) -> U<S> {
    let h = (word ^ 61) ^ (word >> 16);
    let h = h * 9;
    let h = h ^ (h >> 4);
    let h = h * 0x27d4_eb2d;
    h ^ (h >> 15)
}

/// `a` where `s` is 0, `b` where it is 1, with the operations of glam.
#[inline(always)]
pub(super) fn lerp<S: Simd>(simd: S, a: F<S>, b: F<S>, s: F<S>) -> F<S> {
    a * (splat(simd, 1.0) - s) + b * s
}

/// The same of vectors.
#[inline(always)]
pub(super) fn lerp3<S: Simd>(simd: S, a: Vec3s<S>, b: Vec3s<S>, s: F<S>) -> Vec3s<S> {
    a.zip(
        b,
        #[inline(always)]
        |a, b| lerp(simd, a, b, s),
    )
}

#[inline(always)]
fn lerp_noise<S: Simd>(simd: S, a: &Noises<S>, b: &Noises<S>, s: F<S>) -> Noises<S> {
    Noises { slope: lerp3(simd, a.slope, b.slope, s), value: lerp(simd, a.value, b.value, s) }
}

/// The three numbers of ten bits in a hash.
#[inline(always)]
pub(super) fn parts_of<S: Simd>(hash: U<S>) -> Vec3s<S> {
    let part = always(
        #[inline(always)]
        |shift: u32| float_u::<S>((hash >> shift) & 1023),
    );
    Vec3s::<S> { x: part(0), y: part(10), z: part(20) }
}

/// [`perlin`](crate::cpu::noise::perlin).
#[inline(always)]
fn perlin<S: Simd>(simd: S, p: Vec3s<S>) -> Noises<S> {
    // One function for all that call it.
    simd.vectorize(
        #[inline(always)]
        || perlin_here(simd, p),
    )
}

#[inline(always)]
fn perlin_here<S: Simd>(simd: S, p: Vec3s<S>) -> Noises<S> {
    let cell = p.map(
        #[inline(always)]
        |v| v.floor(),
    );
    let whole = always(
        #[inline(always)]
        |v: F<S>| to_u::<S>(v.to_int::<I<S>>()),
    );
    let (x, y, z) = (whole(cell.x), whole(cell.y), whole(cell.z));
    let f = p.sub(cell);
    let west = [scramble::<S>(x), scramble::<S>(x + 1)];
    let column = always(
        #[inline(always)]
        |i: usize, j: u32| scramble::<S>(west[i] + (y + j)),
    );
    let columns = [column(0, 0), column(1, 0), column(0, 1), column(1, 1)];
    let corner = always(
        #[inline(always)]
        |i: usize, k: u32| {
            let slope = parts_of::<S>(scramble::<S>(columns[i] + (z + k))).map(
                #[inline(always)]
                |v| v / 511.5 - 1.0,
            );
            let place = Vec3::new((i & 1) as f32, (i >> 1) as f32, k as f32);
            let value = slope.dot(f.sub(Vec3s::splat(simd, place)));
            Noises::<S> { slope, value }
        },
    );
    let u = f.map(
        #[inline(always)]
        |f| f * f * f * (f * (f * 6.0 - 15.0) + 10.0),
    );
    let slope = f.map(
        #[inline(always)]
        |f| f * f * (f * (f - 2.0) + 1.0) * 30.0,
    );
    let low = [corner(0, 0), corner(1, 0), corner(2, 0), corner(3, 0)];
    let high = [corner(0, 1), corner(1, 1), corner(2, 1), corner(3, 1)];
    let (south, north) = (lerp_noise(simd, &low[0], &low[1], u.x), lerp_noise(simd, &low[2], &low[3], u.x));
    let south_high = lerp_noise(simd, &high[0], &high[1], u.x);
    let north_high = lerp_noise(simd, &high[2], &high[3], u.x);
    let (bottom, top) = (lerp_noise(simd, &south, &north, u.y), lerp_noise(simd, &south_high, &north_high, u.y));
    let along = always(
        #[inline(always)]
        |layer: &[Noises<S>; 4]| {
            let first = layer[1].value - layer[0].value;
            first + (layer[3].value - layer[2].value - first) * u.y
        },
    );
    let east = along(&low) + (along(&high) - along(&low)) * u.z;
    let across = north.value - south.value;
    let across = across + (north_high.value - south_high.value - across) * u.z;
    let sum = lerp_noise(simd, &bottom, &top, u.z);
    let steepest = Vec3s::<S> { x: east, y: across, z: top.value - bottom.value };
    let slope = sum.slope.add(slope.mul(steepest)).map(
        #[inline(always)]
        |v| v * NOISE_SCALE,
    );
    Noises { slope, value: sum.value * NOISE_SCALE }
}

/// [`octave_share`](crate::cpu::noise::octave_share).
#[inline(always)]
pub(super) fn octave_share<S: Simd>(simd: S, footprint: F<S>) -> F<S> {
    let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
    let x = (splat(simd, 0.75) / footprint.max(splat(simd, MIN_FOOTPRINT)) - 1.0).max(zero).min(one);
    x * x * (splat(simd, 3.0) - x * 2.0)
}

/// [`next_octave`](crate::cpu::noise::next_octave).
#[inline(always)]
pub(super) fn next_octave<S: Simd>(p: Vec3s<S>, lacunarity: f32) -> Vec3s<S> {
    let turn = OCTAVE_TURN;
    let row = always(
        #[inline(always)]
        |x: f32, y: f32, z: f32| (p.x * x + p.y * y + p.z * z) * lacunarity + 0.5,
    );
    Vec3s {
        x: row(turn.x_axis.x, turn.y_axis.x, turn.z_axis.x),
        y: row(turn.x_axis.y, turn.y_axis.y, turn.z_axis.y),
        z: row(turn.x_axis.z, turn.y_axis.z, turn.z_axis.z),
    }
}

/// Noise of the rays in `lanes` of which a share is left; nothing of the others.
#[inline(always)]
pub(super) fn noise_where<S: Simd>(simd: S, lanes: M<S>, p: Vec3s<S>) -> Noises<S> {
    let zero = splat(simd, 0.0);
    let nothing = Noises { slope: Vec3s::splat(simd, Vec3::ZERO), value: zero };
    if lanes.all_false() {
        return nothing;
    }
    let found = perlin(simd, p);
    Noises { slope: Vec3s::select(lanes, found.slope, nothing.slope), value: lanes.select(found.value, zero) }
}

/// [`fbm`](crate::cpu::noise::fbm) or [`turbulence`](crate::cpu::noise::turbulence) of the rays in `lanes`.
#[inline(always)]
pub(super) fn sum_octaves<S: Simd>(
    simd: S,
    lanes: M<S>,
    start: Vec3s<S>,
    octaves: Octaves,
    start_footprint: F<S>,
) -> NoiseSums<S> {
    let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
    let (mut p, mut footprint, mut amplitude) = (start, start_footprint, 1.0f32);
    let (mut sum, mut hidden, mut total) = (zero, zero, 0.0f32);
    let variance = if octaves.is_folded { NOISE_ABS_VARIANCE } else { NOISE_VARIANCE };
    for _ in 0..octaves.count {
        let share = octave_share(simd, footprint);
        let is_left = lanes & share.simd_gt(zero);
        let noise = noise_where(simd, is_left, p).value;
        let noise = if octaves.is_folded { noise.abs() - NOISE_ABS } else { noise };
        sum = is_left.select(sum + share * amplitude * noise, sum);
        hidden += (one - share * share) * (amplitude * amplitude) * variance;
        total += amplitude;
        amplitude *= octaves.persistence;
        footprint *= 2.0;
        p = next_octave(p, 2.0);
    }
    NoiseSums { value: sum / total.max(1e-6), hidden: hidden / (total * total).max(1e-6) }
}

/// The points' cells, and the places in them.
#[inline(always)]
pub(super) fn cells_of<S: Simd>(p: Vec3s<S>) -> ([U<S>; 3], Vec3s<S>) {
    let corner = p.map(
        #[inline(always)]
        |v| v.floor(),
    );
    let whole = always(
        #[inline(always)]
        |v: F<S>| to_u::<S>(v.to_int::<I<S>>()),
    );
    ([whole(corner.x), whole(corner.y), whole(corner.z)], p.sub(corner))
}

/// 1 in the lanes of a mask, else 0.
#[inline(always)]
pub(super) fn one_where<S: Simd>(simd: S, lanes: M<S>) -> F<S> {
    lanes.select(splat(simd, 1.0), splat(simd, 0.0))
}

/// A word in all lanes.
#[inline(always)]
pub(super) fn word<S: Simd>(simd: S, v: i32) -> U<S> {
    splat_u(simd, v as u32)
}
