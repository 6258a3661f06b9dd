//! Light on the surfaces that the rays of a packet hit. The scalar code is [`shade`](crate::cpu::shade).
//!
//! Only surfaces without stones, reflections and lit windows in [`Shading::Lit`](crate::layout::Shading::Lit).

use super::hits::Hits;
use super::lanes::{F, FastExtremes, U, Vec3s, always, float_u, splat, to_u};
use crate::cpu::fast_math::{EXP_HIGH, EXP_LOW, EXP_MIN};
use crate::cpu::sea::{BARE_NORMAL_Z, BARE_TOLERANCE};
use crate::cpu::shade::{
    FACADE_DEPTH, FACADES_BY_GROUND, FACADES_BY_WALL, GROUND_DEPTH, LEVEL_SLOPE, POWER_HIGH, POWER_LOW, ZENITH_SHARE,
};
use crate::layout::FrameUniform;
use fearless_simd::prelude::*;
use glam::Vec3;

/// [`Radiance`](crate::cpu::shade::Radiance) of each ray.
#[derive(Clone, Copy)]
pub(super) struct Radiances<S: Simd> {
    pub(super) sky: Vec3s<S>,
    pub(super) sun: Vec3s<S>,
}

/// Linear RGB of texels.
#[inline(always)]
pub(super) fn linear_of<S: Simd>(simd: S, texel: U<S>) -> Vec3s<S> {
    let channel = always(
        #[inline(always)]
        |shift: u32| {
            let v = float_u::<S>((texel >> shift) & 255) / 255.0;
            let x = (v + 0.055) / 1.055;
            let power =
                horner(simd, x, [POWER_HIGH.z, POWER_HIGH.y, POWER_HIGH.x, POWER_LOW.z, POWER_LOW.y, POWER_LOW.x]);
            v.simd_le(splat(simd, 0.04045)).select(v / 12.92, power)
        },
    );
    Vec3s::<S> { x: channel(0), y: channel(8), z: channel(16) }
}

/// A polynomial, its highest power first.
#[inline(always)]
fn horner<S: Simd, const N: usize>(simd: S, x: F<S>, factors: [f32; N]) -> F<S> {
    let mut sum = splat(simd, factors[0]);
    for factor in &factors[1..] {
        sum = sum * x + *factor;
    }
    sum
}

/// [`exp`](crate::cpu::fast_math::exp).
#[inline(always)]
pub(super) fn exp<S: Simd>(simd: S, v: F<S>) -> F<S> {
    let y = (v * std::f32::consts::LOG2_E).fast_max(splat(simd, EXP_MIN)).fast_min(splat(simd, -EXP_MIN));
    let whole = y.floor();
    let f = y - whole;
    let power = horner(simd, f, [EXP_HIGH.z, EXP_HIGH.y, EXP_HIGH.x, EXP_LOW.z, EXP_LOW.y, EXP_LOW.x]);
    let exponent = to_u::<S>((whole + 127.0).to_int());
    power * (exponent << 23).bitcast::<F<S>>()
}

/// Unit normals, or against the rays.
#[inline(always)]
pub(super) fn unit_normal<S: Simd>(simd: S, normal: Vec3s<S>, dir: Vec3s<S>) -> Vec3s<S> {
    normalize_or(
        simd,
        normal,
        dir.map(
            #[inline(always)]
            |v| -v,
        ),
    )
}

#[inline(always)]
pub(super) fn normalize_or<S: Simd>(simd: S, v: Vec3s<S>, fallback: Vec3s<S>) -> Vec3s<S> {
    let recip = splat(simd, 1.0) / v.dot(v).sqrt();
    let is_some = recip.simd_lt(splat(simd, f32::INFINITY)) & recip.simd_gt(splat(simd, 0.0));
    Vec3s::select(is_some, v.scale(recip), fallback)
}

/// [`lit_normal`](crate::cpu::shade::lit_normal) of surfaces with unit normals `n`.
#[inline(always)]
pub(super) fn lit_normals<S: Simd>(simd: S, frame: &FrameUniform, albedo: Vec3s<S>, n: Vec3s<S>) -> Vec3s<S> {
    if frame.light.grade[0] <= 0.0 {
        return n;
    }
    let near = always(
        #[inline(always)]
        |v: F<S>, of: f32| (v - of).abs().simd_le(splat(simd, BARE_TOLERANCE)),
    );
    let [r, g, b, _] = frame.light.plane;
    let is_bare = near(albedo.x, r) & near(albedo.y, g) & near(albedo.z, b);
    let is_ground = is_bare & n.z.simd_ge(splat(simd, BARE_NORMAL_Z));
    let flat = (n.x * n.x + n.y * n.y).sqrt().fast_max(splat(simd, 1e-6));
    let kept = (splat(simd, 1.0) - n.z * LEVEL_SLOPE / flat).fast_max(splat(simd, 0.0));
    let lit = Vec3s::<S> { x: n.x * kept, y: n.y * kept, z: n.z };
    Vec3s::select(is_ground, lit.scale(splat(simd, 1.0) / lit.dot(lit).sqrt()), n)
}

/// Light that the surfaces reflect, with unit normals `n`.
#[inline(always)]
pub(super) fn reflected<S: Simd>(simd: S, frame: &FrameUniform, hits: &Hits<S>, n: Vec3s<S>) -> Radiances<S> {
    let (light, ao) = (&frame.light, hits.ao);
    let (zero, one, half) = (splat(simd, 0.0), splat(simd, 1.0), splat(simd, 0.5));
    let upright = n.z.abs();
    let open = (ao / (upright * 0.5 + 0.5)).fast_min(one);
    let ahead = n.x * light.side[0] + n.y * light.side[1];
    let below = half - n.z * 0.5;
    // As `light_from_city`.
    let (reach, deep) = (open * light.sun_tan, one - open + 1e-6);
    let ground_share = reach / (reach + deep * GROUND_DEPTH);
    let far = reach * reach.sqrt();
    let sunlit = far / (far + deep * FACADE_DEPTH * deep) * (half - ahead * 0.5);
    let facade_share =
        (upright * (FACADES_BY_GROUND - FACADES_BY_WALL) + FACADES_BY_WALL) * (one - ao - below).fast_max(zero);
    let sun = Vec3::from(frame.sun);
    let facing = (n.x * sun.x + n.y * sun.y + n.z * sun.z).fast_max(zero);
    let sun_share = if frame.shadow_m > 0.0 { one } else { (ao * 2.0 + 0.25).fast_min(one) };
    let channel = always(
        #[inline(always)]
        |i: usize, albedo: F<S>| {
            let [up, sky_wall, wall_ahead, axis] =
                [light.sky_up[i], light.sky_wall[i], light.sky_wall_ahead[i], light.sky_wall_axis[i]];
            let wall = ahead * wall_ahead + sky_wall + ahead * ahead * axis;
            let overhead = up * ZENITH_SHARE;
            let sky = ((wall - overhead) * open + overhead) * (one - upright) + upright * up;
            let ground = ground_share * light.ground_sun[i] + light.ground_sky[i];
            let facades = sunlit * light.facade_sun[i] + light.facade_sky[i] + ground * light.facade_ground;
            let returned = ground * below + facades * facade_share;
            let sky = albedo * (sky * ao + returned);
            (sky, albedo * (facing * light.sun[i]) * sun_share)
        },
    );
    let [(rs, ru), (gs, gu), (bs, bu)] =
        [channel(0, hits.albedo.x), channel(1, hits.albedo.y), channel(2, hits.albedo.z)];
    Radiances::<S> { sky: Vec3s::<S> { x: rs, y: gs, z: bs }, sun: Vec3s::<S> { x: ru, y: gu, z: bu } }
}

/// Light from `distance_m` away, as it arrives at the eye through air that sends `airlight`.
#[inline(always)]
pub(super) fn apply_haze<S: Simd>(
    simd: S,
    frame: &FrameUniform,
    light: &Radiances<S>,
    (dir, airlight): (Vec3s<S>, Vec3s<S>),
    distance_m: F<S>,
) -> Radiances<S> {
    let [r, g, b, _] = frame.light.haze;
    let fog = fog_depth(simd, frame, dir, distance_m);
    let transmitted = Vec3s::<S> { x: distance_m * -r - fog, y: distance_m * -g - fog, z: distance_m * -b - fog }.map(
        #[inline(always)]
        |v| exp(simd, v),
    );
    Radiances::<S> { sky: airlight.add(light.sky.sub(airlight).mul(transmitted)), sun: light.sun.mul(transmitted) }
}

/// Optical depth of the fog in directions `dir`.
#[inline(always)]
fn fog_depth<S: Simd>(simd: S, frame: &FrameUniform, dir: Vec3s<S>, distance_m: F<S>) -> F<S> {
    let zero = splat(simd, 0.0);
    let [start_m, density, fade, _] = frame.fog;
    let [west, south, east, north] = frame.city;
    let far = (distance_m - start_m).fast_max(zero) * density;
    let past = always(
        #[inline(always)]
        |place: F<S>, low: f32, high: f32| (splat(simd, low) - place).fast_max(place - high).fast_max(zero) * fade,
    );
    let (x, y) = (past(dir.x * distance_m, west, east), past(dir.y * distance_m, south, north));
    let away = (x * x + y * y).sqrt();
    far * far.sqrt().sqrt() + away * away.sqrt()
}
