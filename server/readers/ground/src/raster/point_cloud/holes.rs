//! Fills small holes, such as those under roofs, with a surface that is as smooth as a membrane on their rim.
//!
//! The surface is that of Laplace's equation. It is solved on smaller copies of the grid first, each of which is the
//! start for the next larger one.

use super::super::facts::RasterSize;

/// Rounds in which each cell of a hole becomes the mean of its neighbours, of the grid itself. Smaller copies have
/// twice as many each.
const ROUNDS: u32 = 32;
const MAX_ROUNDS: u32 = 256;
/// Cells are moved further than to the mean, which takes fewer rounds.
const OVER_RELAXATION: f32 = 1.7;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum CellState {
    /// It stays without a height.
    Outside,
    Hole,
    Known,
}

/// The grid or a smaller copy of it.
struct Level {
    width: usize,
    height: usize,
    /// NaN outside, and in holes that are not filled yet.
    heights: Vec<f32>,
    states: Vec<CellState>,
}

/// Gives a height to cells that have none (NaN), and that are in a gap of their row or column with at most `max_gap`
/// cells.
pub(super) fn fill(heights: Vec<f32>, size: RasterSize, max_gap: usize) -> Vec<f32> {
    let (width, height) = (size.width as usize, size.height as usize);
    let states = states(&heights, width, max_gap);
    let mut levels = vec![Level { width, height, heights, states }];
    while let Some(smaller) = levels.last().and_then(Level::smaller) {
        levels.push(smaller);
    }
    let mut rounds = ROUNDS << (levels.len() - 1).min(8);
    let mut filled = levels.pop();
    while let Some(mut larger) = levels.pop() {
        rounds = (rounds / 2).max(ROUNDS);
        if let Some(smaller) = filled {
            larger.start_from(&smaller);
            larger.relax(rounds.min(MAX_ROUNDS));
        }
        filled = Some(larger);
    }
    filled.map(|level| level.heights).unwrap_or_default()
}

fn states(heights: &[f32], width: usize, max_gap: usize) -> Vec<CellState> {
    let state = |height: &f32| if height.is_nan() { CellState::Outside } else { CellState::Known };
    let mut states: Vec<CellState> = heights.iter().map(state).collect();
    // Row of the last known cell of each column.
    let mut above = vec![None; width];
    for row in 0..heights.len() / width {
        let mut left = None;
        for column in 0..width {
            let index = row * width + column;
            if heights[index].is_nan() {
                continue;
            }
            if let Some(left) = left.replace(column).filter(|left| column - left - 1 <= max_gap) {
                states[row * width + left + 1..index].fill(CellState::Hole);
            }
            if let Some(above) = above[column].replace(row).filter(|above| row - above - 1 <= max_gap) {
                (above + 1..row).for_each(|row| states[row * width + column] = CellState::Hole);
            }
        }
    }
    states
}

impl Level {
    /// A copy with half the columns and rows; `None` if that is of no use.
    fn smaller(&self) -> Option<Self> {
        if self.width.max(self.height) == 1 || !self.states.contains(&CellState::Hole) {
            return None;
        }
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let (mut heights, mut states) = (Vec::new(), Vec::new());
        for index in 0..width * height {
            let (mut sum, mut count, mut has_hole) = (0.0, 0.0, false);
            for part in 0..4 {
                let (column, row) = (index % width * 2 + part % 2, index / width * 2 + part / 2);
                if column >= self.width || row >= self.height {
                    continue;
                }
                let index = row * self.width + column;
                match self.states[index] {
                    CellState::Known => (sum, count) = (sum + self.heights[index], count + 1.0),
                    CellState::Hole => has_hole = true,
                    CellState::Outside => {}
                }
            }
            heights.push(if count > 0.0 { sum / count } else { f32::NAN });
            states.push(match (count > 0.0, has_hole) {
                (true, _) => CellState::Known,
                (false, true) => CellState::Hole,
                (false, false) => CellState::Outside,
            });
        }
        Some(Self { width, height, heights, states })
    }

    /// Sets holes to the heights of a smaller copy, bilinear between its cells.
    fn start_from(&mut self, smaller: &Self) {
        for row in 0..self.height {
            for column in 0..self.width {
                let index = row * self.width + column;
                if self.states[index] == CellState::Hole {
                    self.heights[index] = smaller.between(column, row);
                }
            }
        }
    }

    /// The height at a cell of the next larger copy.
    fn between(&self, column: usize, row: usize) -> f32 {
        // The second cell is on the side of the larger copy's cell.
        let pair = |at: usize| [(Some(at / 2), 0.75), ((at / 2 + at % 2 * 2).checked_sub(1), 0.25)];
        let (mut sum, mut weights) = (0.0, 0.0);
        for (row, row_weight) in pair(row) {
            for (column, column_weight) in pair(column) {
                let Some(index) = row.zip(column).and_then(|(row, column)| self.index(column, row)) else { continue };
                if self.states[index] != CellState::Outside {
                    sum += self.heights[index] * row_weight * column_weight;
                    weights += row_weight * column_weight;
                }
            }
        }
        sum / weights
    }

    fn index(&self, column: usize, row: usize) -> Option<usize> {
        (column < self.width && row < self.height).then(|| row * self.width + column)
    }

    /// Moves the holes' heights towards the means of their neighbours.
    fn relax(&mut self, rounds: u32) {
        for round in 0..rounds {
            // The last round goes to the means, which leaves no ripples.
            let factor = if round + 1 == rounds { 1.0 } else { OVER_RELAXATION };
            for index in 0..self.heights.len() {
                if self.states[index] == CellState::Hole {
                    let mean = self.mean_around(index);
                    self.heights[index] += (mean - self.heights[index]) * factor;
                }
            }
        }
    }

    /// Mean height of the four neighbours that have one.
    fn mean_around(&self, index: usize) -> f32 {
        let (column, row) = (index % self.width, index / self.width);
        let neighbours = [
            (column > 0).then(|| index - 1),
            (column + 1 < self.width).then_some(index + 1),
            (row > 0).then(|| index - self.width),
            (row + 1 < self.height).then_some(index + self.width),
        ];
        let (mut sum, mut count) = (0.0, 0.0);
        for neighbour in neighbours.into_iter().flatten() {
            if self.states[neighbour] != CellState::Outside {
                (sum, count) = (sum + self.heights[neighbour], count + 1.0);
            }
        }
        if count > 0.0 { sum / count } else { self.heights[index] }
    }
}
