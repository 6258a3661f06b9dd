//! Light on a surface and from the sky. GPU twin: `shade.wgsl`.
//!
//! Only [`Shading::Lit`] has light, haze and tone mapping; the other shadings show what is baked.

use crate::layout::{FrameUniform, MESH_FLAG, Shading};
use glam::{Vec2, Vec3, Vec4, Vec4Swizzles};
use insula_protocol::blockmap::flag;

/// The sky at the horizon behind baked values, linear RGB.
pub(crate) const HORIZON: Vec3 = Vec3::new(0.72, 0.80, 0.88);
/// The sky at the zenith behind baked values, linear RGB.
pub(crate) const ZENITH: Vec3 = Vec3::new(0.20, 0.38, 0.68);
/// The plane where there is no column, behind baked values, linear RGB.
pub(crate) const GROUND: Vec3 = Vec3::new(0.36, 0.37, 0.35);
/// Albedo of that plane in light.
pub(crate) const GROUND_ALBEDO: Vec3 = Vec3::new(0.24, 0.235, 0.225);
/// Distance in metres at which half of the plane has become horizon, behind baked values.
pub(crate) const GROUND_FADE_M: f32 = 3000.0;
/// Least descent of a ray, per metre, that meets the plane.
pub(crate) const MIN_GROUND_DESCENT: f32 = 1e-5;
/// How fast the horizon's brightness falls upwards.
pub(crate) const SKY_FALL: f32 = 4.5;
/// Width of the glow around the sun: squared distance on the unit sphere at which it is a third.
pub(crate) const GLOW: f32 = 0.0576;
/// Asymmetry of the glow in the phase function of Henyey and Greenstein.
pub(crate) const GLOW_G: f32 = 0.76;
/// Squared radius on the unit sphere at which the sun's disc begins to fade.
pub(crate) const DISC_INNER: f32 = 1.7e-5;
/// Squared radius on the unit sphere at which the sun's disc ends.
pub(crate) const DISC_OUTER: f32 = 3.2e-5;
/// Brightness of the sun's disc.
pub(crate) const DISC: f32 = 40.0;
/// Weights of red, green and blue in luminance (Rec. 709).
pub(crate) const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);
/// Colours of [`Shading::Kind`].
pub(crate) const TINT_ROOF: Vec3 = Vec3::new(0.55, 0.55, 0.55);
pub(crate) const TINT_MESH: Vec3 = Vec3::new(0.50, 0.30, 0.80);
pub(crate) const TINT_GAP: Vec3 = Vec3::new(0.85, 0.15, 0.12);
pub(crate) const TINT_SUSPENDED: Vec3 = Vec3::new(0.15, 0.35, 0.90);
pub(crate) const TINT_EXPOSED: Vec3 = Vec3::new(0.90, 0.50, 0.12);
pub(crate) const TINT_INCLINED: Vec3 = Vec3::new(0.20, 0.75, 0.25);

/// A surface: a texel, or the weighted mean of those that a ray passed.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceSample {
    /// Linear RGB.
    pub albedo: Vec3,
    /// Visible share of the sky.
    pub ao: f32,
    /// Unit normal towards the viewer.
    pub normal: Vec3,
    /// Flags of its column, or [`MESH_FLAG`].
    pub flags: u32,
    /// Level of its node.
    pub level: u32,
}

/// Linear light of an sRGB value, both 0 to 1 (IEC 61966-2-1).
pub fn linear_of_srgb(v: f32) -> f32 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// 8-bit sRGB channels of a texel as linear light.
pub fn linear_of(texel: u32) -> Vec3 {
    let channel = |shift: u32| linear_of_srgb((texel >> shift & 255) as f32 / 255.0);
    Vec3::new(channel(0), channel(8), channel(16))
}

/// Linear light as r, g, b, 255 in sRGB.
pub fn encode_srgb(rgb: Vec3) -> u32 {
    let channel = |v: f32| {
        let v = v.clamp(0.0, 1.0);
        let s = if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
        (s * 255.0 + 0.5) as u32
    };
    channel(rgb.x) | channel(rgb.y) << 8 | channel(rgb.z) << 16 | 255 << 24
}

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
        s if s == Shading::Lod as u32 => Radiance::unlit(debug(level_tint(surface.level))),
        s if s == Shading::Kind as u32 => Radiance::unlit(debug(kind_tint(surface.flags))),
        _ => reflected(frame, albedo, n, ao),
    }
}

/// Light that a surface reflects.
fn reflected(frame: &FrameUniform, albedo: Vec3, n: Vec3, ao: f32) -> Radiance {
    let light = &frame.light;
    let sun = rgb(light.sun) * n.dot(Vec3::from(frame.sun)).max(0.0);
    let wall = rgb(light.sky_wall) + rgb(light.sky_side) * (n.x * light.side[0] + n.y * light.side[1]);
    let sky = wall.lerp(rgb(light.sky_up), n.z.abs()) * ao;
    // The rest of the hemisphere is lit ground and walls, which are darker the deeper the corner is.
    let bounced = rgb(light.bounce) * ((1.0 - ao) * (0.65 - 0.35 * n.z));
    Radiance { sky: albedo * (sky + bounced), sun: albedo * sun * sun_share_by_sky(frame, ao) }
}

/// Without shadow rays: a surface that sees little sky sees little sun. A wall in the open sees half of the sky.
fn sun_share_by_sky(frame: &FrameUniform, ao: f32) -> f32 {
    if frame.shadow_m > 0.0 { 1.0 } else { (2.0 * ao + 0.25).min(1.0) }
}

fn rgb(v: [f32; 4]) -> Vec3 {
    Vec4::from(v).xyz()
}

/// Light that the air adds in a ray's direction.
#[derive(Debug, Clone, Copy)]
pub struct Airlight {
    horizon: Vec3,
    glow: Vec3,
}

impl Airlight {
    /// The air's light in direction `dir`.
    pub fn new(frame: &FrameUniform, dir: Vec3) -> Self {
        Self { horizon: horizon(frame, dir), glow: glow(frame, dir) }
    }
}

/// Light from `distance_m` away in the direction of `airlight`, as it arrives at the eye.
pub fn apply_haze(frame: &FrameUniform, light: Radiance, airlight: &Airlight, distance_m: f32) -> Radiance {
    if frame.shading != Shading::Lit as u32 {
        return light;
    }
    let haze = rgb(frame.light.haze) * -distance_m;
    let transmitted = Vec3::new(haze.x.exp(), haze.y.exp(), haze.z.exp());
    // Near surfaces have little air in front of them that could glow.
    let far = airlight.horizon + airlight.glow * (1.0 - transmitted);
    Radiance { sky: far + (light.sky - far) * transmitted, sun: light.sun * transmitted }
}

/// Radiance at the eye as linear RGB of the screen.
pub fn to_display(frame: &FrameUniform, rgb: Vec3) -> Vec3 {
    if frame.shading == Shading::Lit as u32 { tone_map(rgb) } else { rgb }
}

/// Narkowicz's fit to the Academy's curve ("ACES Filmic Tone Mapping Curve", 2015): contrast in the middle, and bright
/// light approaches white instead of being cut off. Before it, bright colours lose some saturation, as on film.
fn tone_map(rgb: Vec3) -> Vec3 {
    let bright = rgb.dot(LUMINANCE);
    let v = rgb.lerp(Vec3::splat(bright), 0.04 + 0.35 * bright / (bright + 6.0)).max(Vec3::ZERO);
    let curve = v * (2.51 * v + 0.03) / (v * (2.43 * v + 0.59) + 0.14);
    curve.min(Vec3::ONE)
}

fn level_tint(level: u32) -> Vec3 {
    let phase = (level * 5 % 8) as f32 * std::f32::consts::FRAC_PI_4;
    Vec3::new(0.55 + 0.4 * phase.cos(), 0.55 + 0.4 * (phase - 2.094).cos(), 0.55 + 0.4 * (phase + 2.094).cos())
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
        // The plane has no end: haze that grows with the distance blends it into the sky.
        let hazy_m = ground_m * (1.0 + 4.0 * ground_m * frame.light.haze[1]);
        return apply_haze(frame, reflected(frame, GROUND_ALBEDO, Vec3::Z, 1.0), airlight, hazy_m);
    }
    Radiance::unlit(sky(frame, dir, airlight))
}

/// Metres to that plane, infinity if the ray misses it.
pub fn ground_distance(frame: &FrameUniform, dir: Vec3) -> f32 {
    if frame.ground == 0 || dir.z > -MIN_GROUND_DESCENT || frame.ground_z_m >= 0.0 {
        f32::INFINITY
    } else {
        frame.ground_z_m / dir.z
    }
}

fn sky(frame: &FrameUniform, dir: Vec3, airlight: &Airlight) -> Vec3 {
    let light = &frame.light;
    let clear = rgb(light.zenith).lerp(airlight.horizon, (-SKY_FALL * dir.z.max(0.0)).exp());
    let edge = ((DISC_OUTER - from_sun(frame, dir)) / (DISC_OUTER - DISC_INNER)).clamp(0.0, 1.0);
    clear + airlight.glow + rgb(light.sun) * (DISC * light.disc * edge)
}

/// The sky just above the horizon in direction `dir`.
fn horizon(frame: &FrameUniform, dir: Vec3) -> Vec3 {
    let flat = Vec2::new(dir.x, dir.y);
    let along = flat.dot(Vec2::from(frame.light.side)) / flat.length().max(1e-4);
    let sunward = 0.5 + 0.5 * along;
    rgb(frame.light.horizon_away).lerp(rgb(frame.light.horizon_sun), sunward * sunward)
}

/// The sky around the sun, by the phase function of Henyey and Greenstein.
fn glow(frame: &FrameUniform, dir: Vec3) -> Vec3 {
    let near = GLOW / (GLOW + GLOW_G * from_sun(frame, dir));
    rgb(frame.light.glow) * (near * near.sqrt())
}

/// Squared distance from the sun on the unit sphere: precise where a cosine is not.
fn from_sun(frame: &FrameUniform, dir: Vec3) -> f32 {
    (dir - Vec3::from(frame.sun)).length_squared()
}
