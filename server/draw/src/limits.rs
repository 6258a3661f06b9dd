//! How much a drawing may be.

/// Most triangles and parts of a drawing. The default is what a machine with 8 GiB of memory draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DrawLimits {
    /// Triangles that are read. Each takes about a kilobyte until the drawing is written. The BSP tree may split them into twice as many.
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
    /// Most faces of a view after the splits of the BSP tree, and most splits.
    pub(crate) fn faces(&self) -> usize {
        self.triangles.saturating_mul(2)
    }

    /// Limits of a drawing of so many triangles. Splits and parts get a multiple of them.
    #[must_use]
    pub fn of_triangles(triangles: usize) -> Self {
        let of_all = Self::default();
        Self { triangles, parts: triangles.saturating_mul(of_all.parts / of_all.triangles) }
    }
}
