//! What a corner of a triangle may carry besides its place.
//!
//! In: floating-point values. Out: whole numbers. Next: `attributes`.

/// What an attribute means; the codec guesses accordingly.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AttributeKind {
    /// Unit vectors, two octahedral components ([`crate::octahedral`]).
    Normal,
    /// Components of a colour.
    Colour,
    /// Two components, on a grid of their own.
    TexCoord,
    /// Anything else.
    Other,
}

impl AttributeKind {
    pub(super) const ALL: [Self; 4] = [Self::Normal, Self::Colour, Self::TexCoord, Self::Other];
}

/// Values of corners, as whole numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Attribute {
    /// What they mean.
    pub kind: AttributeKind,
    /// Numbers of a value that count, 1 to 4.
    pub components: u8,
    /// Bits of each number, 1 to 16.
    pub bits: u8,
    /// What 0 stands for, and how much one more is; carried, not used.
    pub range: [f32; 2],
    /// Values; components that do not count are 0.
    pub values: Vec<[u32; 4]>,
    /// For each corner `3 t + k`, its value.
    pub corners: Vec<u32>,
}
