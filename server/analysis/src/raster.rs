//! Rasters whose rows run along either axis of the map, so that sweeps read memory in order.

/// PlaceValues of cells, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Raster<T> {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) values: Vec<T>,
}

/// Side of the blocks in which rasters are transposed: a block of each side stays in the first cache.
const BLOCK: usize = 32;

impl<T: Copy> Raster<T> {
    pub(crate) fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, values: vec![value; width * height] }
    }

    pub(crate) fn row(&self, y: usize) -> &[T] {
        &self.values[y * self.width..][..self.width]
    }

    pub(crate) fn row_mut(&mut self, y: usize) -> &mut [T] {
        &mut self.values[y * self.width..][..self.width]
    }

    /// The raster with rows as columns.
    pub(crate) fn transposed(&self) -> Self {
        let Some(first) = self.values.first() else {
            return Self { width: self.height, height: self.width, values: Vec::new() };
        };
        let mut out = Self::filled(self.height, self.width, *first);
        for y0 in (0..self.height).step_by(BLOCK) {
            for x0 in (0..self.width).step_by(BLOCK) {
                for y in y0..(y0 + BLOCK).min(self.height) {
                    for x in x0..(x0 + BLOCK).min(self.width) {
                        out.values[x * self.height + y] = self.values[y * self.width + x];
                    }
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transposing_twice_changes_nothing() {
        let raster = Raster { width: 70, height: 33, values: (0..70 * 33).collect::<Vec<i32>>() };
        let other = raster.transposed();
        assert_eq!((other.width, other.height, other.row(3)[5]), (33, 70, raster.row(5)[3]));
        assert_eq!(other.transposed(), raster);
        assert_eq!(Raster::<u8> { width: 0, height: 7, values: Vec::new() }.transposed().width, 7);
    }
}
