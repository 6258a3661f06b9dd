//! From a texel and a normal to light; twin of the functions of the same names in `raycast.wgsl`.
//!
//! In: what a ray hit. Out: linear RGB. Next: averaged over a pixel's rays, then sRGB.

use crate::layout::{Frame, Shading};
use glam::Vec3;
use insula_protocol::blockmap::flag;

/// Light of the sun, linear RGB.
const SUN: Vec3 = Vec3::new(1.08, 0.98, 0.84);
/// Light from straight above, linear RGB.
const SKY: Vec3 = Vec3::new(0.46, 0.54, 0.66);
/// Light from below, linear RGB.
const BOUNCE: Vec3 = Vec3::new(0.26, 0.24, 0.22);
/// Sky at the horizon and at the zenith, linear RGB.
const HORIZON: Vec3 = Vec3::new(0.72, 0.80, 0.88);
const ZENITH: Vec3 = Vec3::new(0.20, 0.38, 0.68);
/// The plane where there is no column, linear RGB.
const GROUND: Vec3 = Vec3::new(0.36, 0.37, 0.35);
/// Brightness of the picture.
const EXPOSURE: f32 = 1.25;
/// Metres at which the plane has half become horizon.
const GROUND_FADE_M: f32 = 3000.0;

/// What a ray met.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    /// Bits of a [`insula_protocol::Texel`].
    pub texel: u32,
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

/// Linear light of a surface under the frame's shading.
pub fn shade(frame: &Frame, surface: &Surface) -> Vec3 {
    let albedo = linear_of(surface.texel);
    let ao = (surface.texel >> 26) as f32 / 63.0;
    let n = surface.normal;
    let debug = |tint: Vec3| tint * (0.35 + 0.65 * ao) * (0.7 + 0.3 * n.dot(Vec3::from(frame.sun)).max(0.0));
    match frame.shading {
        s if s == Shading::Albedo as u32 => albedo,
        s if s == Shading::Ao as u32 => Vec3::splat(ao),
        s if s == Shading::Normal as u32 => n * 0.5 + 0.5,
        s if s == Shading::Lod as u32 => debug(level_tint(surface.level)),
        s if s == Shading::Kind as u32 => debug(kind_tint(surface.flags)),
        _ => {
            // What of the hemisphere is not sky is lit ground and walls, the less of it the deeper the corner.
            let bounced = (1.0 - ao) * (0.65 - 0.35 * n.z);
            let sky = SKY * ao + BOUNCE * bounced;
            // Without shadows, what sees little sky sees little sun. A wall in the open sees half the sky.
            let sun = SUN * n.dot(Vec3::from(frame.sun)).max(0.0) * (2.0 * ao + 0.25).min(1.0);
            tone(albedo * (sky + sun))
        }
    }
}

/// Bright light bends towards white instead of being cut off: a white wall in the sun keeps its shading.
fn tone(rgb: Vec3) -> Vec3 {
    Vec3::ONE - Vec3::new((-EXPOSURE * rgb.x).exp(), (-EXPOSURE * rgb.y).exp(), (-EXPOSURE * rgb.z).exp())
}

fn level_tint(level: u32) -> Vec3 {
    let phase = (level * 5 % 8) as f32 * std::f32::consts::FRAC_PI_4;
    Vec3::new(0.55 + 0.4 * phase.cos(), 0.55 + 0.4 * (phase - 2.094).cos(), 0.55 + 0.4 * (phase + 2.094).cos())
}

fn kind_tint(flags: u32) -> Vec3 {
    let has = |bit: u8| flags & u32::from(bit) != 0;
    let base = if has(flag::GAP) || has(flag::HOLES) {
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

/// Linear light of sky and ground plane in direction `dir`.
pub fn background(frame: &Frame, dir: Vec3) -> Vec3 {
    let up = dir.z.max(0.0);
    let sky = HORIZON.lerp(ZENITH, up.sqrt());
    if frame.ground == 0 || dir.z > -1e-5 || frame.ground_z_m >= 0.0 {
        return sky;
    }
    let distance_m = frame.ground_z_m / dir.z;
    GROUND.lerp(HORIZON, distance_m / (distance_m + GROUND_FADE_M))
}
