//! The appearance of a voxel in four bytes.

/// Largest value of [`Texel::ao`].
pub const AO_MAX: u8 = 63;
/// Largest value of [`Texel::alpha`].
pub const ALPHA_MAX: u8 = 3;

/// Colour, ambient occlusion and coverage of one voxel, packed as r, g, b (8-bit sRGB), then `ao << 2 | alpha`.
///
/// GPU memory has the same 32 bits, r lowest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Texel(pub u32);

impl Texel {
    /// Empty: rays pass.
    pub const TRANSPARENT: Self = Self(0);

    /// `ao` is 0 (enclosed) to [`AO_MAX`] (open sky), `alpha` 0 (empty) to [`ALPHA_MAX`] (opaque). Both are clamped.
    pub fn new(rgb: [u8; 3], ao: u8, alpha: u8) -> Self {
        let [r, g, b] = rgb.map(u32::from);
        let (ao, alpha) = (u32::from(ao.min(AO_MAX)), u32::from(alpha.min(ALPHA_MAX)));
        Self(r | g << 8 | b << 16 | ao << 26 | alpha << 24)
    }

    /// Colour in 8-bit sRGB.
    pub fn rgb(self) -> [u8; 3] {
        let [r, g, b, _] = self.0.to_le_bytes();
        [r, g, b]
    }

    /// Ambient occlusion, 0 (enclosed) to [`AO_MAX`] (open sky).
    pub fn ao(self) -> u8 {
        (self.0 >> 26) as u8
    }

    /// Coverage, 0 (empty) to [`ALPHA_MAX`] (opaque).
    pub fn alpha(self) -> u8 {
        (self.0 >> 24) as u8 & ALPHA_MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_round_trip_and_are_clamped() {
        let texel = Texel::new([1, 2, 250], 63, 2);
        assert_eq!((texel.rgb(), texel.ao(), texel.alpha()), ([1, 2, 250], 63, 2));
        assert_eq!(Texel::new([0; 3], 200, 9), Texel::new([0; 3], 63, 3));
    }
}
