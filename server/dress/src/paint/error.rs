//! Why a picture cannot be painted.

/// Why a picture cannot be painted.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PaintError {
    #[error("texels of {0} m cannot be painted: their size must be from 1 cm to 1 km")]
    TexelSize(f64),
    #[error("a picture of {0} x {1} texels is too large: a side may have 16384, and all may be 67 million")]
    TooLarge(usize, usize),
    #[error("the picture's corner is not a position on the map")]
    Corner,
}
