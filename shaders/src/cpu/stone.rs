//! Colour and gloss of a stone at a point. GPU twin: `stone.wgsl`.
//!
//! Each pattern is a sum of parts that are independent of each other: octaves of veins, grains, clouds. Where a pixel covers a part,
//! the part is replaced by its mean. Colours depend on each part linearly, so what a pixel shows keeps the mean colour of what it
//! covers, near and far.

use super::night::scramble;
use super::noise::{
    NOISE_DENSITY, NOISE_DENSITY_BEND, NoisePoint, NoiseSum, cells_of, fbm, next_octave, noise_where, octave_share,
    parts_of, turbulence,
};
use crate::lanes::{F, LaneFloats, LaneMask, LaneWords, Lanes, M, OneLane, Vec2s, Vec3s, always};
use crate::stone::{BROAD_VEINS, FINE_VEINS, Stone, StoneKind};
use glam::{Vec2, Vec3};

/// Width of fine veins as a share of that of broad ones. Mischitelli's powers 2 and 64 have this ratio (section 4.3.3).
pub(crate) const FINE_WIDTH: f32 = 0.22;
/// Lacunarities of broad and of fine veins, and the factor by which the strength of veins falls from octave to octave (there).
pub(crate) const BROAD_LACUNARITY: f32 = 2.3;
pub(crate) const FINE_LACUNARITY: f32 = 1.7;
pub(crate) const VEIN_FALL: f32 = 2.3;
/// Frequency of what bends veins and varies their width, in that of the broad veins, and how much the width varies.
pub(crate) const BEND_FREQUENCY: f32 = 0.8;
pub(crate) const WIDTH_VARIATION: f32 = 3.2;
/// Frequency of what crinkles veins, and how much of it is added to what bends them.
pub(crate) const CRINKLE_FREQUENCY: f32 = 3.3;
pub(crate) const CRINKLE: f32 = 0.24;
/// Veins are longer in one direction by the inverse of this.
pub(crate) const VEIN_STRETCH: f32 = 0.42;
/// Frequency of the places where veins are strong, and how sharply those are bounded.
pub(crate) const PLACE_FREQUENCY: f32 = 0.6;
pub(crate) const PLACE_CONTRAST: f32 = 1.6;
/// How much steeper bends make the noise of veins.
pub(crate) const BENT_SLOPE: f32 = 1.0;
/// Least share of a vein's width.
pub(crate) const MIN_WIDTH: f32 = 0.12;
/// Persistence of the granite's octaves (section 4.4).
pub(crate) const GRANITE_PERSISTENCE: f32 = 0.85;
/// Frequency of mica, and of what bends grains, in that of the large grains.
pub(crate) const MICA_FREQUENCY: f32 = 1.9;
pub(crate) const GRAIN_BEND_FREQUENCY: f32 = 2.1;
/// Grains have sharper borders than noise: they fade out at this share of its footprint.
pub(crate) const GRAIN_FOOTPRINT: f32 = 1.2;
/// How much patina depends on the height of the normal, and on the visible sky.
pub(crate) const PATINA_UPWARDS: f32 = 0.3;
pub(crate) const PATINA_OPEN: f32 = 0.45;
/// Half of the range of [`ramp`], and the noise that moves patina.
pub(crate) const RAMP_RANGE: f32 = 0.2;
pub(crate) const PATINA_NOISE: f32 = 4.2;
/// How much darker metal is in creases of the noise.
pub(crate) const PATINA_TARNISH: f32 = 4.0;
/// How much thinner patina is in creases of the noise.
pub(crate) const PATINA_CREASES: f32 = 6.0;
/// Rain stretches patina by the inverse of this.
pub(crate) const PATINA_HEIGHT: f32 = 0.28;
/// Roughness and reflectance of patina.
pub(crate) const PATINA_ALPHA: f32 = 0.5;
pub(crate) const PATINA_F0: f32 = 0.04;
/// Frequency of beds along the ground, and of grains of a limestone, in that of beds along the height.
pub(crate) const BED_FLATNESS: f32 = 0.08;
pub(crate) const LIMESTONE_GRAINS: f32 = 14.0;
/// Frequency of fibres along the axis of wood and around it, in that across the rings.
pub(crate) const FIBRE_LENGTH: f32 = 0.1;
pub(crate) const FIBRE_WIDTH: f32 = 0.35;

/// What a stone shows at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StoneSurface {
    /// Share of light that is scattered, linear RGB.
    pub albedo: Vec3,
    /// Reflectance from straight ahead.
    pub f0: Vec3,
    /// Ward's roughness along `tangent` and across it.
    pub alpha: Vec2,
    /// Direction of the grain: a unit vector, horizontal, across the normal but where that is upright.
    pub tangent: Vec3,
}

/// Share of a metal's reflectance that its colour from afar has: that of the part of the sky and the city which it reflects.
const METAL_SHARE: f32 = 0.4;

impl StoneSurface {
    /// The colour of a matt surface that looks alike, linear RGB: where nothing evaluates reflections.
    pub fn matt_colour(&self) -> Vec3 {
        self.albedo + self.f0 * METAL_SHARE
    }
}

/// [`StoneSurface`] of each ray, without the grain's direction.
#[derive(Clone, Copy)]
pub(super) struct StoneSurfaces<S: Lanes> {
    pub(super) albedo: Vec3s<S>,
    pub(super) f0: Vec3s<S>,
    pub(super) alpha: Vec2s<S>,
}

impl<S: Lanes> StoneSurfaces<S> {
    /// The surface of a ray, whose unit normal is given.
    #[inline(always)]
    pub(super) fn lane(&self, lane: usize, normal: Vec3) -> StoneSurface {
        StoneSurface {
            albedo: self.albedo.lane(lane),
            f0: self.f0.lane(lane),
            alpha: Vec2::new(self.alpha.x.lane(lane), self.alpha.y.lane(lane)),
            tangent: tangent_of(normal),
        }
    }
}

/// Where rays meet a stone.
#[derive(Clone, Copy)]
pub(super) struct StonePoints<S: Lanes> {
    /// Rays that do.
    pub(super) lanes: M<S>,
    /// Metres from the object's origin.
    pub(super) p_m: Vec3s<S>,
    pub(super) normal: Vec3s<S>,
    pub(super) ao: F<S>,
    pub(super) footprint_m: F<S>,
}

/// A stone, and the rays that meet it.
#[derive(Clone, Copy)]
struct StonePattern<'a, S: Lanes> {
    simd: S,
    stone: &'a Stone,
    lanes: M<S>,
}

/// A stone at `p_m`, in metres from the object's origin. `normal` has unit length, `ao` is the visible share of the sky, and
/// `footprint_m` the side in metres of what the pixel covers.
pub fn stone_surface(stone: &Stone, p_m: Vec3, normal: Vec3, ao: f32, footprint_m: f32) -> StoneSurface {
    let points = StonePoints { lanes: true, p_m: p_m.into(), normal: normal.into(), ao, footprint_m };
    stone_surfaces(OneLane, stone, &points).lane(0, normal)
}

/// The same of each ray.
#[inline(always)]
pub(super) fn stone_surfaces<S: Lanes>(simd: S, stone: &Stone, points: &StonePoints<S>) -> StoneSurfaces<S> {
    let footprint = points.footprint_m * stone.cells_per_m;
    let straight = points.p_m * stone.cells_per_m;
    // Level and upright surfaces are not along the lattice.
    let p = next_octave(straight, 1.0);
    let here = StonePattern { simd, stone, lanes: points.lanes };
    let [along, across] = stone.alpha;
    let plain = StoneSurfaces {
        albedo: here.colour(stone.base),
        f0: here.colour(stone.f0),
        alpha: Vec2s::<S> { x: simd.splat(along), y: simd.splat(across) },
    };
    match stone.kind {
        kind if kind == StoneKind::Marble as u32 => StoneSurfaces { albedo: here.marble(p, footprint), ..plain },
        kind if kind == StoneKind::Granite as u32 => StoneSurfaces { albedo: here.granite(p, footprint), ..plain },
        kind if kind == StoneKind::Bronze as u32 => {
            let exposure = points.normal.z * PATINA_UPWARDS + (points.ao - 0.6) * PATINA_OPEN;
            here.bronze(&plain, straight, exposure, footprint)
        }
        kind if kind == StoneKind::Limestone as u32 => {
            StoneSurfaces { albedo: here.limestone(straight, footprint), ..plain }
        }
        kind if kind == StoneKind::Wood as u32 => {
            StoneSurfaces { albedo: here.limestone(wood_place(straight), footprint), ..plain }
        }
        _ => plain,
    }
}

/// Horizontal unit vector across `normal`.
fn tangent_of(normal: Vec3) -> Vec3 {
    let length = Vec2::new(normal.x, normal.y).length();
    if length > 1e-3 { Vec3::new(-normal.y / length, normal.x / length, 0.0) } else { Vec3::X }
}

/// Veins at a point.
struct VeinSum<S: Lanes> {
    /// Share that they cover.
    share: F<S>,
    /// Sum of the noise whose zeros they are.
    cloud: F<S>,
}

impl<S: Lanes> StonePattern<'_, S> {
    #[inline(always)]
    fn colour(&self, rgb: [f32; 3]) -> Vec3s<S> {
        Vec3s::splat(self.simd, rgb.into())
    }

    #[inline(always)]
    fn mix(&self, a: Vec3s<S>, b: [f32; 3], share: F<S>) -> Vec3s<S> {
        a.lerp(self.colour(b), share)
    }

    /// Noise and slope at `p`, faded out by a footprint.
    #[inline(always)]
    fn faded_noise(&self, p: Vec3s<S>, footprint: F<S>) -> NoisePoint<S> {
        let share = octave_share(self.simd, footprint);
        let found = noise_where(self.simd, self.lanes & share.above(0.0), p);
        NoisePoint { slope: found.slope.scale(share), value: found.value * share }
    }

    #[inline(always)]
    fn fbm(&self, p: Vec3s<S>, octaves: u32, persistence: f32, footprint: F<S>) -> NoiseSum<F<S>> {
        fbm(self.simd, self.lanes, p, octaves, persistence, footprint)
    }

    /// Two kinds of veins through a cloudy ground (Mischitelli, section 4.3.3). Either kind has places of its own, where it is strong.
    #[inline(always)]
    fn marble(&self, straight: Vec3s<S>, footprint: F<S>) -> Vec3s<S> {
        let (simd, stone) = (self.simd, self.stone);
        let p = straight * Vec3s::splat(simd, Vec3::new(VEIN_STRETCH, 1.0, 1.0));
        let slow = self.faded_noise(next_octave(p, BEND_FREQUENCY), footprint * BEND_FREQUENCY);
        let quick = self.faded_noise(next_octave(p, CRINKLE_FREQUENCY), footprint * CRINKLE_FREQUENCY);
        let places = self.fbm(next_octave(p, PLACE_FREQUENCY), 2, 0.6, footprint * PLACE_FREQUENCY);
        let bent = p + (slow.slope + quick.slope * CRINKLE) * stone.bend;
        let width = (slow.value * WIDTH_VARIATION + 1.0).at_least(MIN_WIDTH) * stone.vein_width;
        let broad = self.veins(bent, width, footprint, BROAD_LACUNARITY);
        let fine_start = next_octave(bent, FINE_LACUNARITY);
        let fine = self.veins(fine_start, width * FINE_WIDTH, footprint * FINE_LACUNARITY, FINE_LACUNARITY);
        let strength = always!(|veins: u32, blend: f32, contrast: f32| {
            let zero = simd.splat(0.0);
            if stone.veins & veins != 0 { self.ramp(zero, &places, contrast) * blend } else { zero }
        });
        let tone = ((broad.cloud + places.value * 2.0) * stone.variation + 1.0).at_least(0.0);
        let ground = self.colour(stone.base).scale(tone);
        let broad_share = broad.share * strength(BROAD_VEINS, stone.blend[0], PLACE_CONTRAST);
        let veined = self.mix(ground, stone.vein, broad_share);
        self.mix(veined, stone.grain, fine.share * strength(FINE_VEINS, stone.blend[1], -PLACE_CONTRAST))
    }

    /// Octaves of veins, each where its noise is 0. The powers of [`Self::vein_profile`] and the steps are those of the report, but for
    /// the small part of the broad veins in the fine ones, which nobody would see.
    #[inline(always)]
    fn veins(&self, start: Vec3s<S>, width: F<S>, start_footprint: F<S>, lacunarity: f32) -> VeinSum<S> {
        let (simd, stone) = (self.simd, self.stone);
        let zero = simd.splat(0.0);
        let (mut p, mut footprint, mut amplitude) = (start, start_footprint, 1.0f32);
        let (mut share, mut cloud) = (zero, zero);
        let mean = self.vein_mean(width, zero);
        for _ in 0..stone.octaves {
            let left = octave_share(simd, footprint);
            let is_left = self.lanes & left.above(0.0);
            let mut vein = mean;
            if is_left.any() {
                let noise = noise_where(simd, is_left, p);
                // Where the place is bent, the noise is steeper than its slope.
                let spread = noise.slope.dot(noise.slope).sqrt() * footprint * (1.0 + BENT_SLOPE * stone.bend);
                let above = left * (self.vein_profile(noise.value, spread, width) - self.vein_mean(width, spread));
                vein = is_left.select(mean + above, mean);
                cloud = is_left.select(cloud + noise.value * left * amplitude, cloud);
            }
            share += share.rest() * vein * amplitude;
            amplitude /= VEIN_FALL;
            p = next_octave(p, lacunarity);
            footprint *= lacunarity;
        }
        VeinSum { share, cloud }
    }

    /// Mean of [`Self::vein_profile`] over all places where the noise has this spread: the integral of a vein times the noise's density
    /// around 0, which falls to the sides.
    #[inline(always)]
    fn vein_mean(&self, width: F<S>, spread: F<S>) -> F<S> {
        let bend = spread * (NOISE_DENSITY_BEND / (24.0 * NOISE_DENSITY));
        let density = self.simd.splat(NOISE_DENSITY) / (bend * spread).rest();
        width * (density * 16.0 / 15.0 + width * NOISE_DENSITY_BEND * width * 8.0 / 105.0)
    }

    /// Mean of a vein over a footprint in which the noise goes from `noise - spread / 2` to `noise + spread / 2`. Across a vein, its
    /// share is `(1 - (noise / width)^2)^2`: it has the half width of the report's powers of `smoothstep`, and its integral is a
    /// polynomial.
    #[inline(always)]
    fn vein_profile(&self, noise: F<S>, spread: F<S>, width: F<S>) -> F<S> {
        let half = (spread / width).at_least(0.02) * 0.5;
        let middle = noise / width;
        (self.vein_integral(middle + half) - self.vein_integral(middle - half)) / (half * 2.0)
    }

    #[inline(always)]
    fn vein_integral(&self, at: F<S>) -> F<S> {
        let u = at.clamped(-1.0, 1.0);
        let square = u * u;
        u * (square * (square * 0.2 - 2.0 / 3.0) + 1.0)
    }

    /// Grains of feldspar and quartz, and smaller ones of mica between them. The noise is that of the report's section 4.4: few octaves
    /// with a high persistence.
    #[inline(always)]
    fn granite(&self, p: Vec3s<S>, footprint: F<S>) -> Vec3s<S> {
        let stone = self.stone;
        let bend = self.faded_noise(next_octave(p, GRAIN_BEND_FREQUENCY), footprint * GRAIN_BEND_FREQUENCY);
        let bent = p + bend.slope * stone.bend;
        let large = self.grains(bent, footprint, stone.blend[0]);
        let mica = self.grains(next_octave(bent, MICA_FREQUENCY), footprint * MICA_FREQUENCY, stone.blend[1]);
        let specks = self.fbm(p, stone.octaves, GRANITE_PERSISTENCE, footprint);
        let tone = ((large.y + specks.value * 2.0) * stone.variation + 1.0).at_least(0.0);
        let ground = self.mix(self.colour(stone.base), stone.vein, large.x).scale(tone);
        self.mix(ground, stone.grain, mica.x)
    }

    /// Cells around one point in each cell of the lattice (Worley 1996): a share of them, `share`, has 1 in x, the others 0, with soft
    /// borders. In y, each has a tone of its own, -0.5 to 0.5. The value of a cell does not depend on its shape, so that both means are
    /// exact with any weights.
    #[inline(always)]
    fn grains(&self, p: Vec3s<S>, footprint: F<S>, share: f32) -> Vec2s<S> {
        let simd = self.simd;
        let (zero, one) = (simd.splat(0.0), simd.splat(1.0));
        let left = octave_share(simd, footprint * GRAIN_FOOTPRINT);
        let mean = Vec2s::<S> { x: simd.splat(share), y: zero };
        let is_left = self.lanes & left.above(0.0);
        if !is_left.any() {
            return mean;
        }
        let ([x, y, z], f) = cells_of(p);
        let word = always!(|v: i32| simd.splat_u(v as u32));
        // The smallest weights belong to places that are far from all points.
        let least = Vec3s::splat(simd, Vec3::new(share, 0.0, 1.0) * 1e-9);
        let (mut sharp, mut soft) = (least, least);
        for i in 0..9 {
            let (east, north) = (i % 3 - 1, i / 3 - 1);
            let row = scramble::<S>(x.wrapping_add(word(east)));
            let column = scramble::<S>(row.wrapping_add(y.wrapping_add(word(north))));
            for k in -1..=1 {
                // The hash of `scramble_cell`.
                let hash = scramble::<S>(column.wrapping_add(z.wrapping_add(word(k))));
                let place = Vec3s::splat(simd, Vec3::new(east as f32, north as f32, k as f32));
                let apart = place - f + parts_of::<S>(hash) / 1023.0;
                let near = apart.dot(apart).rest();
                let is_near = near.above(0.0);
                if !is_near.any() {
                    continue;
                }
                let of_cell = scramble::<S>(hash ^ 0x5bd1_e995);
                let is_of_share = (of_cell & 0xffff).to_floats().below(share * 65_536.0);
                let tone = (of_cell >> 16).to_floats() / 65_535.0 - 0.5;
                let value = Vec3s::<S>::new(is_of_share.select(one, zero), tone, one);
                let square = near * near;
                let eighth = square * square * square * square;
                let weight = eighth * eighth;
                soft = Vec3s::select(is_near, soft + value.scale(weight), soft);
                let weight = weight * weight * weight * weight;
                sharp = Vec3s::select(is_near, sharp + value.scale(weight), sharp);
            }
        }
        let softness = (footprint * 8.0).at_most(1.0);
        let found = always!(|sharp_part: F<S>, soft_part: F<S>, mean: F<S>| {
            let found = (sharp_part / sharp.z).lerp(soft_part / soft.z, softness);
            is_left.select(mean.lerp(found, left), mean)
        });
        Vec2s { x: found(sharp.x, soft.x, mean.x), y: found(sharp.y, soft.y, mean.y) }
    }

    /// Metal below a patina, which grows where rain and air reach it. `exposure` is above 0 there.
    #[inline(always)]
    fn bronze(&self, bare: &StoneSurfaces<S>, straight: Vec3s<S>, exposure: F<S>, footprint: F<S>) -> StoneSurfaces<S> {
        let (simd, stone) = (self.simd, self.stone);
        let p = next_octave(straight * Vec3s::splat(simd, Vec3::new(1.0, 1.0, PATINA_HEIGHT)), 1.0);
        let patches = self.fbm(p, stone.octaves, 0.65, footprint);
        let patina = self.ramp(exposure + (stone.blend[0] - 0.5), &patches, PATINA_NOISE * stone.variation);
        let start = next_octave(p, 2.7);
        let creases = turbulence(simd, self.lanes, start, stone.octaves.min(3), 0.75, footprint * 2.7).value;
        let thin = ((creases * PATINA_CREASES + 1.0) * stone.blend[1]).clamped(0.0, 1.0);
        let tarnish = (creases * PATINA_TARNISH).rest().clamped(0.0, 1.3);
        let green = self.mix(self.colour(stone.vein), stone.grain, thin);
        let alpha = simd.splat(PATINA_ALPHA);
        StoneSurfaces {
            albedo: bare.albedo.lerp(green, patina),
            f0: self.mix(bare.f0.scale(tarnish), [PATINA_F0; 3], patina),
            alpha: Vec2s::<S> { x: bare.alpha.x.lerp(alpha, patina), y: bare.alpha.y.lerp(alpha, patina) },
        }
    }

    /// A ramp from 0 to 1 around `at` plus noise. What a footprint hides of the noise makes it wider: it is the mean over a triangular
    /// distribution with the hidden variance, which is close to that of noise.
    #[inline(always)]
    fn ramp(&self, at: F<S>, noise: &NoiseSum<F<S>>, strength: f32) -> F<S> {
        let middle = (at + noise.value * strength) / (2.0 * RAMP_RANGE) + 0.5;
        // Half of the range of a triangular distribution is the root of 6 times its variance.
        let half = ((noise.hidden * 6.0).sqrt() * strength.abs() / (2.0 * RAMP_RANGE)).at_least(0.1);
        let sides = self.ramp_integral(middle + half) + self.ramp_integral(middle - half);
        (sides - self.ramp_integral(middle) * 2.0) / (half * half)
    }

    /// Integral of the integral of a ramp from 0 to 1.
    #[inline(always)]
    fn ramp_integral(&self, at: F<S>) -> F<S> {
        let (u, above) = (at.clamped(0.0, 1.0), (at - 1.0).at_least(0.0));
        u * u * u / 6.0 + above * 0.5 * (above + 1.0)
    }

    /// Fine grains in faint level beds.
    #[inline(always)]
    fn limestone(&self, straight: Vec3s<S>, footprint: F<S>) -> Vec3s<S> {
        let (simd, stone) = (self.simd, self.stone);
        let slow = self.faded_noise(next_octave(straight, 0.2), footprint * 0.2).value;
        let mut flat = straight * Vec3s::splat(simd, Vec3::new(BED_FLATNESS, BED_FLATNESS, 1.0));
        flat.z += slow * stone.bend;
        let beds = self.fbm(flat + 0.37, 3, 0.7, footprint);
        let start = next_octave(straight, LIMESTONE_GRAINS);
        let grains = self.fbm(start, stone.octaves, 0.85, footprint * LIMESTONE_GRAINS);
        let ground = self.colour(stone.base).scale(slow * stone.variation + 1.0);
        let bedded = self.mix(ground, stone.vein, self.ramp(simd.splat(0.0), &beds, 1.0) * stone.blend[0]);
        self.mix(bedded, stone.grain, self.ramp(simd.splat(-0.08), &grains, 1.5) * stone.blend[1])
    }
}

/// Where wood has the pattern of limestone: the distance from its axis takes the place of the height, so that beds are rings and
/// grains are fibres. Distances become at most a tenth longer, so footprints stay as they are.
#[inline(always)]
fn wood_place<S: Lanes>(straight: Vec3s<S>) -> Vec3s<S> {
    let Vec3s { x, y, z } = straight;
    Vec3s::new(z * FIBRE_LENGTH, (x - y) * FIBRE_WIDTH, (x * x + y * y).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::noise::OCTAVE_TURN;
    use crate::stone::PRESETS;
    use insula_test_support::rng::Rng;
    use rayon::prelude::*;

    /// Points in a cube of some side in metres.
    fn places(seed: u64, count: usize, side_m: f64) -> Vec<Vec3> {
        let mut rng = Rng::new(seed);
        let mut along = || rng.range(-0.5 * side_m, 0.5 * side_m) as f32;
        (0..count).map(|_| Vec3::new(along(), along(), along())).collect()
    }

    /// Albedo of a wall in the open.
    fn albedo(stone: &Stone, p: Vec3, footprint_m: f32) -> Vec3 {
        stone_surface(stone, p, Vec3::NEG_Y, 0.5, footprint_m).albedo
    }

    fn mean(values: &[Vec3]) -> Vec3 {
        (values.iter().map(|v| v.as_dvec3()).sum::<glam::DVec3>() / values.len() as f64).as_vec3()
    }

    #[test]
    fn mean_colours_are_the_same_at_all_distances() {
        let points = places(1, 400_000, 300.0);
        for (name, stone) in &PRESETS {
            let far = albedo(stone, Vec3::ZERO, 1e4);
            let span = |at: Vec3| (at / far - 1.0).abs().max_element();
            for footprint_m in [1e-5, 0.003, 0.02, 0.06, 0.15, 0.5] {
                let near: Vec<Vec3> = points.par_iter().map(|p| albedo(stone, *p, footprint_m)).collect();
                let (found, different) = (mean(&near), near.iter().filter(|v| span(**v) > 0.02).count());
                println!("{name} {footprint_m} m: {found} {far} off by {:.4}, {different} differ", span(found));
                assert!(span(found) < 0.01, "{name} at {footprint_m} m: {found}, from afar {far}");
                assert!(footprint_m > 1e-3 || different > points.len() / 2, "{name} has no pattern");
            }
            assert_eq!(albedo(stone, Vec3::splat(7.7), 1e4), far, "{name}");
        }
    }

    /// Correlation of the albedo with itself, shifted: a lattice or a period would show as a peak.
    #[test]
    fn patterns_do_not_repeat_within_100_m() {
        let points = places(2, 8000, 400.0);
        for (name, stone) in &PRESETS {
            let luminance = |p: Vec3| albedo(stone, p, 1e-4).element_sum();
            let values: Vec<f32> = points.par_iter().map(|p| luminance(*p)).collect();
            let middle = values.iter().sum::<f32>() / values.len() as f32;
            let variance = values.iter().map(|v| (v - middle) * (v - middle)).sum::<f32>();
            // The largest parts of a pattern have up to twelve cells: beds and places of veins.
            let scale_m = 12.0 / stone.cells_per_m;
            let axes = [Vec3::X, Vec3::Y, Vec3::Z];
            let by_metres = (0..40).map(|k| scale_m + (100.0 - scale_m) * k as f32 / 39.0);
            let by_metres = by_metres.flat_map(|lag_m| axes.map(|axis| axis * lag_m));
            // By whole cells, along the lattice.
            let cells = (13..20).chain([24, 32, 48, 64, 96, 100, 128, 256]).map(|k| k as f32 / stone.cells_per_m);
            let by_cells = cells.flat_map(|lag_m| axes.map(|axis| OCTAVE_TURN.transpose() * axis * lag_m));
            for lag in by_metres.chain(by_cells) {
                // Beds are level: they may go on.
                if stone.kind == StoneKind::Limestone as u32 && lag.z.abs() < scale_m {
                    continue;
                }
                // So are fibres upright.
                if stone.kind == StoneKind::Wood as u32 && lag.truncate().length() < scale_m {
                    continue;
                }
                let product = |(p, v): (&Vec3, &f32)| (luminance(*p + lag) - middle) * (v - middle);
                let correlation = points.par_iter().zip(&values).map(product).sum::<f32>() / variance;
                assert!(correlation.abs() < 0.1, "{name}: {correlation} at {lag} m");
            }
        }
    }

    /// Radiance of a row of pixels on a wall at a distance: `rays` along each side of a pixel.
    fn row(stone: &Stone, distance_m: f32, rays: u32, footprint_m: f32) -> Vec<f32> {
        let pixel_m = distance_m * 1e-3;
        let offset = |k: u32| (k as f32 + 0.5) / rays as f32 - 0.5;
        let pixel = |x: i32| {
            let ray = |k: u32| {
                let at = Vec2::new(x as f32 + offset(k % rays), offset(k / rays)) * pixel_m;
                albedo(stone, Vec3::new(at.x, 1.3, at.y), footprint_m).y
            };
            (0..rays * rays).map(ray).sum::<f32>() / (rays * rays) as f32
        };
        (-24..24).map(pixel).collect()
    }

    #[test]
    fn a_slow_zoom_flickers_no_more_than_64_rays_per_pixel() {
        const RATIO: f32 = 1.02;
        for (name, stone) in &PRESETS {
            let steps = (250.0_f32.ln() / RATIO.ln()).ceil() as i32;
            let distances: Vec<f32> = (0..=steps).map(|k| 2.0 * RATIO.powi(k)).collect();
            let frames = |rays: u32, footprint: f32| -> Vec<Vec<f32>> {
                distances.par_iter().map(|m| row(stone, *m, rays, (footprint * m).max(1e-5))).collect()
            };
            let change = |frames: &[Vec<f32>]| -> f32 {
                let squares =
                    |pair: &[Vec<f32>]| pair[0].iter().zip(&pair[1]).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
                frames.windows(2).map(squares).sum()
            };
            let (filtered, reference) = (frames(1, 1e-3), frames(8, 0.0));
            // By distance: 2 to 8 m, to 32 m, to 128 m, to 512 m.
            for (k, (found, wanted)) in filtered.chunks(70).zip(reference.chunks(70)).enumerate() {
                let ratio = change(found) / change(wanted);
                println!("{name} from {:.0} m: {ratio:.3}", distances[70 * k]);
                assert!(ratio < 1.2, "{name} changes {ratio} times as much as 64 rays per pixel");
            }
            let unfiltered = frames(1, 0.0);
            assert!(change(&unfiltered) > 1.5 * change(&reference), "{name} needs no filter");
        }
    }

    #[test]
    fn patina_grows_where_rain_falls() {
        let bronze = Stone::preset("bronze").unwrap();
        let green = |normal: Vec3, ao: f32| stone_surface(&bronze, Vec3::ZERO, normal, ao, 1e4).albedo.y;
        assert!(green(Vec3::Z, 1.0) > 2.0 * green(Vec3::NEG_Z, 0.1));
        assert!(green(Vec3::X, 0.5) > green(Vec3::X, 0.1));
        assert_eq!(stone_surface(&Stone::NONE, Vec3::ONE, Vec3::Z, 1.0, 0.1).albedo, Vec3::ZERO);
    }
}
