//! From a texel and a normal to light; twin of the functions of the same names in `shade.wgsl`.
//!
//! In: what a ray hit, the frame's [`Light`](crate::layout::Light). Out: light at the eye, then linear RGB of the screen.
//! Next: averaged over a pixel's rays, then sRGB.
//!
//! Only [`Shading::Lit`] knows light, haze and a film's curve; the others show what is baked.

use crate::layout::{FrameUniform, MESH_FLAG, Shading};
use glam::{Vec2, Vec3, Vec4, Vec4Swizzles};
use insula_protocol::blockmap::flag;

/// Sky at the horizon and at the zenith behind baked values, linear RGB.
const HORIZON: Vec3 = Vec3::new(0.72, 0.80, 0.88);
const ZENITH: Vec3 = Vec3::new(0.20, 0.38, 0.68);
/// The plane where there is no column, linear RGB: behind baked values, and its albedo in light.
const GROUND: Vec3 = Vec3::new(0.36, 0.37, 0.35);
const GROUND_ALBEDO: Vec3 = Vec3::new(0.24, 0.235, 0.225);
/// Metres at which the plane has half become horizon, behind baked values.
const GROUND_FADE_M: f32 = 3000.0;
/// How fast the horizon's brightness is lost upwards.
const SKY_FALL: f32 = 4.5;
/// Width of the glow around the sun: squared distance on the unit sphere at which it is a third.
const GLOW: f32 = 0.0576;
/// Squared radii on the unit sphere between which the sun's disc ends, and its brightness.
const DISC_INNER: f32 = 1.7e-5;
const DISC_OUTER: f32 = 3.2e-5;
const DISC: f32 = 40.0;
/// The red, green and blue of brightness (Rec. 709).
const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// What a ray met: a texel, or the mean of those that it passed.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    /// Linear RGB.
    pub albedo: Vec3,
    /// Share of the sky that is seen.
    pub ao: f32,
    /// Unit normal, towards the viewer.
    pub normal: Vec3,
    /// The column's flags.
    pub flags: u32,
    /// Level of its node.
    pub level: u32,
}

/// 8-bit sRGB channels of a texel as linear light.
pub fn linear_of(texel: u32) -> Vec3 {
    let channel = |shift: u32| {
        let v = (texel >> shift & 255) as f32 / 255.0;
        if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    };
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

/// Light on its way to the eye: the sun's is apart until it is known whether the sun is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lit {
    /// From sky, ground and walls, linear RGB.
    pub sky: Vec3,
    /// What the sun adds if nothing is in its way.
    pub sun: Vec3,
}

impl Lit {
    /// Without the sun.
    fn plain(sky: Vec3) -> Self {
        Self { sky, sun: Vec3::ZERO }
    }
}

/// Light of a surface under the frame's shading, not yet through haze.
pub fn shade(frame: &FrameUniform, surface: &Surface) -> Lit {
    let Surface { albedo, ao, normal: n, .. } = *surface;
    let debug = |tint: Vec3| tint * (0.35 + 0.65 * ao) * (0.7 + 0.3 * n.dot(Vec3::from(frame.sun)).max(0.0));
    match frame.shading {
        s if s == Shading::Albedo as u32 => Lit::plain(albedo),
        s if s == Shading::Ao as u32 => Lit::plain(Vec3::splat(ao)),
        s if s == Shading::Normal as u32 => Lit::plain(n * 0.5 + 0.5),
        s if s == Shading::Lod as u32 => Lit::plain(debug(level_tint(surface.level))),
        s if s == Shading::Kind as u32 => Lit::plain(debug(kind_tint(surface.flags))),
        _ => received(frame, albedo, n, ao),
    }
}

/// What a surface sends of what it receives.
fn received(frame: &FrameUniform, albedo: Vec3, n: Vec3, ao: f32) -> Lit {
    let light = &frame.light;
    let sun = rgb(light.sun) * n.dot(Vec3::from(frame.sun)).max(0.0);
    let wall = rgb(light.sky_wall) + rgb(light.sky_side) * (n.x * light.side[0] + n.y * light.side[1]);
    let sky = wall.lerp(rgb(light.sky_up), n.z.abs()) * ao;
    // What of the hemisphere is not sky is lit ground and walls, the less of it the deeper the corner.
    let bounced = rgb(light.bounce) * ((1.0 - ao) * (0.65 - 0.35 * n.z));
    Lit { sky: albedo * (sky + bounced), sun: albedo * sun * sun_by_sky(frame, ao) }
}

/// What the share of the sky that a surface sees tells of its sun, where no ray asks: what sees little sky sees little sun. A
/// wall in the open sees half the sky.
fn sun_by_sky(frame: &FrameUniform, ao: f32) -> f32 {
    if frame.shadow_m > 0.0 { 1.0 } else { (2.0 * ao + 0.25).min(1.0) }
}

fn rgb(v: [f32; 4]) -> Vec3 {
    Vec4::from(v).xyz()
}

/// What the air adds in a ray's direction.
#[derive(Debug, Clone, Copy)]
pub struct Airlight {
    horizon: Vec3,
    glow: Vec3,
}

impl Airlight {
    /// In direction `dir`.
    pub fn new(frame: &FrameUniform, dir: Vec3) -> Self {
        Self { horizon: horizon(frame, dir), glow: glow(frame, dir) }
    }
}

/// Light from `distance_m` away in the direction of `air`, as it comes to the eye.
pub fn through_haze(frame: &FrameUniform, lit: Lit, air: &Airlight, distance_m: f32) -> Lit {
    if frame.shading != Shading::Lit as u32 {
        return lit;
    }
    let haze = rgb(frame.light.haze) * -distance_m;
    let left = Vec3::new(haze.x.exp(), haze.y.exp(), haze.z.exp());
    // Near by there is little air between the eye and the glow.
    let far = air.horizon + air.glow * (1.0 - left);
    Lit { sky: far + (lit.sky - far) * left, sun: lit.sun * left }
}

/// What came to the eye, as the screen shows it.
pub fn develop(frame: &FrameUniform, rgb: Vec3) -> Vec3 {
    if frame.shading == Shading::Lit as u32 { tone(rgb) } else { rgb }
}

/// A film's curve: contrast in the middle, bright light bends towards white instead of being cut off. The curve is
/// Narkowicz's fit to the Academy's ("ACES Filmic Tone Mapping Curve", 2015); bright colours give up some of their hue first,
/// as dyes do.
fn tone(rgb: Vec3) -> Vec3 {
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
        Vec3::new(0.50, 0.30, 0.80)
    } else if has(flag::GAP) || has(flag::HOLES) {
        Vec3::new(0.85, 0.15, 0.12)
    } else if has(flag::SUSPENDED) {
        Vec3::new(0.15, 0.35, 0.90)
    } else if has(flag::EXPOSED) {
        Vec3::new(0.90, 0.50, 0.12)
    } else {
        Vec3::new(0.55, 0.55, 0.55)
    };
    if has(flag::INCLINED) { base.lerp(Vec3::new(0.20, 0.75, 0.25), 0.4) } else { base }
}

/// Sky and ground plane in direction `dir`, which is that of `air`.
pub fn background(frame: &FrameUniform, dir: Vec3, air: &Airlight) -> Lit {
    let ground_m = ground_distance(frame, dir);
    if frame.shading != Shading::Lit as u32 {
        let sky = HORIZON.lerp(ZENITH, dir.z.max(0.0).sqrt());
        let near = if ground_m < f32::INFINITY { GROUND_FADE_M / (ground_m + GROUND_FADE_M) } else { 0.0 };
        return Lit::plain(sky.lerp(GROUND, near));
    }
    if ground_m < f32::INFINITY {
        // The plane is endless: more haze the farther it is lets it go over into the sky.
        let hazy_m = ground_m * (1.0 + 4.0 * ground_m * frame.light.haze[1]);
        return through_haze(frame, received(frame, GROUND_ALBEDO, Vec3::Z, 1.0), air, hazy_m);
    }
    Lit::plain(sky(frame, dir, air))
}

/// Metres to the ground plane, infinity if the ray does not meet it.
pub fn ground_distance(frame: &FrameUniform, dir: Vec3) -> f32 {
    if frame.ground == 0 || dir.z > -1e-5 || frame.ground_z_m >= 0.0 { f32::INFINITY } else { frame.ground_z_m / dir.z }
}

/// The sky's light in direction `dir`, which is that of `air`.
fn sky(frame: &FrameUniform, dir: Vec3, air: &Airlight) -> Vec3 {
    let light = &frame.light;
    let clear = rgb(light.zenith).lerp(air.horizon, (-SKY_FALL * dir.z.max(0.0)).exp());
    let edge = ((DISC_OUTER - from_sun(frame, dir)) / (DISC_OUTER - DISC_INNER)).clamp(0.0, 1.0);
    clear + air.glow + rgb(light.sun) * (DISC * light.disc * edge)
}

/// The sky low in direction `dir`.
fn horizon(frame: &FrameUniform, dir: Vec3) -> Vec3 {
    let flat = Vec2::new(dir.x, dir.y);
    let along = flat.dot(Vec2::from(frame.light.side)) / flat.length().max(1e-4);
    let sunward = 0.5 + 0.5 * along;
    rgb(frame.light.horizon_away).lerp(rgb(frame.light.horizon_sun), sunward * sunward)
}

/// What the sky around the sun has more (Henyey and Greenstein's shape with g = 0.76).
fn glow(frame: &FrameUniform, dir: Vec3) -> Vec3 {
    let near = GLOW / (GLOW + 0.76 * from_sun(frame, dir));
    rgb(frame.light.glow) * (near * near.sqrt())
}

/// Squared distance from the sun on the unit sphere: exact where a cosine is not.
fn from_sun(frame: &FrameUniform, dir: Vec3) -> f32 {
    (dir - Vec3::from(frame.sun)).length_squared()
}
