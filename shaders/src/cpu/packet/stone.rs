//! Colour and gloss of stones at the points of a packet. The scalar code is [`stone`](crate::cpu::stone).

use super::hits::Hits;
use super::lanes::{F, M, Vec2s, Vec3s, always, first_lane, float_u, splat, splat_u};
use super::noise::{
    NoiseSums, Noises, Octaves, cells_of, lerp, lerp3, next_octave, noise_where, octave_share, one_where, parts_of,
    scramble, sum_octaves, word,
};
use super::shade::unit_normal;
use crate::cpu::mesh::MIN_COSINE;
use crate::cpu::noise::{NOISE_DENSITY, NOISE_DENSITY_BEND};
use crate::cpu::raycast::{pixel_m, stone_numbered};
use crate::cpu::stone::{
    BED_FLATNESS, BEND_FREQUENCY, BENT_SLOPE, BROAD_LACUNARITY, CRINKLE, CRINKLE_FREQUENCY, FIBRE_LENGTH, FIBRE_WIDTH,
    FINE_LACUNARITY, FINE_WIDTH, GRAIN_BEND_FREQUENCY, GRAIN_FOOTPRINT, GRANITE_PERSISTENCE, LIMESTONE_GRAINS,
    MICA_FREQUENCY, MIN_WIDTH, PATINA_ALPHA, PATINA_CREASES, PATINA_F0, PATINA_HEIGHT, PATINA_NOISE, PATINA_OPEN,
    PATINA_TARNISH, PATINA_UPWARDS, PLACE_CONTRAST, PLACE_FREQUENCY, RAMP_RANGE, StoneSurface, VEIN_FALL, VEIN_STRETCH,
    WIDTH_VARIATION, tangent_of,
};
use crate::layout::FrameUniform;
use crate::stone::{BROAD_VEINS, FINE_VEINS, Stone, StoneKind};
use fearless_simd::prelude::*;
use glam::{Vec2, Vec3};

/// [`StoneSurface`] of each ray, without the grain's direction.
#[derive(Clone, Copy)]
pub(super) struct StoneSurfaces<S: Simd> {
    albedo: Vec3s<S>,
    f0: Vec3s<S>,
    alpha: Vec2s<S>,
}

/// Where the rays meet a stone.
#[derive(Clone, Copy)]
struct StonePoints<S: Simd> {
    /// Rays that do.
    lanes: M<S>,
    /// Metres from the object's origin.
    p_m: Vec3s<S>,
    normal: Vec3s<S>,
    ao: F<S>,
    footprint_m: F<S>,
}

/// A stone, and the rays that meet it.
#[derive(Clone, Copy)]
struct Evaluation<'a, S: Simd> {
    simd: S,
    stone: &'a Stone,
    lanes: M<S>,
}

impl<S: Simd> StoneSurfaces<S> {
    /// The surface of a ray, whose unit normal is given.
    #[inline(always)]
    pub(super) fn lane(&self, lane: usize, normal: Vec3) -> StoneSurface {
        StoneSurface {
            albedo: self.albedo.lane(lane),
            f0: self.f0.lane(lane),
            alpha: Vec2::new(self.alpha.x[lane], self.alpha.y[lane]),
            tangent: tangent_of(normal),
        }
    }
}

/// The stones that the rays in `lanes` have hit; anything in the other lanes.
#[inline(always)]
pub(super) fn stones_of<S: Simd>(
    simd: S,
    frame: &FrameUniform,
    lanes: M<S>,
    hits: &Hits<S>,
    dir: Vec3s<S>,
) -> StoneSurfaces<S> {
    let zero = splat(simd, 0.0);
    let nothing = Vec3s::splat(simd, Vec3::ZERO);
    let mut surfaces = StoneSurfaces::<S> { albedo: nothing, f0: nothing, alpha: Vec2s::<S> { x: zero, y: zero } };
    let normal = unit_normal(simd, hits.normal, dir);
    let cosine = normal.dot(dir).abs().max(splat(simd, MIN_COSINE)).sqrt();
    let footprint_m = hits.distance_m * pixel_m(frame) / cosine;
    let mut left = lanes;
    while left.any_true() {
        let number = hits.stone[first_lane::<S>(left)];
        let group = left & hits.stone.simd_eq(splat_u(simd, number));
        left &= !group;
        let Some(stone) = stone_numbered(frame, number) else { continue };
        let points = StonePoints { lanes: group, p_m: hits.stone_point, normal, ao: hits.ao, footprint_m };
        let found = stone_surfaces(simd, stone, &points);
        surfaces.albedo = Vec3s::select(group, found.albedo, surfaces.albedo);
        surfaces.f0 = Vec3s::select(group, found.f0, surfaces.f0);
        surfaces.alpha.x = group.select(found.alpha.x, surfaces.alpha.x);
        surfaces.alpha.y = group.select(found.alpha.y, surfaces.alpha.y);
    }
    surfaces
}

/// [`stone_surface`](crate::cpu::stone::stone_surface).
#[inline(always)]
fn stone_surfaces<S: Simd>(simd: S, stone: &Stone, points: &StonePoints<S>) -> StoneSurfaces<S> {
    let footprint = points.footprint_m * stone.cells_per_m;
    let straight = points.p_m.map(
        #[inline(always)]
        |v| v * stone.cells_per_m,
    );
    let p = next_octave(straight, 1.0);
    let here = Evaluation { simd, stone, lanes: points.lanes };
    let [along, across] = stone.alpha;
    let plain = StoneSurfaces::<S> {
        albedo: here.colour(stone.base),
        f0: here.colour(stone.f0),
        alpha: Vec2s::<S> { x: splat(simd, along), y: splat(simd, across) },
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

/// [`wood_place`](crate::cpu::stone).
#[inline(always)]
fn wood_place<S: Simd>(straight: Vec3s<S>) -> Vec3s<S> {
    Vec3s::<S> {
        x: straight.z * FIBRE_LENGTH,
        y: (straight.x - straight.y) * FIBRE_WIDTH,
        z: (straight.x * straight.x + straight.y * straight.y).sqrt(),
    }
}

impl<S: Simd> Evaluation<'_, S> {
    #[inline(always)]
    fn colour(&self, rgb: [f32; 3]) -> Vec3s<S> {
        Vec3s::splat(self.simd, rgb.into())
    }

    #[inline(always)]
    fn mix(&self, a: Vec3s<S>, b: [f32; 3], share: F<S>) -> Vec3s<S> {
        lerp3(self.simd, a, self.colour(b), share)
    }

    #[inline(always)]
    fn faded_noise(&self, p: Vec3s<S>, footprint: F<S>) -> Noises<S> {
        let share = octave_share(self.simd, footprint);
        let is_left = self.lanes & share.simd_gt(splat(self.simd, 0.0));
        let found = noise_where(self.simd, is_left, p);
        Noises { slope: found.slope.scale(share), value: found.value * share }
    }

    #[inline(always)]
    fn fbm(&self, p: Vec3s<S>, count: u32, persistence: f32, footprint: F<S>) -> NoiseSums<S> {
        let octaves = Octaves { count, persistence, is_folded: false };
        sum_octaves(self.simd, self.lanes, p, octaves, footprint)
    }

    #[inline(always)]
    fn marble(&self, straight: Vec3s<S>, footprint: F<S>) -> Vec3s<S> {
        let (simd, stone) = (self.simd, self.stone);
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let p = straight.mul(Vec3s::splat(simd, Vec3::new(VEIN_STRETCH, 1.0, 1.0)));
        let slow = self.faded_noise(next_octave(p, BEND_FREQUENCY), footprint * BEND_FREQUENCY);
        let quick = self.faded_noise(next_octave(p, CRINKLE_FREQUENCY), footprint * CRINKLE_FREQUENCY);
        let places = self.fbm(next_octave(p, PLACE_FREQUENCY), 2, 0.6, footprint * PLACE_FREQUENCY);
        let crinkle = splat(simd, CRINKLE);
        let bent = p.add(slow.slope.add(quick.slope.scale(crinkle)).scale(splat(simd, stone.bend)));
        let width = (slow.value * WIDTH_VARIATION + one).max(splat(simd, MIN_WIDTH)) * stone.vein_width;
        let broad = self.veins(bent, width, footprint, BROAD_LACUNARITY);
        let fine_start = next_octave(bent, FINE_LACUNARITY);
        let fine = self.veins(fine_start, width * FINE_WIDTH, footprint * FINE_LACUNARITY, FINE_LACUNARITY);
        let strength = always(
            #[inline(always)]
            |veins: u32, blend: f32, contrast: f32| {
                if stone.veins & veins != 0 { self.ramp(zero, &places, contrast) * blend } else { zero }
            },
        );
        let tone = ((broad.1 + places.value * 2.0) * stone.variation + one).max(zero);
        let ground = self.colour(stone.base).scale(tone);
        let broad_share = broad.0 * strength(BROAD_VEINS, stone.blend[0], PLACE_CONTRAST);
        let veined = self.mix(ground, stone.vein, broad_share);
        self.mix(veined, stone.grain, fine.0 * strength(FINE_VEINS, stone.blend[1], -PLACE_CONTRAST))
    }

    /// The share that veins cover, and the sum of the noise whose zeros they are.
    #[inline(always)]
    fn veins(&self, start: Vec3s<S>, width: F<S>, start_footprint: F<S>, lacunarity: f32) -> (F<S>, F<S>) {
        let (simd, stone) = (self.simd, self.stone);
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let (mut p, mut footprint, mut amplitude) = (start, start_footprint, 1.0f32);
        let (mut share, mut cloud) = (zero, zero);
        let mean = self.vein_mean(width, zero);
        for _ in 0..stone.octaves {
            let left = octave_share(simd, footprint);
            let is_left = self.lanes & left.simd_gt(zero);
            let noise = noise_where(simd, is_left, p);
            let spread = noise.slope.dot(noise.slope).sqrt() * footprint * (1.0 + BENT_SLOPE * stone.bend);
            let above = left * (self.vein_profile(noise.value, spread, width) - self.vein_mean(width, spread));
            let vein = is_left.select(mean + above, mean);
            cloud = is_left.select(cloud + noise.value * left * amplitude, cloud);
            share += (one - share) * vein * amplitude;
            amplitude /= VEIN_FALL;
            p = next_octave(p, lacunarity);
            footprint *= lacunarity;
        }
        (share, cloud)
    }

    #[inline(always)]
    fn vein_mean(&self, width: F<S>, spread: F<S>) -> F<S> {
        let (simd, one) = (self.simd, splat(self.simd, 1.0));
        let bend = splat(simd, NOISE_DENSITY_BEND / (24.0 * NOISE_DENSITY));
        let density = splat(simd, NOISE_DENSITY) / (one - bend * spread * spread);
        let curved = splat(simd, NOISE_DENSITY_BEND) * width * width * 8.0 / 105.0;
        width * (density * 16.0 / 15.0 + curved)
    }

    #[inline(always)]
    fn vein_profile(&self, noise: F<S>, spread: F<S>, width: F<S>) -> F<S> {
        let half = (spread / width).max(splat(self.simd, 0.02)) * 0.5;
        let middle = noise / width;
        (self.vein_integral(middle + half) - self.vein_integral(middle - half)) / (half * 2.0)
    }

    #[inline(always)]
    fn vein_integral(&self, at: F<S>) -> F<S> {
        let one = splat(self.simd, 1.0);
        let u = at.max(-one).min(one);
        let square = u * u;
        u * (square * (square * 0.2 - 2.0 / 3.0) + one)
    }

    #[inline(always)]
    fn granite(&self, p: Vec3s<S>, footprint: F<S>) -> Vec3s<S> {
        let (simd, stone) = (self.simd, self.stone);
        let bend = self.faded_noise(next_octave(p, GRAIN_BEND_FREQUENCY), footprint * GRAIN_BEND_FREQUENCY);
        let bent = p.add(bend.slope.scale(splat(simd, stone.bend)));
        let large = self.grains(bent, footprint, stone.blend[0]);
        let mica = self.grains(next_octave(bent, MICA_FREQUENCY), footprint * MICA_FREQUENCY, stone.blend[1]);
        let specks = self.fbm(p, stone.octaves, GRANITE_PERSISTENCE, footprint);
        let tone = ((large.y + specks.value * 2.0) * stone.variation + 1.0).max(splat(simd, 0.0));
        let ground = self.mix(self.colour(stone.base), stone.vein, large.x).scale(tone);
        self.mix(ground, stone.grain, mica.x)
    }

    #[inline(always)]
    fn grains(&self, p: Vec3s<S>, footprint: F<S>, share: f32) -> Vec2s<S> {
        let simd = self.simd;
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let left = octave_share(simd, footprint * GRAIN_FOOTPRINT);
        let mean = Vec2s::<S> { x: splat(simd, share), y: zero };
        let is_left = self.lanes & left.simd_gt(zero);
        if is_left.all_false() {
            return mean;
        }
        let ([x, y, z], f) = cells_of::<S>(p);
        let least = Vec3s::splat(simd, Vec3::new(share, 0.0, 1.0) * 1e-9);
        let (mut sharp, mut soft) = (least, least);
        for i in 0..9 {
            let (east, north) = (i % 3 - 1, i / 3 - 1);
            let column = scramble::<S>(scramble::<S>(x + word(simd, east)) + (y + word(simd, north)));
            for k in -1..=1 {
                let hash = scramble::<S>(column + (z + word(simd, k)));
                let place = Vec3s::splat(simd, Vec3::new(east as f32, north as f32, k as f32));
                let point = parts_of::<S>(hash).map(
                    #[inline(always)]
                    |v| v / 1023.0,
                );
                let apart = place.sub(f).add(point);
                let near = one - apart.dot(apart);
                let is_near = near.simd_gt(zero);
                let of_cell = scramble::<S>(hash ^ 0x5bd1_e995);
                let is_of_share = float_u::<S>(of_cell & 0xffff).simd_lt(splat(simd, share * 65_536.0));
                let tone = float_u::<S>(of_cell >> 16) / 65_535.0 - 0.5;
                let value = Vec3s::<S> { x: one_where(simd, is_of_share), y: tone, z: one };
                let square = near * near;
                let eighth = square * square * square * square;
                let weight = eighth * eighth;
                soft = Vec3s::select(is_near, soft.add(value.scale(weight)), soft);
                let weight = weight * weight * weight * weight;
                sharp = Vec3s::select(is_near, sharp.add(value.scale(weight)), sharp);
            }
        }
        let softness = (footprint * 8.0).min(one);
        let found = always(
            #[inline(always)]
            |sharp_part: F<S>, soft_part: F<S>, mean: F<S>| {
                let found = lerp(simd, sharp_part / sharp.z, soft_part / soft.z, softness);
                is_left.select(lerp(simd, mean, found, left), mean)
            },
        );
        Vec2s { x: found(sharp.x, soft.x, mean.x), y: found(sharp.y, soft.y, mean.y) }
    }

    #[inline(always)]
    fn bronze(&self, bare: &StoneSurfaces<S>, straight: Vec3s<S>, exposure: F<S>, footprint: F<S>) -> StoneSurfaces<S> {
        let (simd, stone) = (self.simd, self.stone);
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let p = next_octave(straight.mul(Vec3s::splat(simd, Vec3::new(1.0, 1.0, PATINA_HEIGHT))), 1.0);
        let patches = self.fbm(p, stone.octaves, 0.65, footprint);
        let patina = self.ramp(exposure + (stone.blend[0] - 0.5), &patches, PATINA_NOISE * stone.variation);
        let octaves = Octaves { count: stone.octaves.min(3), persistence: 0.75, is_folded: true };
        let creases = sum_octaves(simd, self.lanes, next_octave(p, 2.7), octaves, footprint * 2.7).value;
        let thin = ((creases * PATINA_CREASES + one) * stone.blend[1]).max(zero).min(one);
        let tarnish = (one - creases * PATINA_TARNISH).max(zero).min(splat(simd, 1.3));
        let green = self.mix(self.colour(stone.vein), stone.grain, thin);
        let alpha = splat(simd, PATINA_ALPHA);
        StoneSurfaces {
            albedo: lerp3(simd, bare.albedo, green, patina),
            f0: self.mix(bare.f0.scale(tarnish), [PATINA_F0; 3], patina),
            alpha: Vec2s { x: lerp(simd, bare.alpha.x, alpha, patina), y: lerp(simd, bare.alpha.y, alpha, patina) },
        }
    }

    #[inline(always)]
    fn ramp(&self, at: F<S>, noise: &NoiseSums<S>, strength: f32) -> F<S> {
        let middle = (at + noise.value * strength) / (2.0 * RAMP_RANGE) + 0.5;
        let half = ((noise.hidden * 6.0).sqrt() * strength.abs() / (2.0 * RAMP_RANGE)).max(splat(self.simd, 0.1));
        let sides = self.ramp_integral(middle + half) + self.ramp_integral(middle - half);
        (sides - self.ramp_integral(middle) * 2.0) / (half * half)
    }

    #[inline(always)]
    fn ramp_integral(&self, at: F<S>) -> F<S> {
        let (zero, one) = (splat(self.simd, 0.0), splat(self.simd, 1.0));
        let (u, above) = (at.max(zero).min(one), (at - one).max(zero));
        u * u * u / 6.0 + above * 0.5 * (above + one)
    }

    #[inline(always)]
    fn limestone(&self, straight: Vec3s<S>, footprint: F<S>) -> Vec3s<S> {
        let (simd, stone) = (self.simd, self.stone);
        let zero = splat(simd, 0.0);
        let slow = self.faded_noise(next_octave(straight, 0.2), footprint * 0.2).value;
        let flat = straight.mul(Vec3s::splat(simd, Vec3::new(BED_FLATNESS, BED_FLATNESS, 1.0)));
        // What is added is 0 in x and y.
        let flat = Vec3s::<S> { x: flat.x + 0.37, y: flat.y + 0.37, z: flat.z + slow * stone.bend + 0.37 };
        let beds = self.fbm(flat, 3, 0.7, footprint);
        let start = next_octave(straight, LIMESTONE_GRAINS);
        let grains = self.fbm(start, stone.octaves, 0.85, footprint * LIMESTONE_GRAINS);
        let ground = self.colour(stone.base).scale(slow * stone.variation + 1.0);
        let bedded = self.mix(ground, stone.vein, self.ramp(zero, &beds, 1.0) * stone.blend[0]);
        self.mix(bedded, stone.grain, self.ramp(splat(simd, -0.08), &grains, 1.5) * stone.blend[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::instruction_set::InstructionSet;
    use crate::cpu::stone::stone_surface;
    use crate::stone::PRESETS;
    use fearless_simd::Level;
    use insula_test_support::rng::Rng;

    /// Values of all rays.
    fn lanes<S: Simd>(simd: S, mut value: impl FnMut() -> f32) -> F<S> {
        F::<S>::from_fn(simd, |_| value())
    }

    fn compare<S: Simd>(simd: S, what: &str) {
        let mut rng = Rng::new(9);
        for (name, stone) in &PRESETS {
            for round in 0..400 {
                let mut between = |low: f64, high: f64| rng.range(low, high) as f32;
                let footprint = f64::from(round) / 400.0;
                let points = StonePoints::<S> {
                    lanes: M::<S>::splat(simd, true),
                    p_m: Vec3s::<S> {
                        x: lanes(simd, || between(-40.0, 40.0)),
                        y: lanes(simd, || between(-40.0, 40.0)),
                        z: lanes(simd, || between(-5.0, 30.0)),
                    },
                    normal: Vec3s::<S> {
                        x: lanes(simd, || between(-1.0, 1.0)),
                        y: lanes(simd, || between(-1.0, 1.0)),
                        z: lanes(simd, || between(-1.0, 1.0)),
                    },
                    ao: lanes(simd, || between(0.0, 1.0)),
                    // From less than a grain to more than a vein, also in the same packet.
                    footprint_m: lanes(simd, || 10f32.powf(between(-4.0, -3.0 + 3.0 * footprint))),
                };
                let found = simd.vectorize(
                    #[inline(always)]
                    || stone_surfaces(simd, stone, &points),
                );
                for lane in 0..F::<S>::LEN {
                    let normal = points.normal.lane(lane);
                    let (p_m, ao, footprint_m) = (points.p_m.lane(lane), points.ao[lane], points.footprint_m[lane]);
                    let expected = stone_surface(stone, p_m, normal, ao, footprint_m);
                    assert_eq!(found.lane(lane, normal), expected, "{name} at {p_m}, {footprint_m} m, {what}");
                }
            }
        }
    }

    #[test]
    fn packets_of_stones_are_those_of_single_points() {
        for set in InstructionSet::all() {
            // Some machines have one instruction set.
            #[allow(unreachable_patterns)]
            match set.level() {
                #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
                Level::Avx512(simd) => compare(simd, set.name()),
                #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
                Level::Avx2(simd) => compare(simd, set.name()),
                #[cfg(target_arch = "aarch64")]
                Level::Neon(simd) => compare(simd, set.name()),
                _ => {}
            }
        }
    }
}
