//! Squares of several cells, where a raster is larger than what shows it.

use insula_export::raster::CellExtent;

/// The cells of an extent in squares. Each has the value of the cell in its middle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Samples {
    extent: CellExtent,
    /// Cells along the side of a square.
    pub(crate) every: u32,
    /// Columns and rows of squares. The last ones may reach over the border.
    pub(crate) size: [u32; 2],
}

impl Samples {
    /// The smallest squares of which at most so many lie along a side.
    pub(crate) fn of(extent: CellExtent, most: u32) -> Self {
        let every = extent.size.map(|side| side.div_ceil(most)).into_iter().max().unwrap_or(1).max(1);
        Self { extent, every, size: extent.size.map(|side| side.div_ceil(every)) }
    }

    /// The cell in the middle of a square, from the south-west.
    pub(crate) fn cell(&self, square: [u32; 2]) -> [u32; 2] {
        let cell = square.map(|k| k * self.every + self.every / 2);
        [0, 1].map(|k| self.extent.min[k] + cell[k].min(self.extent.size[k] - 1))
    }

    /// The cell at the south-western corner of a square, or the end of the extent.
    pub(crate) fn corner(&self, square: [u32; 2]) -> [u32; 2] {
        [0, 1].map(|k| self.extent.min[k] + (square[k] * self.every).min(self.extent.size[k]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_cover_the_extent() {
        let samples = Samples::of(CellExtent { min: [10, 20], size: [7, 4] }, 3);
        assert_eq!((samples.every, samples.size), (3, [3, 2]));
        assert_eq!([samples.cell([0, 0]), samples.cell([2, 1])], [[11, 21], [16, 23]]);
        assert_eq!([samples.corner([1, 1]), samples.corner([3, 2])], [[13, 23], [17, 24]]);
        assert_eq!(Samples::of(CellExtent { min: [0, 0], size: [3, 2] }, 3).every, 1);
    }
}
