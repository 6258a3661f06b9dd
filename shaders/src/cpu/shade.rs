//! Light on a surface and from the sky. GPU twin: `shade.wgsl`.
//!
//! Only [`Shading::Lit`] has light and haze; the other shadings show what is baked.

use super::fast_math::exp;
use super::night::{BAYS_PER_M, moon, stars};
use super::noise::fbm;
use super::sea::{BARE_NORMAL_Z, BARE_TOLERANCE, SEA_FADE, sea_share};
pub use super::surface::SurfaceSample;
use super::surface::rgb;
use crate::atmosphere::{MIE_G, PHASE_SCALE};
use crate::lanes::{F, I, LaneFloats, LaneInts, LaneMask, LaneWords, Lanes, M, OneLane, U, Vec3s, always};
use crate::layout::{FrameUniform, Light, MESH_FLAG, MESH_LEVEL, SKY_AZIMUTHS, SKY_HEIGHTS, Shading, SkyTable};
use crate::light::SKY_LOW;
pub(crate) use crate::srgb::{POWER_HIGH, POWER_LOW};
pub use crate::srgb::{encode_srgb, linear_of};
use glam::Vec3;
use insula_protocol::blockmap::flag;

/// The sky at the horizon behind baked values, linear RGB.
pub(crate) const HORIZON: Vec3 = Vec3::new(0.72, 0.80, 0.88);
/// The sky at the zenith behind baked values, linear RGB.
pub(crate) const ZENITH: Vec3 = Vec3::new(0.20, 0.38, 0.68);
/// The plane where there is no column, behind baked values, linear RGB.
pub(crate) const GROUND: Vec3 = Vec3::new(0.36, 0.37, 0.35);
/// Distance in metres at which half of the plane has become horizon, behind baked values.
pub(crate) const GROUND_FADE_M: f32 = 3000.0;
/// Distance in metres from which the plane vanishes faster in haze than a city would, and how much faster: nobody knows what is
/// there, and an endless plane would end in a grey band below the horizon.
pub(crate) const PLANE_CLEAR_M: f32 = 7000.0;
pub(crate) const PLANE_FADE: f32 = 5.0;
/// Least descent of a ray, per metre, that meets the plane.
pub(crate) const MIN_GROUND_DESCENT: f32 = 1e-5;
/// Squared radius on the unit sphere at which the sun's disc begins to fade.
pub(crate) const DISC_INNER: f32 = 1.7e-5;
/// Squared radius on the unit sphere at which the sun's disc ends.
pub(crate) const DISC_OUTER: f32 = 3.2e-5;
/// Brightness of the sun's disc.
pub(crate) const DISC: f32 = 40.0;
/// Weight of facades in the part of a wall's, and of the ground's, surroundings that is neither sky nor ground.
pub(crate) const FACADES_BY_WALL: f32 = 1.1;
pub(crate) const FACADES_BY_GROUND: f32 = 0.8;
/// Share of the open sky's light that reaches a wall from straight above, where the horizon is hidden.
pub(crate) const ZENITH_SHARE: f32 = 0.17;
/// Tangent of the sun's height at which it reaches half of the ground of a street that sees half of the sky.
pub(crate) const GROUND_DEPTH: f32 = 0.26;
/// How fast facades lose the sun as a street becomes deeper. In a deep street a low sun reaches their tops only, which walls and
/// ground see at flat angles, so its share falls faster than the lit area.
pub(crate) const FACADE_DEPTH: f32 = 1.1;
/// Reflectance of glass seen from straight ahead (Schlick's approximation of Fresnel's equations).
pub(crate) const FACING_REFLECTANCE: f32 = 0.03;
/// Reflectance of water: seen from straight ahead, and what it has more at a flat angle. Waves keep it below that of a mirror.
pub(crate) const FACING_WATER: f32 = 0.025;
pub(crate) const FLAT_WATER: f32 = 0.62;
/// Share by which waves change the cosine at which water is seen, how long the longest are, in bays, and where they end.
pub(crate) const WAVE_TILT: f32 = 0.9;
pub(crate) const WAVES_PER_BAY: f32 = 3.2 / 23.0;
pub(crate) const WAVES_END_M: f32 = 3000.0;
/// Angles in radians by which waves and panes spread the sun's reflection.
pub(crate) const WAVES: f32 = 0.07;
pub(crate) const PANES: f32 = 0.03;
/// Rise per metre up to which generated ground counts as level. Its corners lie at least eight cells apart, follow the feet of walls
/// within 0.4 m and are rounded to quarters of a cell: 0.65 m on 8 m, with cells of 1 m. A low sun would show each such triangle.
pub(crate) const LEVEL_SLOPE: f32 = 0.08;
/// Colours of [`Shading::Kind`].
pub(crate) const TINT_ROOF: Vec3 = Vec3::new(0.55, 0.55, 0.55);
pub(crate) const TINT_MESH: Vec3 = Vec3::new(0.50, 0.30, 0.80);
pub(crate) const TINT_GAP: Vec3 = Vec3::new(0.85, 0.15, 0.12);
pub(crate) const TINT_SUSPENDED: Vec3 = Vec3::new(0.15, 0.35, 0.90);
pub(crate) const TINT_EXPOSED: Vec3 = Vec3::new(0.90, 0.50, 0.12);
pub(crate) const TINT_INCLINED: Vec3 = Vec3::new(0.20, 0.75, 0.25);

/// Linear RGB on its way to the eye. The sun's part is separate until it is known whether the sun is visible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Radiance {
    /// Light from sky, ground and walls.
    pub sky: Vec3,
    /// Light from the sun, if it is visible.
    pub sun: Vec3,
}

impl Radiance {
    fn unlit(sky: Vec3) -> Self {
        Self { sky, sun: Vec3::ZERO }
    }
}

/// [`Radiance`] of each ray.
#[derive(Clone, Copy)]
pub(super) struct Radiances<S: Lanes> {
    pub(super) sky: Vec3s<S>,
    pub(super) sun: Vec3s<S>,
}

impl<S: Lanes> Radiances<S> {
    #[inline(always)]
    pub(super) fn splat(simd: S, light: &Radiance) -> Self {
        Self { sky: Vec3s::splat(simd, light.sky), sun: Vec3s::splat(simd, light.sun) }
    }
}

impl From<Radiances<OneLane>> for Radiance {
    #[inline(always)]
    fn from(light: Radiances<OneLane>) -> Self {
        Self { sky: light.sky.into(), sun: light.sun.into() }
    }
}

/// Radiance of a surface under the frame's shading, before haze.
pub fn shade(frame: &FrameUniform, surface: &SurfaceSample) -> Radiance {
    let SurfaceSample { albedo, ao, normal: n, .. } = *surface;
    let debug = |tint: Vec3| tint * (0.35 + 0.65 * ao) * (0.7 + 0.3 * n.dot(Vec3::from(frame.sun)).max(0.0));
    match frame.shading {
        s if s == Shading::Albedo as u32 => Radiance::unlit(albedo),
        s if s == Shading::Ao as u32 => Radiance::unlit(Vec3::splat(ao)),
        s if s == Shading::Normal as u32 => Radiance::unlit(n * 0.5 + 0.5),
        s if s == Shading::Lod as u32 || s == Shading::Bounds as u32 => {
            Radiance::unlit(debug(level_tint(surface.level)))
        }
        s if s == Shading::Wire as u32 || s == Shading::Triangles as u32 => {
            Radiance::unlit(debug(if surface.flags & MESH_FLAG != 0 { albedo } else { TINT_ROOF }))
        }
        s if s == Shading::Kind as u32 => Radiance::unlit(debug(kind_tint(surface.flags))),
        _ => reflected(frame, albedo, n, ao),
    }
}

/// The unit normal by which a surface with this albedo is lit. In graded pictures bare ground has [`LEVEL_SLOPE`] less of a slope, at
/// least none, so that what is level has no facets, and what is steeper no border.
pub(super) fn lit_normal(frame: &FrameUniform, albedo: Vec3, normal: Vec3) -> Vec3 {
    lit_normals(OneLane, frame, albedo.into(), normal.into()).into()
}

/// The same of surfaces with unit normals `n`.
#[inline(always)]
pub(super) fn lit_normals<S: Lanes>(simd: S, frame: &FrameUniform, albedo: Vec3s<S>, n: Vec3s<S>) -> Vec3s<S> {
    if frame.light.grade[0] <= 0.0 || frame.shading != Shading::Lit as u32 {
        return n;
    }
    let apart = (albedo - Vec3s::splat(simd, rgb(frame.light.plane))).map(always!(|v: F<S>| v.abs())).max_element();
    let is_ground = apart.at_or_below(BARE_TOLERANCE) & n.z.at_or_above(BARE_NORMAL_Z);
    let flat = (n.x * n.x + n.y * n.y).sqrt().at_least(1e-6);
    let kept = (n.z * LEVEL_SLOPE / flat).rest().at_least(0.0);
    let lit = Vec3s::<S>::new(n.x * kept, n.y * kept, n.z);
    Vec3s::select(is_ground, lit.scale(simd.splat(1.0) / lit.dot(lit).sqrt()), n)
}

/// Light that a surface reflects.
pub(super) fn reflected(frame: &FrameUniform, albedo: Vec3, n: Vec3, ao: f32) -> Radiance {
    reflections(OneLane, frame, (albedo.into(), n.into(), ao)).into()
}

/// The same of surfaces with an albedo, a unit normal and a share of the sky.
#[inline(always)]
pub(super) fn reflections<S: Lanes>(
    simd: S,
    frame: &FrameUniform,
    (albedo, n, ao): (Vec3s<S>, Vec3s<S>, F<S>),
) -> Radiances<S> {
    let light = &frame.light;
    let colour = always!(|v: [f32; 4]| Vec3s::splat(simd, rgb(v)));
    let (up, upright) = (colour(light.sky_up), n.z.abs());
    // Openness of the surroundings: 1 for a wall or a roof without neighbours.
    let open = (ao / (upright * 0.5 + 0.5)).at_most(1.0);
    let ahead = n.x * light.side[0] + n.y * light.side[1];
    let wall = colour(light.sky_wall)
        + colour(light.sky_wall_ahead).scale(ahead)
        + colour(light.sky_wall_axis).scale(ahead * ahead);
    let overhead = up * ZENITH_SHARE;
    let sky = (overhead + (wall - overhead).scale(open)).lerp(up, upright).scale(ao);
    let below = simd.splat(0.5) - n.z * 0.5;
    let returned = light_from_city(simd, light, &Surroundings { open, below, ahead, upright }, ao);
    let facing = n.dot(Vec3s::splat(simd, frame.sun.into())).at_least(0.0);
    let sun = albedo * colour(light.sun).scale(facing);
    let share = if frame.shadow_m > 0.0 { simd.splat(1.0) } else { sun_shares_by_sky::<S>(ao) };
    Radiances { sky: albedo * (sky + returned), sun: sun.scale(share) }
}

/// Light of a surface of water or glass that is seen in direction `dir`: `light` below its reflection of sky, sun and city.
pub(super) fn mirrored(
    frame: &FrameUniform,
    light: Radiance,
    surface: &SurfaceSample,
    (dir, distance_m): (Vec3, f32),
) -> Radiance {
    let (n, of_light) = (surface.normal, &frame.light);
    let cosine = (-dir.dot(n)).clamp(0.0, 1.0);
    let upright = n.z.abs();
    let is_water = upright > 0.5;
    let seen_at = if is_water { (cosine + cosine * waves(frame, dir, distance_m) + 0.03).min(1.0) } else { cosine };
    let grazing = 1.0 - seen_at;
    let cube = grazing * grazing * grazing;
    let share = if is_water {
        FACING_WATER + FLAT_WATER * cube * grazing.sqrt()
    } else {
        FACING_REFLECTANCE + (1.0 - FACING_REFLECTANCE) * cube * grazing * grazing
    };
    let towards = dir + n * (cosine + seen_at);
    let open = (surface.ao / (0.5 + 0.5 * upright)).min(1.0);
    let [ground, above] = reflected_light(frame, towards, open);
    let seen = if towards.z > 0.0 { above } else { ground };
    let spread = PANES + (WAVES - PANES) * upright;
    let glint = (-from_sun(OneLane, frame, towards.into()) / (spread * spread)).exp() / (spread * spread);
    Radiance {
        sky: light.sky + (seen - light.sky) * share,
        sun: light.sun * (1.0 - share) + rgb(of_light.sun) * (glint * share * sun_share_by_sky(frame, surface.ao)),
    }
}

/// How far waves tilt the water that is seen in direction `dir`, relative to the cosine at which it is seen: more than -1.
fn waves(frame: &FrameUniform, dir: Vec3, distance_m: f32) -> f32 {
    let near = 1.0 - distance_m / WAVES_END_M;
    if near <= 0.0 {
        return 0.0;
    }
    let [east, north, up, pixel] = frame.bays;
    let place = (dir * (distance_m * BAYS_PER_M) + Vec3::new(east, north, up)) * WAVES_PER_BAY;
    let footprint = distance_m * pixel * (BAYS_PER_M * WAVES_PER_BAY);
    fbm(OneLane, true, place.into(), 3, 0.6, footprint).value * (WAVE_TILT * near)
}

/// Light that a mirror reflects from below and from above the horizon in direction `towards`. `open`: the openness of its surroundings.
pub(super) fn reflected_light(frame: &FrameUniform, towards: Vec3, open: f32) -> [Vec3; 2] {
    let light = &frame.light;
    let city = rgb(light.facade_sky) + rgb(light.facade_sun) * (0.25 * open);
    let ground = rgb(light.ground_sky) + rgb(light.ground_sun) * open;
    [ground, city + (Vec3::from(sky(OneLane, frame, towards.into())) - city) * open]
}

/// What a surface is turned to.
struct Surroundings<S: Lanes> {
    /// Openness: 1 without neighbours.
    open: F<S>,
    /// Share of its hemisphere below the horizon.
    below: F<S>,
    /// Cosine to the sun's azimuth.
    ahead: F<S>,
    /// 1 for level surfaces, 0 for walls.
    upright: F<S>,
}

/// Light that ground and facades return to a surface. The deeper the street, the less of them the sun reaches. Facades opposite
/// a wall that is turned away from the sun are those in the sun.
#[inline(always)]
fn light_from_city<S: Lanes>(simd: S, light: &Light, around: &Surroundings<S>, ao: F<S>) -> Vec3s<S> {
    let colour = always!(|v: [f32; 4]| Vec3s::splat(simd, rgb(v)));
    let (reach, deep) = (around.open * light.sun_tan, around.open.rest() + 1e-6);
    let ground = colour(light.ground_sun).scale(reach / (reach + deep * GROUND_DEPTH)) + colour(light.ground_sky);
    let far = reach * reach.sqrt();
    let sunlit = far / (far + deep * FACADE_DEPTH * deep) * (simd.splat(0.5) - around.ahead * 0.5);
    let facades = colour(light.facade_sun).scale(sunlit) + colour(light.facade_sky) + ground * light.facade_ground;
    let share = around.upright * (FACADES_BY_GROUND - FACADES_BY_WALL) + FACADES_BY_WALL;
    ground.scale(around.below) + facades.scale(share * (ao.rest() - around.below).at_least(0.0))
}

/// Without shadow rays: a surface that sees little sky sees little sun. A wall in the open sees half of the sky.
pub(super) fn sun_share_by_sky(frame: &FrameUniform, ao: f32) -> f32 {
    if frame.shadow_m > 0.0 { 1.0 } else { sun_shares_by_sky::<OneLane>(ao) }
}

#[inline(always)]
fn sun_shares_by_sky<S: Lanes>(ao: F<S>) -> F<S> {
    (ao * 2.0 + 0.25).at_most(1.0)
}

/// The sky low above the horizon in a ray's direction: the light that haze adds.
#[derive(Debug, Clone, Copy)]
pub struct Airlight {
    pub(super) rgb: Vec3,
}

impl Airlight {
    /// The air's light in direction `dir`.
    pub fn new(frame: &FrameUniform, dir: Vec3) -> Self {
        Self { rgb: airlight(OneLane, frame, dir.into()).into() }
    }
}

/// The air's light in directions `dir`.
#[inline(always)]
pub(super) fn airlight<S: Lanes>(simd: S, frame: &FrameUniform, dir: Vec3s<S>) -> Vec3s<S> {
    let (columns, length) = SkyColumns::new(frame, dir);
    let row = simd.splat_i(0);
    let (smooth, forward) = (columns.read(simd, &frame.light.sky, row), columns.read(simd, &frame.light.glow, row));
    let level = Vec3s::new(dir.x / length, dir.y / length, simd.splat(SKY_LOW));
    smooth + forward.scale(phase(simd, frame, level))
}

/// Light from `distance_m` away in direction `dir`, which is that of `airlight`, as it arrives at the eye.
pub fn apply_haze(
    frame: &FrameUniform,
    light: Radiance,
    (dir, airlight): (Vec3, &Airlight),
    distance_m: f32,
) -> Radiance {
    apply_haze_fading(frame, light, (dir, airlight), (distance_m, 1.0))
}

/// The same of what fades beyond the city's ends as land does times `fade`.
pub(super) fn apply_haze_fading(
    frame: &FrameUniform,
    light: Radiance,
    (dir, airlight): (Vec3, &Airlight),
    (distance_m, fade): (f32, f32),
) -> Radiance {
    if frame.shading != Shading::Lit as u32 {
        return light;
    }
    let light = Radiances::splat(OneLane, &light);
    hazed(OneLane, frame, &light, (dir.into(), airlight.rgb.into()), (distance_m, fade)).into()
}

/// The same of each ray of a lit frame.
#[inline(always)]
pub(super) fn hazed<S: Lanes>(
    simd: S,
    frame: &FrameUniform,
    light: &Radiances<S>,
    (dir, airlight): (Vec3s<S>, Vec3s<S>),
    (distance_m, fade): (F<S>, f32),
) -> Radiances<S> {
    let fog = fog_depth(simd, frame, (dir, distance_m), fade);
    let transmitted =
        Vec3s::splat(simd, rgb(frame.light.haze)).scale(-distance_m).map(always!(|v: F<S>| exp(simd, v - fog)));
    Radiances { sky: airlight + (light.sky - airlight) * transmitted, sun: light.sun * transmitted }
}

/// Optical depth of the fog before a place. It hides what is far, and the land beyond the city's ends, or what fades as that times
/// `fade`.
#[inline(always)]
fn fog_depth<S: Lanes>(simd: S, frame: &FrameUniform, (dir, distance_m): (Vec3s<S>, F<S>), fade: f32) -> F<S> {
    let [start_m, density, land_fade, _] = frame.fog;
    let [west, south, east, north] = frame.city;
    let fade = land_fade * fade;
    let far = (distance_m - start_m).at_least(0.0) * density;
    let past =
        always!(|place: F<S>, low: f32, high: f32| (simd.splat(low) - place).max_of(place - high).at_least(0.0) * fade);
    let (x, y) = (past(dir.x * distance_m, west, east), past(dir.y * distance_m, south, north));
    let away = (x * x + y * y).sqrt();
    far * far.sqrt().sqrt() + away * away.sqrt()
}

fn level_tint(level: u32) -> Vec3 {
    let phase = (level * 5 % 8) as f32 * std::f32::consts::FRAC_PI_4;
    let strength = if level >= MESH_LEVEL { 0.2 } else { 0.4 };
    Vec3::new(phase, phase - 2.094, phase + 2.094).map(|phase| 0.95 + strength * (phase.cos() - 1.0))
}

fn kind_tint(flags: u32) -> Vec3 {
    let has = |bit: u8| flags & u32::from(bit) != 0;
    let base = if flags & MESH_FLAG != 0 {
        TINT_MESH
    } else if has(flag::GAP) || has(flag::HOLES) {
        TINT_GAP
    } else if has(flag::SUSPENDED) {
        TINT_SUSPENDED
    } else if has(flag::EXPOSED) {
        TINT_EXPOSED
    } else {
        TINT_ROOF
    };
    if has(flag::INCLINED) { base.lerp(TINT_INCLINED, 0.4) } else { base }
}

/// The sky, or the plane where there is no column, in direction `dir`, which is that of `airlight`.
pub fn background(frame: &FrameUniform, dir: Vec3, airlight: &Airlight) -> Radiance {
    let ground_m = ground_distance(frame, dir);
    if frame.shading != Shading::Lit as u32 {
        let sky = HORIZON.lerp(ZENITH, dir.z.max(0.0).sqrt());
        let near = if ground_m < f32::INFINITY { GROUND_FADE_M / (ground_m + GROUND_FADE_M) } else { 0.0 };
        return Radiance::unlit(sky.lerp(GROUND, near));
    }
    let rays = (dir.into(), airlight.rgb.into());
    if ground_m < f32::INFINITY {
        let land = plane(OneLane, frame, rays, ground_m).into();
        return coast(frame, land, sea_share(frame, None, dir * ground_m), (dir, airlight), ground_m);
    }
    Radiance::unlit(open_sky(OneLane, frame, true, rays.0).into())
}

/// Light of the plane, `ground_m` away.
#[inline(always)]
pub(super) fn plane<S: Lanes>(
    simd: S,
    frame: &FrameUniform,
    rays: (Vec3s<S>, Vec3s<S>),
    ground_m: F<S>,
) -> Radiances<S> {
    let hazy_m = ground_m + (ground_m - PLANE_CLEAR_M).at_least(0.0) * PLANE_FADE;
    let light = Radiances::splat(simd, &reflected(frame, rgb(frame.light.plane), Vec3::Z, 1.0));
    hazed(simd, frame, &light, rays, (hazy_m, 1.0))
}

/// The sky, for the rays in `lanes`.
#[inline(always)]
pub(super) fn open_sky<S: Lanes>(simd: S, frame: &FrameUniform, lanes: M<S>, dir: Vec3s<S>) -> Vec3s<S> {
    sky(simd, frame, dir) + celestial_light(simd, frame, lanes, dir)
}

/// Light of a place `distance_m` away, of which `share` is the sea beyond the city, and the rest `land`.
pub(super) fn coast(
    frame: &FrameUniform,
    land: Radiance,
    share: f32,
    (dir, airlight): (Vec3, &Airlight),
    distance_m: f32,
) -> Radiance {
    if share <= 0.0 {
        return land;
    }
    let water = sea(frame, (dir, airlight), distance_m);
    Radiance { sky: land.sky.lerp(water.sky, share), sun: land.sun.lerp(water.sun, share) }
}

/// Light of the sea beyond the city, `distance_m` away.
pub(super) fn sea(frame: &FrameUniform, (dir, airlight): (Vec3, &Airlight), distance_m: f32) -> Radiance {
    let albedo = rgb(frame.sea_albedo);
    let flags = u32::from(flag::REFLECTIVE);
    let surface = SurfaceSample { albedo, ao: 1.0, normal: Vec3::Z, flags, level: 0 };
    let light = mirrored(frame, reflected(frame, albedo, Vec3::Z, 1.0), &surface, (dir, distance_m));
    apply_haze_fading(frame, light, (dir, airlight), (distance_m, SEA_FADE))
}

/// Metres to that plane, infinity if the ray misses it.
pub fn ground_distance(frame: &FrameUniform, dir: Vec3) -> f32 {
    ground_distances(OneLane, frame, dir.into())
}

/// The same of each ray.
#[inline(always)]
pub(super) fn ground_distances<S: Lanes>(simd: S, frame: &FrameUniform, dir: Vec3s<S>) -> F<S> {
    let infinity = simd.splat(f32::INFINITY);
    if frame.ground == 0 || frame.ground_z_m >= 0.0 {
        return infinity;
    }
    dir.z.above(-MIN_GROUND_DESCENT).select(infinity, simd.splat(frame.ground_z_m) / dir.z)
}

/// Light that the air scatters from a direction above the horizon.
#[inline(always)]
fn sky<S: Lanes>(simd: S, frame: &FrameUniform, dir: Vec3s<S>) -> Vec3s<S> {
    let height = ((dir.z - SKY_LOW) / (1.0 - SKY_LOW)).at_least(0.0).sqrt() * (SKY_HEIGHTS - 1) as f32;
    let row = height.to_ints().at_most(SKY_HEIGHTS as i32 - 2);
    let (columns, _) = SkyColumns::new(frame, dir);
    let above = height - row.to_floats();
    let read =
        always!(|table: &SkyTable| columns.read(simd, table, row).lerp(columns.read(simd, table, row + 1), above));
    read(&frame.light.sky) + read(&frame.light.glow).scale(phase(simd, frame, dir))
}

/// Light of the sun's disc, the moon and the stars.
#[inline(always)]
fn celestial_light<S: Lanes>(simd: S, frame: &FrameUniform, lanes: M<S>, dir: Vec3s<S>) -> Vec3s<S> {
    let light = &frame.light;
    let edge = (simd.splat(DISC_OUTER) - from_sun(simd, frame, dir)) / (DISC_OUTER - DISC_INNER);
    let sun = Vec3s::splat(simd, rgb(light.sun)).scale(edge.clamped(0.0, 1.0) * (DISC * light.disc));
    if light.stars <= 0.0 && light.moon[3] <= 0.0 {
        return sun;
    }
    let stars = simd.each(lanes, always!(|lane: usize| stars(light.stars, dir.lane(lane))));
    let moon = simd.each(lanes, always!(|lane: usize| moon(frame, dir.lane(lane))));
    sun.map(always!(|v: F<S>| v + stars + moon))
}

/// Columns of the sky's tables, and how far rays are towards the next ones.
struct SkyColumns<S: Lanes> {
    left: I<S>,
    right: F<S>,
}

impl<S: Lanes> SkyColumns<S> {
    /// In directions `dir`; and their horizontal lengths.
    #[inline(always)]
    fn new(frame: &FrameUniform, dir: Vec3s<S>) -> (Self, F<S>) {
        let [east, north] = frame.light.side;
        let length = (dir.x * dir.x + dir.y * dir.y).sqrt().at_least(1e-4);
        let along = ((dir.x * east + dir.y * north) / length).clamped(-1.0, 1.0);
        let column = (along * 0.5 + 0.5) * (SKY_AZIMUTHS - 1) as f32;
        let left = column.to_ints().at_most(SKY_AZIMUTHS as i32 - 2);
        (Self { left, right: column - left.to_floats() }, length)
    }

    /// Rows of a table, between the columns.
    #[inline(always)]
    fn read(&self, simd: S, table: &SkyTable, row: I<S>) -> Vec3s<S> {
        let cells = table.as_flattened();
        let first = (row * SKY_AZIMUTHS as i32 + self.left).to_words();
        let cell = always!(|at: u32| cells.get(at as usize).copied().unwrap_or_default());
        let common = first.lane(0);
        if first.all_are(common) {
            let [left, right] = [Vec3s::splat(simd, rgb(cell(common))), Vec3s::splat(simd, rgb(cell(common + 1)))];
            return left.lerp(right, self.right);
        }
        let cells = always!(|at: U<S>| {
            let [r, g, b, _] = simd.quadruples(always!(|lane: usize| bytemuck::cast(cell(at.lane(lane)))));
            Vec3s::<S>::new(r.bits_to_floats(), g.bits_to_floats(), b.bits_to_floats())
        });
        cells(first).lerp(cells(first + 1), self.right)
    }
}

/// The phase function of Henyey and Greenstein for the angle between `dir` and the sun.
#[inline(always)]
fn phase<S: Lanes>(simd: S, frame: &FrameUniform, dir: Vec3s<S>) -> F<S> {
    let near = simd.splat(1.0) / (from_sun(simd, frame, dir) * MIE_G + (1.0 - MIE_G) * (1.0 - MIE_G));
    near * PHASE_SCALE * near.sqrt()
}

/// Squared distance from the sun on the unit sphere: precise where a cosine is not.
#[inline(always)]
fn from_sun<S: Lanes>(simd: S, frame: &FrameUniform, dir: Vec3s<S>) -> F<S> {
    let apart = dir - Vec3s::splat(simd, frame.sun.into());
    apart.dot(apart)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn bare_ground_within_rounding_is_level_and_nothing_else_is() {
        let plane = Vec3::new(0.515, 0.521, 0.491);
        let mut frame = FrameUniform { shading: Shading::Lit as u32, ..FrameUniform::zeroed() };
        frame.light.plane = plane.extend(0.0).to_array();
        let sloping = |slope: f32| Vec3::new(-slope, 0.0, 1.0).normalize_or(Vec3::Z);
        // Measured light keeps its normals.
        assert_eq!(lit_normal(&frame, plane, sloping(0.05)), sloping(0.05));
        frame.light.grade[0] = 1.0;
        for slope in [0.0, 0.05, LEVEL_SLOPE] {
            assert!((lit_normal(&frame, plane, sloping(slope)) - Vec3::Z).length() < 1e-4, "{slope}");
        }
        let steep = lit_normal(&frame, plane, sloping(0.5));
        assert!((steep - sloping(0.5 - LEVEL_SLOPE)).length() < 1e-5, "{steep}");
        // A roof of the ground's colour, and a meadow.
        assert_eq!(lit_normal(&frame, plane, sloping(1.2)), sloping(1.2));
        assert_eq!(lit_normal(&frame, Vec3::new(0.3, 0.5, 0.2), sloping(0.05)), sloping(0.05));
    }
}
