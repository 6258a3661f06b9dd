//! 8-bit sRGB and linear light (IEC 61966-2-1).

use glam::Vec3;
use std::sync::LazyLock;

static LINEAR_OF_SRGB: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let v = i as f32 / 255.0;
        if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    })
});

/// An 8-bit sRGB colour as linear light.
pub(crate) fn linear(rgb: [u8; 3]) -> Vec3 {
    Vec3::from_array(rgb.map(|v| LINEAR_OF_SRGB[usize::from(v)]))
}

/// Linear light, 0 to 1, as 8-bit sRGB.
pub(crate) fn srgb(rgb: [f32; 3]) -> [u8; 3] {
    rgb.map(|v| {
        let v = v.clamp(0.0, 1.0);
        let s = if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
        (s * 255.0 + 0.5) as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_round_trips() {
        for v in 0..=255 {
            assert_eq!(srgb(linear([v; 3]).to_array()), [v; 3]);
        }
    }
}
