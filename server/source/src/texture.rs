//! Images on surfaces.

/// An image that colours triangles.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneTexture {
    /// In texels.
    pub width: u32,
    /// In texels.
    pub height: u32,
    /// `width * height` texels of 8-bit sRGB, row by row from the top.
    pub rgb: Vec<[u8; 3]>,
    /// Whether it is a generated pattern of few colours that repeats, with sides of a power of two.
    pub is_pattern: bool,
}
