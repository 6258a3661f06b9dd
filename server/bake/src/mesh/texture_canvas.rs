//! A texture while it is drawn: sums of linear light per texel.

use super::texture_encode::MaskedTexture;
use super::texture_fill::fill_unknown_texels;
use crate::columns::srgb::srgb_from_linear;
use glam::{Vec2, Vec3};
use insula_protocol::blockmap::Quality;
use std::sync::LazyLock;

/// Steps of the table that converts linear light to sRGB.
const SRGB_TABLE_STEPS: usize = 1 << 14;

/// Sum of the light that was added to one texel.
#[derive(Debug, Clone, Copy, Default)]
struct TexelSum {
    light: Vec3,
    weight: f32,
}

/// A texture that is being drawn.
pub(super) struct TextureCanvas {
    size: [u32; 2],
    sums: Vec<TexelSum>,
    /// Whether a triangle shows the texel; not set by [`Self::extend_into_padding`].
    is_shown: Vec<bool>,
}

impl TextureCanvas {
    pub(super) fn new(size: [u32; 2]) -> Self {
        let texels = (size[0] * size[1]) as usize;
        Self { size, sums: vec![TexelSum::default(); texels], is_shown: vec![false; texels] }
    }

    /// Adds what a triangle shows. `corners` are in texels relative to `origin`, and `light_at` takes barycentric
    /// weights.
    ///
    /// Each texel is sampled `taps` x `taps` times. A triangle that misses all sample points is sampled once in its
    /// middle.
    pub(super) fn draw_triangle(
        &mut self,
        corners: [Vec2; 3],
        origin: Vec2,
        taps: u32,
        light_at: impl Fn(Vec3) -> Vec3,
    ) {
        let p = corners;
        let double_area = (p[1] - p[0]).perp_dot(p[2] - p[0]);
        let low = (p[0].min(p[1]).min(p[2]) * taps as f32 - 0.5).ceil().as_ivec2();
        let high = (p[0].max(p[1]).max(p[2]) * taps as f32 - 0.5).floor().as_ivec2();
        let mut is_sampled = false;
        for row in low.y..=high.y {
            for column in low.x..=high.x {
                let at = (Vec2::new(column as f32, row as f32) + 0.5) / taps as f32;
                let weight = |i: usize, k: usize| (p[i] - at).perp_dot(p[k] - at) / double_area;
                let weights = Vec3::new(weight(1, 2), weight(2, 0), weight(0, 1));
                if double_area != 0.0 && weights.min_element() >= -1e-4 {
                    self.add(origin + at, light_at(weights));
                    is_sampled = true;
                }
            }
        }
        if !is_sampled {
            let middle = (p[0] + p[1] + p[2]) / 3.0;
            self.add(origin + middle, light_at(Vec3::splat(1.0 / 3.0)));
        }
    }

    /// Adds the same light to all texels of a rectangle.
    pub(super) fn fill_rectangle(&mut self, [x0, y0]: [u32; 2], [width, height]: [u32; 2], light: Vec3) {
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            self.add(Vec2::new((x0 + x) as f32, (y0 + y) as f32), light);
        }
    }

    /// Adds light to the texel at a position in texels.
    pub(super) fn add(&mut self, at: Vec2, light: Vec3) {
        let (x, y) = ((at.x as u32).min(self.size[0] - 1), (at.y as u32).min(self.size[1] - 1));
        let i = (y * self.size[0] + x) as usize;
        self.sums[i] = TexelSum { light: self.sums[i].light + light, weight: self.sums[i].weight + 1.0 };
        self.is_shown[i] = true;
    }

    /// Sets the texels of a rectangle that no triangle shows, but that touch some that one does, to the mean of these.
    pub(super) fn extend_into_padding(&mut self, [x0, y0]: [u32; 2], [width, height]: [u32; 2]) {
        let row = self.size[0];
        let index = |x: u32, y: u32| ((y0 + y) * row + x0 + x) as usize;
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let own = index(x, y);
            if self.is_shown[own] {
                continue;
            }
            let (mut sum, mut count) = (Vec3::ZERO, 0.0);
            for [dx, dy] in [[0i32, -1], [-1, 0], [1, 0], [0, 1], [-1, -1], [1, -1], [-1, 1], [1, 1]] {
                let (x, y) = (x.wrapping_add_signed(dx), y.wrapping_add_signed(dy));
                if x < width && y < height && self.is_shown[index(x, y)] {
                    let TexelSum { light, weight } = self.sums[index(x, y)];
                    sum += light / weight;
                    count += 1.0;
                }
            }
            if count > 0.0 {
                self.sums[own] = TexelSum { light: sum / count, weight: 1.0 };
            }
        }
    }

    /// Encodes the means of the texels as a WebP file. `None` if it is too large for a tile.
    pub(super) fn encode(&self, quality: Quality) -> Option<Vec<u8>> {
        let mut rgb: Vec<u8> = Vec::with_capacity(3 * self.sums.len());
        for sum in &self.sums {
            rgb.extend_from_slice(&quick_srgb(sum.light / sum.weight.max(1.0)));
        }
        let is_known: Vec<bool> = self.sums.iter().map(|sum| sum.weight > 0.0).collect();
        fill_unknown_texels(&mut rgb, self.size, &is_known);
        MaskedTexture { size: self.size, rgb: &rgb, is_shown: &self.is_shown }.encode(quality)
    }

    /// Encodes a texture of generated patterns and plain colours without loss. `None` if it is too large for a tile.
    pub(super) fn encode_pattern(&self) -> Option<Vec<u8>> {
        let mut rgb: Vec<u8> = Vec::with_capacity(3 * self.sums.len());
        let mut last = [0; 3];
        for sum in &self.sums {
            if sum.weight > 0.0 {
                last = quick_srgb(sum.light / sum.weight);
            }
            rgb.extend_from_slice(&last);
        }
        MaskedTexture { size: self.size, rgb: &rgb, is_shown: &self.is_shown }.encode(Quality::Lossless)
    }
}

/// Like `srgb_from_linear`, from a table; rarely off by one.
fn quick_srgb(light: Vec3) -> [u8; 3] {
    static TABLE: LazyLock<Vec<u8>> = LazyLock::new(|| {
        (0..=SRGB_TABLE_STEPS).map(|i| srgb_from_linear([i as f32 / SRGB_TABLE_STEPS as f32; 3])[0]).collect()
    });
    let table = TABLE.as_slice();
    let code = |v: f32| table[(v.clamp(0.0, 1.0) * SRGB_TABLE_STEPS as f32 + 0.5) as usize];
    [code(light.x), code(light.y), code(light.z)]
}
