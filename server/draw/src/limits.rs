//! How much a drawing may be.

/// Most triangles and parts of a drawing. The default is what a machine with 8 GiB of memory draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DrawLimits {
    /// Triangles that are read, and faces after the splits of the BSP tree. Each takes about a kilobyte until the drawing is written.
    pub triangles: usize,
    /// Visible parts of surfaces before they are joined.
    pub parts: usize,
}

impl Default for DrawLimits {
    fn default() -> Self {
        Self { triangles: 4_000_000, parts: 16_000_000 }
    }
}

impl DrawLimits {
    /// Limits of a drawing of so many triangles. Splits and parts get a multiple of them.
    #[must_use]
    pub fn of_triangles(triangles: usize) -> Self {
        let of_all = Self::default();
        Self { triangles, parts: triangles.saturating_mul(of_all.parts / of_all.triangles) }
    }
}
