//! Texels of a block's samples: the mean of their colours in linear light.

use crate::paint::canvas::{BLOCK_SAMPLES, BLOCK_TEXELS, Brush, TEXEL_SAMPLES};
use crate::paint::material::PaintMaterial;
use crate::paint::palette::PaintStyle;
use crate::paint::pattern::{NoiseField, to_srgb};

/// Samples of a texel.
const COUNT: usize = TEXEL_SAMPLES * TEXEL_SAMPLES;
/// Distance of a field's rows, as they are sown or as wheels leave them.
const ROW_M: f64 = 3.0;
/// How much rows differ, of the range between a field's tones.
const ROW_SHARE: f32 = 0.12;

/// Makes colours of samples.
pub(super) struct Resolver<'s> {
    style: &'s PaintStyle,
    noise: NoiseField,
    texel_m: f64,
    /// What texels leave of the rows of fields.
    rows_visible: f32,
}

impl<'s> Resolver<'s> {
    pub(super) fn new(style: &'s PaintStyle, texel_m: f64) -> Self {
        let rows_visible = (ROW_M / texel_m / 2.0 - 1.0).clamp(0.0, 1.0) as f32 * style.variation;
        Self { style, noise: NoiseField::new(texel_m, style.variation), texel_m, rows_visible }
    }

    /// The texels of a block, in rows from the south: 8-bit sRGB, and how much of the texel is painted. `first` is the
    /// number of its south-western texel on the map.
    pub(super) fn texels(&mut self, samples: &[[u8; 4]], first: [i64; 2]) -> Vec<[u8; 4]> {
        let mut texels = Vec::with_capacity(BLOCK_TEXELS * BLOCK_TEXELS);
        for (y, rows) in samples.chunks_exact(BLOCK_SAMPLES * TEXEL_SAMPLES).enumerate() {
            for x in 0..BLOCK_TEXELS {
                // Of a block with a road through it, most is not painted.
                let of_texel = |row: &[[u8; 4]]| row[x * TEXEL_SAMPLES..][..TEXEL_SAMPLES] == [[0; 4]; TEXEL_SAMPLES];
                if rows.chunks_exact(BLOCK_SAMPLES).all(of_texel) {
                    texels.push([0; 4]);
                    continue;
                }
                let mut found = [[0; 4]; COUNT];
                for (found, row) in found.chunks_exact_mut(TEXEL_SAMPLES).zip(rows.chunks_exact(BLOCK_SAMPLES)) {
                    found.copy_from_slice(&row[x * TEXEL_SAMPLES..][..TEXEL_SAMPLES]);
                }
                // Blocks are smaller than the numbers of texels, which are whole numbers in f64.
                let number = [first[0] + x as i64, first[1] + y as i64];
                texels.push(self.texel(&found, number.map(|n| (n as f64 + 0.5) * self.texel_m)));
            }
        }
        texels
    }

    fn texel(&mut self, samples: &[[u8; 4]; COUNT], middle: [f64; 2]) -> [u8; 4] {
        let first = samples[0];
        if samples.iter().all(|sample| *sample == first) {
            let Some(linear) = self.colour(first, middle) else { return [0; 4] };
            let [r, g, b] = to_srgb(linear);
            return [r, g, b, u8::MAX];
        }
        let (mut sum, mut painted) = ([0.0; 3], 0u8);
        let mut last = (first, self.colour(first, middle));
        for sample in samples {
            if *sample != last.0 {
                last = (*sample, self.colour(*sample, middle));
            }
            if let Some(linear) = last.1 {
                painted += 1;
                sum = std::array::from_fn(|i| sum[i] + linear[i]);
            }
        }
        let [r, g, b] = to_srgb(sum.map(|v| v / f32::from(painted)));
        [r, g, b, (f32::from(painted) * 255.0 / COUNT as f32).round() as u8]
    }

    /// Colour of a sample in linear light; `None` where nothing was painted.
    fn colour(&mut self, [number, direction, tone, alpha]: [u8; 4], middle: [f64; 2]) -> Option<[f32; 3]> {
        if alpha == 0 {
            return None;
        }
        let material = *PaintMaterial::ALL.get(usize::from(number))?;
        let pattern = self.style.pattern(material);
        let mut noise = self.noise.sum(pattern, middle);
        noise += (f32::from(tone) - f32::from(Brush::NEUTRAL_TONE)) / 127.0 * self.style.variation;
        if material == PaintMaterial::Farmland && self.rows_visible > 0.0 {
            noise += ROW_SHARE * self.rows_visible * row_wave(direction, middle);
        }
        Some(pattern.colour(noise))
    }
}

/// A wave across rows of a direction, from -1 to 1.
fn row_wave(direction: u8, [x, y]: [f64; 2]) -> f32 {
    let (sin, cos) = libm::sincos(f64::from(direction) * std::f64::consts::PI / 256.0);
    let share = ((y * cos - x * sin) / ROW_M).rem_euclid(1.0) as f32;
    let triangle = (share - 0.5).abs() * 2.0;
    triangle * triangle * (3.0 - 2.0 * triangle) * 2.0 - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texel(samples: [Option<PaintMaterial>; COUNT]) -> [u8; 4] {
        let style = PaintStyle::default();
        let samples = samples.map(|material| material.map_or([0; 4], |m| [m as u8, 0, Brush::NEUTRAL_TONE, 255]));
        Resolver::new(&style, 0.25).texel(&samples, [3.0, 4.0])
    }

    #[test]
    fn a_texel_is_the_mean_in_linear_light() {
        use PaintMaterial::{Asphalt, Marking};
        assert_eq!(texel([None; COUNT]), [0; 4]);
        assert_eq!(texel([Some(Asphalt); COUNT]), [160, 162, 164, 255]);
        let mut samples = [None; COUNT];
        samples[5] = Some(Asphalt);
        assert_eq!(texel(samples), [160, 162, 164, 16], "alpha is the painted share");
        let half = std::array::from_fn(|i| Some(if i % 2 == 0 { Asphalt } else { Marking }));
        let [r, _, _, alpha] = texel(half);
        // (0.138 + 0.527) / 2 = 0.333
        assert_eq!((r, alpha), (200, 255));
    }

    #[test]
    fn rows_follow_their_direction() {
        // Along the rows nothing changes.
        for (direction, step) in [(0, [1.0, 0.0]), (64, [1.0, 1.0]), (128, [0.0, 1.0])] {
            let wave = |distance: f64| row_wave(direction, step.map(|v: f64| 100.0 + distance * v));
            assert!((wave(0.0) - wave(12.3)).abs() < 1e-3, "{direction}");
            let across = |distance: f64| row_wave(direction, [100.0 - distance * step[1], 100.0 + distance * step[0]]);
            let length = libm::hypot(step[0], step[1]);
            assert!((across(0.0) - across(ROW_M / 2.0 / length)).abs() > 0.1, "{direction}");
        }
    }
}
