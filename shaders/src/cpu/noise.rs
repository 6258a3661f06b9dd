//! Gradient noise and its sums, filtered by what a pixel covers. GPU twin: `noise.wgsl`.
//!
//! The noise is Perlin's (Improving Noise, 2002) with gradients from an integer hash instead of a table, so that it never
//! repeats and has the same lattice on all devices. Lengths are in cells of the lattice.

use super::night::scramble;
use crate::lanes::{F, LaneFloats, LaneMask, LaneWords, Lanes, M, OneLane, U, Vec3s, always, once};
use glam::{Mat3, Vec3, Vec4};

/// Factor by which [`perlin`] stays between -1 and 1: the largest sum of gradients, in the middle of a cell, is 1.5.
pub(crate) const NOISE_SCALE: f32 = 2.0 / 3.0;
/// Variance of [`perlin`], mean of its absolute value, and variance of that: measured, and compared by a test.
pub(crate) const NOISE_VARIANCE: f32 = 0.016_42;
pub(crate) const NOISE_ABS: f32 = 0.103_05;
pub(crate) const NOISE_ABS_VARIANCE: f32 = 0.005_8;
/// Probability density of [`perlin`] at 0, and its second derivative there.
pub(crate) const NOISE_DENSITY: f32 = 3.07;
pub(crate) const NOISE_DENSITY_BEND: f32 = -190.0;
/// A rotation about an axis that is none of the lattice's. It is applied between octaves, so that their lattices never meet.
pub(crate) const OCTAVE_TURN: Mat3 = Mat3::from_cols(
    Vec3::new(0.360_0, 0.480_0, -0.800_0),
    Vec3::new(-0.800_0, 0.600_0, 0.0),
    Vec3::new(0.480_0, 0.640_0, 0.600_0),
);
/// Least footprint in cells: below, filters divide by almost nothing.
pub(crate) const MIN_FOOTPRINT: f32 = 1e-6;

/// Slope and value of noise.
#[derive(Clone, Copy)]
pub(super) struct NoisePoint<S: Lanes> {
    pub(super) slope: Vec3s<S>,
    pub(super) value: F<S>,
}

impl<S: Lanes> NoisePoint<S> {
    #[inline(always)]
    fn lerp(&self, other: &Self, share: F<S>) -> Self {
        Self { slope: self.slope.lerp(other.slope, share), value: self.value.lerp(other.value, share) }
    }
}

/// Perlin's gradient noise: the slope at `p` in x, y and z, and the value, -1 to 1 with mean 0, in w.
pub fn perlin(p: Vec3) -> Vec4 {
    let found = noise_at(OneLane, p.into());
    Vec3::from(found.slope).extend(found.value)
}

/// The same.
#[inline(always)]
pub(super) fn noise_at<S: Lanes>(simd: S, p: Vec3s<S>) -> NoisePoint<S> {
    simd.call(once!(|| noise_between(simd, p)))
}

#[inline(always)]
fn noise_between<S: Lanes>(simd: S, p: Vec3s<S>) -> NoisePoint<S> {
    let ([x, y, z], f) = cells_of(p);
    let next = always!(|v: U<S>, k: u32| v.wrapping_add(simd.splat_u(k)));
    let west = [scramble::<S>(x), scramble::<S>(next(x, 1))];
    let column = always!(|i: usize, j: u32| scramble::<S>(west[i].wrapping_add(next(y, j))));
    let columns = [column(0, 0), column(1, 0), column(0, 1), column(1, 1)];
    let corner = always!(|i: usize, k: u32| {
        let slope = gradient_of::<S>(scramble::<S>(columns[i].wrapping_add(next(z, k))));
        let from = f - Vec3s::splat(simd, Vec3::new((i & 1) as f32, (i >> 1) as f32, k as f32));
        NoisePoint { slope, value: slope.dot(from) }
    });
    let u = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let slope = f * f * (f * (f - 2.0) + 1.0) * 30.0;
    let low = [corner(0, 0), corner(1, 0), corner(2, 0), corner(3, 0)];
    let high = [corner(0, 1), corner(1, 1), corner(2, 1), corner(3, 1)];
    let (south, north) = (low[0].lerp(&low[1], u.x), low[2].lerp(&low[3], u.x));
    let (south_high, north_high) = (high[0].lerp(&high[1], u.x), high[2].lerp(&high[3], u.x));
    let (bottom, top) = (south.lerp(&north, u.y), south_high.lerp(&north_high, u.y));
    let along = always!(|layer: &[NoisePoint<S>; 4]| {
        let first = layer[1].value - layer[0].value;
        first + (layer[3].value - layer[2].value - first) * u.y
    });
    let east = along(&low) + (along(&high) - along(&low)) * u.z;
    let across = north.value - south.value;
    let across = across + (north_high.value - south_high.value - across) * u.z;
    let sum = bottom.lerp(&top, u.z);
    let steepest = Vec3s::<S>::new(east, across, top.value - bottom.value);
    NoisePoint { slope: (sum.slope + slope * steepest) * NOISE_SCALE, value: sum.value * NOISE_SCALE }
}

/// The points' cells, and the places in them.
#[inline(always)]
pub(super) fn cells_of<S: Lanes>(p: Vec3s<S>) -> ([U<S>; 3], Vec3s<S>) {
    let cell = p.floor();
    ([cell.x.whole(), cell.y.whole(), cell.z.whole()], p - cell)
}

/// A gradient, each component -1 to 1.
#[inline(always)]
fn gradient_of<S: Lanes>(hash: U<S>) -> Vec3s<S> {
    parts_of::<S>(hash) / 511.5 - 1.0
}

/// The three numbers of ten bits in a hash.
#[inline(always)]
pub(super) fn parts_of<S: Lanes>(hash: U<S>) -> Vec3s<S> {
    Vec3s::new((hash & 1023).to_floats(), ((hash >> 10) & 1023).to_floats(), ((hash >> 20) & 1023).to_floats())
}

/// Share of an octave that a footprint of `footprint` cells leaves. The noise has a wavelength of about one and a half cells: the
/// share falls from 1 at four footprints in a wavelength to 0 at two.
#[inline(always)]
pub(super) fn octave_share<S: Lanes>(simd: S, footprint: F<S>) -> F<S> {
    let x = (simd.splat(0.75) / footprint.at_least(MIN_FOOTPRINT) - 1.0).clamped(0.0, 1.0);
    x * x * (simd.splat(3.0) - x * 2.0)
}

/// The place of the next octave, whose frequency is `lacunarity` times as high.
#[inline(always)]
pub(super) fn next_octave<S: Lanes>(p: Vec3s<S>, lacunarity: f32) -> Vec3s<S> {
    p.transformed(&OCTAVE_TURN) * lacunarity + 0.5
}

/// Noise at the points in `lanes`, nothing at others.
#[inline(always)]
pub(super) fn noise_where<S: Lanes>(simd: S, lanes: M<S>, p: Vec3s<S>) -> NoisePoint<S> {
    let zero = simd.splat(0.0);
    let nothing = NoisePoint { slope: Vec3s::new(zero, zero, zero), value: zero };
    if !lanes.any() {
        return nothing;
    }
    let found = noise_at(simd, p);
    NoisePoint { slope: Vec3s::select(lanes, found.slope, nothing.slope), value: lanes.select(found.value, zero) }
}

/// A sum of octaves of noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NoiseSum<F> {
    /// The octaves that the footprint leaves, and the means of the others.
    pub(super) value: F,
    /// Variance that the footprint took from it.
    pub(super) hidden: F,
}

/// Fractal sum of `octaves` octaves, -1 to 1 with mean 0, at the points in `lanes`. Each has twice the frequency of the one before and
/// `persistence` of its amplitude (Mischitelli, equations 4.1 and 4.2). `footprint` is in cells of the first.
#[inline(always)]
pub(super) fn fbm<S: Lanes>(
    simd: S,
    lanes: M<S>,
    p: Vec3s<S>,
    octaves: u32,
    persistence: f32,
    footprint: F<S>,
) -> NoiseSum<F<S>> {
    sum_octaves(simd, lanes, p, (octaves, persistence, false), footprint)
}

/// The same of absolute values less their mean: creases where [`fbm`] has slopes.
#[inline(always)]
pub(super) fn turbulence<S: Lanes>(
    simd: S,
    lanes: M<S>,
    p: Vec3s<S>,
    octaves: u32,
    persistence: f32,
    footprint: F<S>,
) -> NoiseSum<F<S>> {
    sum_octaves(simd, lanes, p, (octaves, persistence, true), footprint)
}

#[inline(always)]
fn sum_octaves<S: Lanes>(
    simd: S,
    lanes: M<S>,
    start: Vec3s<S>,
    (octaves, persistence, is_folded): (u32, f32, bool),
    start_footprint: F<S>,
) -> NoiseSum<F<S>> {
    let zero = simd.splat(0.0);
    let (mut p, mut footprint, mut amplitude) = (start, start_footprint, 1.0f32);
    let (mut sum, mut hidden, mut total) = (zero, zero, 0.0f32);
    let variance = if is_folded { NOISE_ABS_VARIANCE } else { NOISE_VARIANCE };
    for _ in 0..octaves {
        let share = octave_share(simd, footprint);
        let is_left = lanes & share.above(0.0);
        let noise = noise_where(simd, is_left, p).value;
        let noise = if is_folded { noise.abs() - NOISE_ABS } else { noise };
        sum = is_left.select(sum + share * amplitude * noise, sum);
        hidden += (share * share).rest() * (amplitude * amplitude) * variance;
        total += amplitude;
        amplitude *= persistence;
        footprint *= 2.0;
        p = next_octave(p, 2.0);
    }
    NoiseSum { value: sum / total.max(1e-6), hidden: hidden / (total * total).max(1e-6) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::night::scramble_cell;
    use glam::{IVec3, Vec4Swizzles};
    use insula_test_support::rng::Rng;

    fn place(rng: &mut Rng, size: f64) -> Vec3 {
        Vec3::new(rng.range(-size, size) as f32, rng.range(-size, size) as f32, rng.range(-size, size) as f32)
    }

    #[test]
    fn hashes_of_the_lattice_never_change() {
        let hash = |x, y, z| scramble_cell(IVec3::new(x, y, z));
        let known = [hash(0, 0, 0), hash(1, 2, 3), hash(-1, -2, -3), hash(i32::MAX, i32::MIN, 12_345)];
        assert_eq!(known, [755_367_838, 3_856_856_178, 4_183_567_994, 2_007_579_151]);
        // At a corner the slope is the gradient, and the value is 0.
        for cell in [Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0), Vec3::new(-1.0, -2.0, -3.0)] {
            let at = perlin(cell);
            let gradient = Vec3::from(gradient_of::<OneLane>(hash(cell.x as i32, cell.y as i32, cell.z as i32)));
            assert_eq!((at.xyz(), at.w), (gradient * NOISE_SCALE, 0.0), "{cell}");
        }
    }

    #[test]
    fn noise_has_the_moments_that_its_filters_assume() {
        let (mut rng, n) = (Rng::new(7), 2_000_000);
        let (mut sum, mut squares, mut absolute, mut near_zero, mut largest) = (0.0, 0.0, 0.0, 0.0, 0.0_f64);
        for _ in 0..n {
            let v = f64::from(perlin(place(&mut rng, 4000.0)).w);
            sum += v;
            squares += v * v;
            absolute += v.abs();
            near_zero += f64::from(v.abs() < 0.02);
            largest = largest.max(v.abs());
        }
        let mean = |sum: f64| sum / f64::from(n);
        let (variance, absolute) = (mean(squares), mean(absolute));
        assert!(mean(sum).abs() < 5e-4 && largest > 0.4 && largest <= 1.0, "{} {largest}", mean(sum));
        let near = |found: f64, assumed: f32| (found / f64::from(assumed) - 1.0).abs() < 0.015;
        assert!(near(variance, NOISE_VARIANCE), "{variance}");
        assert!(near(absolute, NOISE_ABS), "{absolute}");
        assert!(near(variance - absolute * absolute, NOISE_ABS_VARIANCE), "{}", variance - absolute * absolute);
        assert!(near(mean(near_zero) / 0.04, NOISE_DENSITY), "{}", mean(near_zero) / 0.04);
    }

    #[test]
    fn slopes_are_those_of_the_values() {
        let mut rng = Rng::new(3);
        for _ in 0..2000 {
            let p = place(&mut rng, 20.0);
            let slope = perlin(p).xyz();
            let step = 1e-2;
            let along = |axis: Vec3| (perlin(p + axis * step).w - perlin(p - axis * step).w) / (2.0 * step);
            let measured = Vec3::new(along(Vec3::X), along(Vec3::Y), along(Vec3::Z));
            assert!((measured - slope).abs().max_element() < 4e-3, "{p}: {measured} {slope}");
        }
    }

    /// Correlation of the noise with itself, shifted by whole cells along an axis, where a lattice or a period would show.
    #[test]
    fn noise_does_not_repeat() {
        let mut rng = Rng::new(11);
        let samples: Vec<Vec3> = (0..20_000).map(|_| place(&mut rng, 2000.0)).collect();
        let values: Vec<f32> = samples.iter().map(|p| perlin(*p).w).collect();
        let lags = (2..100).map(|k| k as f32).chain([128.0, 256.0, 1024.0, 4096.0, 65_536.0]);
        for lag in lags {
            for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
                let products = samples.iter().zip(&values).map(|(p, v)| perlin(*p + axis * lag).w * v);
                let correlation = products.sum::<f32>() / samples.len() as f32 / NOISE_VARIANCE;
                assert!(correlation.abs() < 0.1, "{correlation} at {lag} cells along {axis}");
            }
        }
    }

    #[test]
    fn octaves_fade_into_their_means() {
        let mut rng = Rng::new(5);
        assert_eq!([0.375, 0.75, 0.0].map(|footprint| octave_share(OneLane, footprint)), [1.0, 0.0, 1.0]);
        for _ in 0..200 {
            let p = place(&mut rng, 50.0).into();
            let sum =
                |octaves, persistence, footprint| turbulence(OneLane, true, p, octaves, persistence, footprint).value;
            assert_eq!(sum(4, 0.5, 0.75), 0.0);
            assert_eq!(sum(4, 0.5, 0.375), sum(1, 1.0, 0.375) / 1.875);
        }
        let far = fbm(OneLane, true, Vec3::ONE.into(), 3, 0.85, 1.0);
        let weights = (1.0 + 0.85 * 0.85 + 0.7225 * 0.7225) / (1.0_f32 + 0.85 + 0.7225).powi(2);
        assert!(far.value == 0.0 && (far.hidden - weights * NOISE_VARIANCE).abs() < 1e-6, "{far:?}");
    }
}
