//! Attributes: integer values that triangle corners carry besides their position.

/// The meaning of an attribute, which selects how the codec predicts its values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AttributeKind {
    /// Unit vectors as two octahedral components ([`crate::octahedral`]).
    Normal,
    Colour,
    /// Texture coordinates, two components.
    TexCoord,
    Other,
}

impl AttributeKind {
    pub(super) const ALL: [Self; 4] = [Self::Normal, Self::Colour, Self::TexCoord, Self::Other];
}

/// An attribute of all corners. Corners may share values.
#[derive(Debug, Clone, PartialEq)]
pub struct Attribute {
    pub kind: AttributeKind,
    /// Number of used components of a value, 1 to 4.
    pub components: u8,
    /// Bits per component, 1 to 16.
    pub bits: u8,
    /// Real value of 0, and real size of one step, in the attribute's own unit. The codec only transports them.
    pub range: [f32; 2],
    /// Distinct values. Unused components are 0.
    pub values: Vec<[u32; 4]>,
    /// For each corner `3 t + k`, an index into `values`.
    pub corners: Vec<u32>,
}

impl Attribute {
    /// Colours in 8-bit sRGB, and the number of one for each corner.
    pub fn colours(rgb: impl IntoIterator<Item = [u8; 3]>, corners: Vec<u32>) -> Self {
        let values = rgb.into_iter().map(|[r, g, b]| [r.into(), g.into(), b.into(), 0]).collect();
        Self { kind: AttributeKind::Colour, components: 3, bits: 8, range: [0.0, 1.0 / 255.0], values, corners }
    }
}
