//! Light on a surface and from the sky. GPU twin: `shade.wgsl`.
//!
//! Only [`Shading::Lit`] has light and haze; the other shadings show what is baked.

use super::fast_math::exp;
use super::night::{BAYS_PER_M, moon, stars};
use super::noise::fbm;
use super::sea::{BARE_NORMAL_Z, SEA_FADE, is_bare, sea_share};
pub use super::surface::SurfaceSample;
use super::surface::rgb;
use crate::atmosphere::{MIE_G, PHASE_SCALE};
use crate::layout::{FrameUniform, Light, MESH_FLAG, MESH_LEVEL, SKY_AZIMUTHS, SKY_HEIGHTS, Shading, SkyTable};
use crate::light::SKY_LOW;
pub(crate) use crate::srgb::{POWER_HIGH, POWER_LOW};
pub use crate::srgb::{encode_srgb, linear_of};
use glam::{Vec2, Vec3, Vec3Swizzles, Vec4, Vec4Swizzles};
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
    let is_graded = frame.light.grade[0] > 0.0 && frame.shading == Shading::Lit as u32;
    if !is_graded || normal.z < BARE_NORMAL_Z || !is_bare(frame, albedo) {
        return normal;
    }
    let flat = normal.xy();
    let kept = (1.0 - LEVEL_SLOPE * normal.z / flat.length().max(1e-6)).max(0.0);
    let lit = (flat * kept).extend(normal.z);
    lit / lit.length()
}

/// Light that a surface reflects.
pub(super) fn reflected(frame: &FrameUniform, albedo: Vec3, n: Vec3, ao: f32) -> Radiance {
    let light = &frame.light;
    let (up, upright) = (rgb(light.sky_up), n.z.abs());
    // Openness of the surroundings: 1 for a wall or a roof without neighbours.
    let open = (ao / (0.5 + 0.5 * upright)).min(1.0);
    let ahead = n.x * light.side[0] + n.y * light.side[1];
    let wall = rgb(light.sky_wall) + rgb(light.sky_wall_ahead) * ahead + rgb(light.sky_wall_axis) * (ahead * ahead);
    let overhead = up * ZENITH_SHARE;
    let sky = (overhead + (wall - overhead) * open).lerp(up, upright) * ao;
    let returned = light_from_city(light, &Surroundings { open, below: 0.5 - 0.5 * n.z, ahead, upright }, ao);
    let sun = rgb(light.sun) * n.dot(Vec3::from(frame.sun)).max(0.0);
    Radiance { sky: albedo * (sky + returned), sun: albedo * sun * sun_share_by_sky(frame, ao) }
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
    let glint = (-from_sun(frame, towards) / (spread * spread)).exp() / (spread * spread);
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
    fbm(place, 3, 0.6, footprint).value * (WAVE_TILT * near)
}

/// Light that a mirror reflects from below and from above the horizon in direction `towards`. `open`: the openness of its surroundings.
pub(super) fn reflected_light(frame: &FrameUniform, towards: Vec3, open: f32) -> [Vec3; 2] {
    let light = &frame.light;
    let city = rgb(light.facade_sky) + rgb(light.facade_sun) * (0.25 * open);
    let ground = rgb(light.ground_sky) + rgb(light.ground_sun) * open;
    [ground, city + (sky(frame, towards) - city) * open]
}

/// What a surface is turned to.
struct Surroundings {
    /// Openness: 1 without neighbours.
    open: f32,
    /// Share of its hemisphere below the horizon.
    below: f32,
    /// Cosine to the sun's azimuth.
    ahead: f32,
    /// 1 for level surfaces, 0 for walls.
    upright: f32,
}

/// Light that ground and facades return to a surface. The deeper the street, the less of them the sun reaches. Facades opposite
/// a wall that is turned away from the sun are those in the sun.
fn light_from_city(light: &Light, around: &Surroundings, ao: f32) -> Vec3 {
    let (reach, deep) = (light.sun_tan * around.open, 1.0 - around.open + 1e-6);
    let ground = rgb(light.ground_sun) * (reach / (reach + GROUND_DEPTH * deep)) + rgb(light.ground_sky);
    let far = reach * reach.sqrt();
    let sunlit = far / (far + FACADE_DEPTH * deep * deep) * (0.5 - 0.5 * around.ahead);
    let facades = rgb(light.facade_sun) * sunlit + rgb(light.facade_sky) + ground * light.facade_ground;
    let share = FACADES_BY_WALL + (FACADES_BY_GROUND - FACADES_BY_WALL) * around.upright;
    ground * around.below + facades * (share * (1.0 - ao - around.below).max(0.0))
}

/// Without shadow rays: a surface that sees little sky sees little sun. A wall in the open sees half of the sky.
pub(super) fn sun_share_by_sky(frame: &FrameUniform, ao: f32) -> f32 {
    if frame.shadow_m > 0.0 { 1.0 } else { (2.0 * ao + 0.25).min(1.0) }
}

/// The sky low above the horizon in a ray's direction: the light that haze adds.
#[derive(Debug, Clone, Copy)]
pub struct Airlight {
    pub(super) rgb: Vec3,
}

impl Airlight {
    /// The air's light in direction `dir`.
    pub fn new(frame: &FrameUniform, dir: Vec3) -> Self {
        let (column, right) = sky_column(frame, dir);
        let [smooth, forward] = [&frame.light.sky, &frame.light.glow].map(|table| sky_at(table, 0, column, right));
        let flat = Vec2::new(dir.x, dir.y);
        let level = (flat / flat.length().max(1e-4)).extend(SKY_LOW);
        Self { rgb: smooth + forward * phase(frame, level) }
    }
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
    let haze = rgb(frame.light.haze) * -distance_m - fog_depth(frame, dir * distance_m, distance_m, fade);
    let transmitted = haze.map(exp);
    let far = airlight.rgb;
    Radiance { sky: far + (light.sky - far) * transmitted, sun: light.sun * transmitted }
}

/// Optical depth of the fog before a place. It hides what is far, and the land beyond the city's ends, or what fades as that times
/// `fade`.
fn fog_depth(frame: &FrameUniform, place: Vec3, distance_m: f32, fade: f32) -> f32 {
    let [start_m, density, land_fade, _] = frame.fog;
    let fade = land_fade * fade;
    let far = (distance_m - start_m).max(0.0) * density;
    let (place, low, high) = (place.xy(), Vec4::from(frame.city).xy(), Vec4::from(frame.city).zw());
    let away = ((low - place).max(place - high).max(Vec2::ZERO) * fade).length();
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
    if ground_m < f32::INFINITY {
        let hazy_m = ground_m + (ground_m - PLANE_CLEAR_M).max(0.0) * PLANE_FADE;
        let land = reflected(frame, rgb(frame.light.plane), Vec3::Z, 1.0);
        let land = apply_haze(frame, land, (dir, airlight), hazy_m);
        return coast(frame, land, sea_share(frame, None, dir * ground_m), (dir, airlight), ground_m);
    }
    Radiance::unlit(sky(frame, dir) + celestial_light(frame, dir))
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
    if frame.ground == 0 || dir.z > -MIN_GROUND_DESCENT || frame.ground_z_m >= 0.0 {
        f32::INFINITY
    } else {
        frame.ground_z_m / dir.z
    }
}

/// Light that the air scatters from a direction above the horizon.
fn sky(frame: &FrameUniform, dir: Vec3) -> Vec3 {
    let light = &frame.light;
    let height = ((dir.z - SKY_LOW) / (1.0 - SKY_LOW)).max(0.0).sqrt() * (SKY_HEIGHTS - 1) as f32;
    let row = (height as usize).min(SKY_HEIGHTS - 2);
    let (column, right) = sky_column(frame, dir);
    let read = |table: &SkyTable| {
        let at = |row: usize| sky_at(table, row, column, right);
        at(row).lerp(at(row + 1), height - row as f32)
    };
    read(&light.sky) + read(&light.glow) * phase(frame, dir)
}

/// Light of the sun's disc, the moon and the stars.
fn celestial_light(frame: &FrameUniform, dir: Vec3) -> Vec3 {
    let light = &frame.light;
    let edge = ((DISC_OUTER - from_sun(frame, dir)) / (DISC_OUTER - DISC_INNER)).clamp(0.0, 1.0);
    rgb(light.sun) * (DISC * light.disc * edge) + stars(light.stars, dir) + moon(frame, dir)
}

/// Column of the sky's tables in direction `dir`, and how far the direction is towards the next one.
fn sky_column(frame: &FrameUniform, dir: Vec3) -> (usize, f32) {
    let flat = Vec2::new(dir.x, dir.y);
    let along = flat.dot(Vec2::from(frame.light.side)) / flat.length().max(1e-4);
    let column = (0.5 + 0.5 * along.clamp(-1.0, 1.0)) * (SKY_AZIMUTHS - 1) as f32;
    let left = (column as usize).min(SKY_AZIMUTHS - 2);
    (left, column - left as f32)
}

fn sky_at(table: &SkyTable, row: usize, column: usize, right: f32) -> Vec3 {
    rgb(table[row][column]).lerp(rgb(table[row][column + 1]), right)
}

/// The phase function of Henyey and Greenstein for the angle between `dir` and the sun.
fn phase(frame: &FrameUniform, dir: Vec3) -> f32 {
    let near = 1.0 / ((1.0 - MIE_G) * (1.0 - MIE_G) + MIE_G * from_sun(frame, dir));
    PHASE_SCALE * near * near.sqrt()
}

/// Squared distance from the sun on the unit sphere: precise where a cosine is not.
fn from_sun(frame: &FrameUniform, dir: Vec3) -> f32 {
    (dir - Vec3::from(frame.sun)).length_squared()
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
