//! The lowest or highest height around each cell, in a time that does not depend on how far around.

use super::super::facts::RasterSize;

/// Which height is wanted of a square of cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Extreme {
    Lowest,
    Highest,
}

impl Extreme {
    /// The more extreme height; NaN only if both are.
    fn of(self, a: f32, b: f32) -> f32 {
        match self {
            Self::Lowest => a.min(b),
            Self::Highest => a.max(b),
        }
    }

    /// Replaces each height by the extreme one of the square that reaches `radius` cells from it. NaN counts as no
    /// height, and stays only where the square has none.
    pub(super) fn of_squares(self, heights: &mut [f32], size: RasterSize, radius: usize) {
        let (width, height) = (size.width as usize, size.height as usize);
        let mut scratch = Scratch::default();
        for row in heights.chunks_exact_mut(width) {
            scratch.line.clear();
            scratch.line.extend_from_slice(row);
            scratch.run(self, radius);
            row.copy_from_slice(&scratch.line);
        }
        for column in 0..width {
            scratch.line.clear();
            scratch.line.extend((0..height).map(|row| heights[row * width + column]));
            scratch.run(self, radius);
            for (row, value) in scratch.line.iter().enumerate() {
                heights[row * width + column] = *value;
            }
        }
    }
}

/// Memory for the heights of a line of cells.
#[derive(Default)]
struct Scratch {
    line: Vec<f32>,
    /// Extremes from the start of a block to each cell, and from each cell to the end of its block.
    from_start: Vec<f32>,
    to_end: Vec<f32>,
}

impl Scratch {
    /// Van Herk's method: with blocks as long as the window, each window is the end of a block and the start of the
    /// next one.
    fn run(&mut self, extreme: Extreme, radius: usize) {
        let (len, window) = (self.line.len(), 2 * radius + 1);
        self.from_start.clone_from(&self.line);
        self.to_end.clone_from(&self.line);
        for block in self.from_start.chunks_mut(window) {
            for i in 1..block.len() {
                block[i] = extreme.of(block[i], block[i - 1]);
            }
        }
        for block in self.to_end.chunks_mut(window) {
            for i in (1..block.len()).rev() {
                block[i - 1] = extreme.of(block[i - 1], block[i]);
            }
        }
        for i in 0..len {
            let (first, last) = (i.saturating_sub(radius), (i + radius).min(len - 1));
            // A window within one block starts or ends with it: it is a whole block, or cut off by an end of the line.
            self.line[i] = match (first / window == last / window, first % window) {
                (true, 0) => self.from_start[last],
                (true, _) => self.to_end[first],
                (false, _) => extreme.of(self.to_end[first], self.from_start[last]),
            };
        }
    }
}
