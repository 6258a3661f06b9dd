//! The appearance of a voxel in four bytes.

/// Largest value of [`Texel::ao`].
pub const AO_MAX: u8 = 63;
/// The coverage of an opaque texel in its bits. An open one has none of them; other values do not occur.
pub const OPAQUE: u32 = 3 << 24;

/// Colour and ambient occlusion of one voxel, or an open one, packed as r, g, b (8-bit sRGB), then `ao << 2 | coverage`.
///
/// GPU memory has the same 32 bits, r lowest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Texel(pub u32);

impl Texel {
    /// Nothing: rays pass.
    pub const OPEN: Self = Self(0);

    /// An opaque texel. `ao` is 0 (enclosed) to [`AO_MAX`] (open sky), and clamped.
    pub fn new(rgb: [u8; 3], ao: u8) -> Self {
        let [r, g, b] = rgb.map(u32::from);
        Self(r | g << 8 | b << 16 | u32::from(ao.min(AO_MAX)) << 26 | OPAQUE)
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

    /// Whether rays pass.
    pub fn is_open(self) -> bool {
        self.0 & OPAQUE == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_round_trip_and_are_clamped() {
        let texel = Texel::new([1, 2, 250], 62);
        assert_eq!((texel.rgb(), texel.ao(), texel.is_open()), ([1, 2, 250], 62, false));
        assert_eq!(Texel::new([0; 3], 200), Texel::new([0; 3], 63));
        assert!(Texel::OPEN.is_open());
    }
}
