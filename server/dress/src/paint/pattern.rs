//! How a material's colour varies over the map.

use crate::paint::ValueNoise;
use std::sync::OnceLock;

/// Number of lattices of noise.
pub(super) const OCTAVES: usize = 4;
/// Sizes of their cells in metres. None is a multiple of another, so that their lattices do not coincide.
const CELLS_M: [f64; OCTAVES] = [97.0, 23.0, 6.1, 1.7];
/// Directions of their axes: cosine and sine, exact in decimal digits.
const AXES: [[f64; 2]; OCTAVES] = [[0.96, 0.28], [0.8, 0.6], [0.6, -0.8], [0.28, 0.96]];
/// Entries of the table from linear light to sRGB: five for each step of 8 bits where steps are smallest.
const ENCODE_STEPS: usize = 1 << 14;

/// Colours in linear light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pattern {
    mean: [f32; 3],
    /// Added times a number from -1 to 1.
    half_range: [f32; 3],
    /// Weights of the lattices.
    shares: [f32; OCTAVES],
}

impl Pattern {
    /// A pattern of one colour, 8-bit sRGB.
    pub fn plain(rgb: [u8; 3]) -> Self {
        Self { mean: to_linear(rgb), half_range: [0.0; 3], shares: [0.0; OCTAVES] }
    }

    /// Between two colours.
    pub fn varied(tones: [[u8; 3]; 2], shares: [f32; OCTAVES]) -> Self {
        let [one, other] = tones.map(to_linear);
        let mean = std::array::from_fn(|i| (one[i] + other[i]) / 2.0);
        Self { mean, half_range: std::array::from_fn(|i| (other[i] - one[i]) / 2.0), shares }
    }

    /// Gives the pattern another mean, 8-bit sRGB.
    #[cfg(test)]
    pub fn recolour(&mut self, rgb: [u8; 3]) {
        let wanted = to_linear(rgb);
        let scaled = |i: usize| if self.mean[i] > 0.0 { self.half_range[i] * wanted[i] / self.mean[i] } else { 0.0 };
        self.half_range = std::array::from_fn(scaled);
        self.mean = wanted;
    }

    /// Its mean colour.
    #[cfg(test)]
    pub fn mean(&self) -> [f32; 3] {
        self.mean
    }

    /// The colour for a sum of noise. Sums beyond -1 and 1 are cut.
    pub fn colour(&self, noise: f32) -> [f32; 3] {
        let noise = noise.clamp(-1.0, 1.0);
        std::array::from_fn(|i| self.mean[i] + self.half_range[i] * noise)
    }
}

/// The lattices of noise.
#[derive(Debug, Clone)]
pub(super) struct NoiseField {
    lattices: [ValueNoise; OCTAVES],
    /// What texels leave of them: nothing of cells that are as small as a texel.
    visible: [f32; OCTAVES],
}

impl NoiseField {
    /// For texels of a size, with a strength as `PaintStyle::variation`.
    pub(super) fn new(texel_m: f64, variation: f32) -> Self {
        let lattices = std::array::from_fn(|i| ValueNoise::new(CELLS_M[i], i as u64 + 1));
        let visible = CELLS_M.map(|cell_m| variation * (cell_m / texel_m - 1.0).clamp(0.0, 1.0) as f32);
        Self { lattices, visible }
    }

    /// The weighted sum for a pattern at a position in metres.
    pub(super) fn sum(&mut self, pattern: &Pattern, [x, y]: [f64; 2]) -> f32 {
        let mut sum = 0.0;
        for (octave, lattice) in self.lattices.iter_mut().enumerate() {
            let weight = pattern.shares[octave] * self.visible[octave];
            if weight > 0.0 {
                let [cos, sin] = AXES[octave];
                sum += weight * lattice.at([x * cos + y * sin, y * cos - x * sin]);
            }
        }
        sum
    }
}

/// Linear light of 8-bit sRGB, 0 to 1.
pub(super) fn to_linear(rgb: [u8; 3]) -> [f32; 3] {
    static TABLE: OnceLock<[f32; 256]> = OnceLock::new();
    let table = TABLE.get_or_init(|| {
        std::array::from_fn(|byte| {
            let v = byte as f64 / 255.0;
            (if v <= 0.04045 { v / 12.92 } else { libm::pow((v + 0.055) / 1.055, 2.4) }) as f32
        })
    });
    rgb.map(|byte| table[usize::from(byte)])
}

/// 8-bit sRGB of linear light. What is below 0 or above 1 is cut.
pub(super) fn to_srgb(linear: [f32; 3]) -> [u8; 3] {
    static TABLE: OnceLock<Vec<u8>> = OnceLock::new();
    let table = TABLE.get_or_init(|| {
        let encoded = |step: usize| {
            let v = step as f64 / ENCODE_STEPS as f64;
            let srgb = if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * libm::pow(v, 1.0 / 2.4) - 0.055 };
            (srgb * 255.0).round() as u8
        };
        (0..=ENCODE_STEPS).map(encoded).collect()
    });
    linear.map(|v| table[((v.clamp(0.0, 1.0) * ENCODE_STEPS as f32).round() as usize).min(ENCODE_STEPS)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_bytes_survive_linear_light() {
        for byte in 0..=255 {
            assert_eq!(to_srgb(to_linear([byte; 3])), [byte; 3]);
        }
        assert_eq!(to_srgb([-1.0, 2.0, 0.5]), [0, 255, 188]);
        assert!((to_linear([188; 3])[0] - 0.5).abs() < 0.004);
    }

    #[test]
    fn colours_stay_between_the_tones() {
        let pattern = Pattern::varied([[80, 90, 60], [100, 110, 70]], [0.5, 0.3, 0.3, 0.2]);
        let mut noise = NoiseField::new(0.25, 1.0);
        let mut seen = std::collections::BTreeSet::new();
        for i in 0..5000 {
            let position = [f64::from(i) * 0.7, f64::from(i) * 0.3];
            let rgb = to_srgb(pattern.colour(noise.sum(&pattern, position)));
            assert!((80..=100).contains(&rgb[0]) && (90..=110).contains(&rgb[1]) && (60..=70).contains(&rgb[2]));
            seen.insert(rgb[0]);
        }
        assert!(seen.len() > 10, "{seen:?}");
        assert_eq!(NoiseField::new(0.25, 0.0).sum(&pattern, [12.0, 5.0]), 0.0);
        assert_eq!(NoiseField::new(200.0, 1.0).sum(&pattern, [12.0, 5.0]), 0.0, "cells below a texel");
    }
}
