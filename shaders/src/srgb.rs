//! sRGB, and linear light. GPU twin: `shade.wgsl`.

use crate::lanes::{F, LaneFloats, LaneMask, LaneWords, Lanes, OneLane, U, Vec3s, always, horner};
use glam::Vec3;

/// The power 2.4 of sRGB's transfer function as a polynomial: coefficients of x^0 to x^2, and of x^3 to x^5. After encoding it
/// differs by 0.02 of 255 at most, and it takes a tenth of the time.
pub(crate) const POWER_LOW: Vec3 = Vec3::new(0.000_528_2, -0.018_188_3, 0.442_764_7);
pub(crate) const POWER_HIGH: Vec3 = Vec3::new(0.884_235_6, -0.432_712, 0.123_526_2);

/// Linear light of an sRGB value, both 0 to 1 (IEC 61966-2-1).
pub fn linear_of_srgb(v: f32) -> f32 {
    linear(OneLane, v)
}

/// The same.
#[inline(always)]
fn linear<S: Lanes>(simd: S, v: F<S>) -> F<S> {
    let (low, high) = (POWER_LOW, POWER_HIGH);
    let power = horner(simd, (v + 0.055) / 1.055, [high.z, high.y, high.x, low.z, low.y, low.x]);
    v.above(0.04045).select(power, v / 12.92)
}

/// 8-bit sRGB channels of a texel as linear light.
pub fn linear_of(texel: u32) -> Vec3 {
    linear_colours(OneLane, texel).into()
}

/// The same.
#[inline(always)]
pub(crate) fn linear_colours<S: Lanes>(simd: S, texel: U<S>) -> Vec3s<S> {
    let channel = always!(|shift: u32| linear(simd, ((texel >> shift) & 255).to_floats() / 255.0));
    Vec3s::new(channel(0), channel(8), channel(16))
}

/// The sRGB value of linear light, both 0 to 1.
pub(crate) fn encoded(v: f32) -> f32 {
    let v = v.clamp(0.0, 1.0);
    if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// Linear light as r, g, b, 255 in sRGB.
pub fn encode_srgb(rgb: Vec3) -> u32 {
    let channel = |v: f32| (encoded(v) * 255.0 + 0.5) as u32;
    channel(rgb.x) | channel(rgb.y) << 8 | channel(rgb.z) << 16 | 255 << 24
}
