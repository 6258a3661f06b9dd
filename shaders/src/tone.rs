//! From radiance to the screen: storage of a pixel's radiance, exposure by the frame's mean, tone curve, dithering. GPU twin:
//! `wgsl/shared/tone.wgsl` and `wgsl/meter.wgsl`.

use crate::{
    atmosphere::LUMINANCE,
    cpu::shade::encoded,
    layout::{FrameUniform, Shading},
};
use glam::{Mat3, Vec3};
use rayon::prelude::*;

/// Bits of a component's mantissa in a stored radiance, and the bias of the common exponent.
pub(crate) const MANTISSA_BITS: u32 = 9;
pub(crate) const EXPONENT_BIAS: i32 = 15;
/// Largest radiance that is stored.
pub(crate) const MAX_RADIANCE: f32 = 65_000.0;
/// Bins of the meter, per power of two, and the log2 of the lowest one.
pub(crate) const METER_BINS: u32 = 128;
pub(crate) const METER_BINS_PER_STOP: f32 = 6.0;
pub(crate) const METER_MIN_LOG2: f32 = -13.0;
/// Darkest and brightest share of the pixels whose light counts as that of the next ones: the sun's disc and black corners.
pub(crate) const METER_CUT: f32 = 0.01;
/// Light between these exponents of two is displayed (AgX).
pub(crate) const AGX_MIN_LOG2: f32 = -12.473_93;
pub(crate) const AGX_LOG2_RANGE: f32 = 16.5;
/// Contrast and saturation of the display.
pub(crate) const AGX_POWER: f32 = 1.2;
pub(crate) const AGX_SATURATION: f32 = 1.2;
/// AgX's primaries, columns, and their inverse (Sobotka; matrix and polynomial as approximated by Wrensch, "Minimal AgX
/// Implementation", 2023).
pub(crate) const AGX_IN: Mat3 = Mat3::from_cols(
    Vec3::new(0.842_479_06, 0.042_328_242, 0.042_375_655),
    Vec3::new(0.078_433_6, 0.878_468_64, 0.078_433_6),
    Vec3::new(0.079_223_745, 0.079_166_13, 0.879_143),
);
pub(crate) const AGX_OUT: Mat3 = Mat3::from_cols(
    Vec3::new(1.196_879, -0.052_896_85, -0.052_971_64),
    Vec3::new(-0.098_020_88, 1.151_903_1, -0.098_043_45),
    Vec3::new(-0.099_029_74, -0.098_961_17, 1.151_073_7),
);
/// Exponent from AgX's output to linear light.
pub(crate) const AGX_GAMMA: f32 = 2.2;

/// A radiance in 32 bits: nine for each component and five for a common exponent, as in the texture format RGB9E5. Negative
/// values become 0.
pub fn encode_radiance(rgb: Vec3) -> u32 {
    let rgb = rgb.clamp(Vec3::ZERO, Vec3::splat(MAX_RADIANCE));
    // Half of the last bit, so that the largest component is not rounded up beyond its bits.
    let bits = rgb.max_element().to_bits() + (1 << (22 - MANTISSA_BITS + 1));
    let exponent = ((bits >> 23) as i32 - 127).max(-1 - EXPONENT_BIAS);
    let scale = f32::from_bits(((127 + MANTISSA_BITS as i32 - 1 - exponent) as u32) << 23);
    let mantissa = |v: f32| ((v * scale + 0.5) as u32).min((1 << MANTISSA_BITS) - 1);
    mantissa(rgb.x) | mantissa(rgb.y) << 9 | mantissa(rgb.z) << 18 | ((exponent + 1 + EXPONENT_BIAS) as u32) << 27
}

/// The radiance in such a word.
pub fn decode_radiance(word: u32) -> Vec3 {
    let scale = f32::from_bits((127 + (word >> 27) - EXPONENT_BIAS as u32 - MANTISSA_BITS) << 23);
    let mantissa = |shift: u32| (word >> shift & ((1 << MANTISSA_BITS) - 1)) as f32;
    Vec3::new(mantissa(0), mantissa(9), mantissa(18)) * scale
}

/// Colours of a frame's pixels: r, g, b, 255 in sRGB. `words` are radiances if the frame is [`Shading::Lit`], else colours.
pub fn develop(frame: &FrameUniform, words: &[u32]) -> Vec<u32> {
    if frame.shading != Shading::Lit as u32 {
        return words.to_vec();
    }
    let (exposure, width) = (exposure(frame, words), (frame.width_px as usize).max(1));
    let develop = |(i, word): (usize, &u32)| {
        let rgb = tone_map(decode_radiance(*word) * exposure);
        dithered(rgb, (i % width) as u32, (i / width) as u32)
    };
    words.par_iter().enumerate().map(develop).collect()
}

/// Factor from radiance to display: the frame's own, or by the mean logarithm of its pixels' luminance.
pub fn exposure(frame: &FrameUniform, words: &[u32]) -> f32 {
    if frame.exposure > 0.0 {
        return frame.exposure;
    }
    let mut bins = [0; METER_BINS as usize];
    for word in words {
        bins[meter_bin(decode_radiance(*word))] += 1;
    }
    frame.light.key / mean_of(&bins).exp2()
}

fn meter_bin(rgb: Vec3) -> usize {
    let stops = rgb.dot(LUMINANCE).max(1e-6).log2() - METER_MIN_LOG2;
    (stops * METER_BINS_PER_STOP).clamp(0.0, (METER_BINS - 1) as f32) as usize
}

/// Mean log2 of the luminances in the meter's bins.
fn mean_of(bins: &[u32; METER_BINS as usize]) -> f32 {
    let total: u32 = bins.iter().sum();
    let cut = (total as f32 * METER_CUT) as u32;
    let (mut passed, mut low, mut high) = (0, 0, 0);
    for (i, count) in bins.iter().enumerate() {
        if passed <= cut {
            low = i;
        }
        if passed < total - cut {
            high = i;
        }
        passed += count;
    }
    let sum: f32 = bins.iter().enumerate().map(|(i, count)| i.clamp(low, high.max(low)) as f32 * *count as f32).sum();
    METER_MIN_LOG2 + (sum / total.max(1) as f32 + 0.5) / METER_BINS_PER_STOP
}

/// AgX: bright colours lose saturation as on film, and keep their hue. Returns linear sRGB, 0 to 1.
pub(crate) fn tone_map(rgb: Vec3) -> Vec3 {
    let inset = AGX_IN * rgb;
    let log = |v: f32| ((v.max(1e-10).log2() - AGX_MIN_LOG2) / AGX_LOG2_RANGE).clamp(0.0, 1.0);
    let curve = Vec3::new(log(inset.x), log(inset.y), log(inset.z)).map(agx_curve).map(|v| v.max(0.0).powf(AGX_POWER));
    let grey = Vec3::splat(curve.dot(LUMINANCE));
    let saturated = (grey + (curve - grey) * AGX_SATURATION).max(Vec3::ZERO);
    (AGX_OUT * saturated).map(|v| v.clamp(0.0, 1.0).powf(AGX_GAMMA))
}

/// Wrensch's polynomial for AgX's contrast.
fn agx_curve(x: f32) -> f32 {
    (((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x + 0.1191) * x - 0.002_32
}

/// A pixel in sRGB, rounded up or down by a pattern that has no visible structure, so that skies have no bands.
fn dithered(rgb: Vec3, x: u32, y: u32) -> u32 {
    let noise = gradient_noise(x, y);
    let channel = |v: f32| (encoded(v) * 255.0 + noise).min(255.0) as u32;
    channel(rgb.x) | channel(rgb.y) << 8 | channel(rgb.z) << 16 | 255 << 24
}

/// From 0 to 1, as different as possible in pixels next to each other (Jimenez, "Next Generation Post Processing in Call of
/// Duty", 2014: interleaved gradient noise).
pub(crate) fn gradient_noise(x: u32, y: u32) -> f32 {
    (52.982_918 * (0.067_110_56 * x as f32 + 0.005_837_15 * y as f32).fract()).fract()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::Light;
    use bytemuck::Zeroable;

    #[test]
    fn radiances_are_stored_with_nine_bits() {
        for exponent in -13..15 {
            for factor in [1.0, 1.37, 1.9999, 1.996, 1.5] {
                let v = factor * 2f32.powi(exponent);
                let rgb = decode_radiance(encode_radiance(Vec3::new(v, v * 0.5, 0.0)));
                assert!((rgb.x / v - 1.0).abs() < 1.0 / 400.0 && (rgb.y / v - 0.5).abs() < 1.0 / 400.0, "{v}: {rgb}");
                assert_eq!(rgb.z, 0.0);
            }
        }
        assert_eq!(decode_radiance(encode_radiance(Vec3::new(-1.0, 0.0, 0.0))), Vec3::ZERO);
        assert!((decode_radiance(encode_radiance(Vec3::splat(1e9))).x / MAX_RADIANCE - 1.0).abs() < 0.01);
    }

    #[test]
    fn the_tone_curve_keeps_order_and_greys() {
        let greys: Vec<Vec3> = (-20..60).map(|i| tone_map(Vec3::splat(2f32.powf(i as f32 / 6.0)))).collect();
        assert!(greys.windows(2).all(|pair| pair[0].x <= pair[1].x + 1e-4));
        assert!(greys.iter().all(|v| v.max_element() - v.min_element() < 0.01), "{greys:?}");
        assert!(tone_map(Vec3::splat(0.18)).x > 0.1 && greys[79].x > 0.9);
    }

    #[test]
    fn a_frame_is_exposed_by_its_mean_without_extremes() {
        let mut frame = FrameUniform { width_px: 100, height_px: 10, ..FrameUniform::zeroed() };
        frame.light = Light { key: 0.3, ..Light::zeroed() };
        let mut words = vec![encode_radiance(Vec3::splat(0.1)); 1000];
        assert!((exposure(&frame, &words) / 3.0 - 1.0).abs() < 0.07, "{}", exposure(&frame, &words));
        words[..5].fill(encode_radiance(Vec3::splat(60_000.0)));
        assert!((exposure(&frame, &words) / 3.0 - 1.0).abs() < 0.08);
        frame.exposure = 0.7;
        assert_eq!(exposure(&frame, &words), 0.7);
    }
}
