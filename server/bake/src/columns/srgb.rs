//! 8-bit sRGB and linear light (IEC 61966-2-1).

use glam::Vec3;
use std::sync::LazyLock;

static LINEAR_OF_SRGB: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let v = i as f32 / 255.0;
        if v <= 0.04045 { v / 12.92 } else { libm::powf((v + 0.055) / 1.055, 2.4) }
    })
});

/// An 8-bit sRGB colour as linear light, 0 to 1.
#[inline]
pub(crate) fn linear_from_srgb([r, g, b]: [u8; 3]) -> Vec3 {
    let table = &*LINEAR_OF_SRGB;
    Vec3::new(table[usize::from(r)], table[usize::from(g)], table[usize::from(b)])
}

/// Linear light, clamped to 0 to 1, as 8-bit sRGB.
pub(crate) fn srgb_from_linear(rgb: [f32; 3]) -> [u8; 3] {
    rgb.map(|v| {
        let v = v.clamp(0.0, 1.0);
        let s = if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * libm::powf(v, 1.0 / 2.4) - 0.055 };
        (s * 255.0 + 0.5) as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_srgb_value_survives_a_round_trip() {
        for v in 0..=255 {
            assert_eq!(srgb_from_linear(linear_from_srgb([v; 3]).to_array()), [v; 3]);
        }
    }
}
