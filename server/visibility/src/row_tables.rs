//! Tables of a city's heights by rows across the main axis of lines.
//!
//! Lines that follow one axis more than the other cross the rows of squares across that axis one after the other. Where a bundle of
//! lines crosses a row, it covers a run of squares. The tables have the lowest solid and the highest top of runs whose length is a
//! power of two; two overlapping runs make any other. As rows do not depend on a line's direction, all cells and directions share
//! the tables, and bundles side by side read values side by side.

use crate::heights::CityHeights;

/// Bundles side by side that are followed at once.
pub(crate) const LANES: usize = 8;
/// Rows of a table are padded to a multiple of this, in squares.
const ROW_MULTIPLE: usize = 64;
/// Tables of solids have runs of 2 to 128 fine squares.
const SOLID_LEVELS: usize = 7;
/// Longest run of fine squares of which the lowest solid can be read.
pub(crate) const MAX_SOLID_RUN: usize = 255;
/// Tables of tops have blocks of 1 to 64 rows.
pub(crate) const TOP_LEVELS: usize = 7;
/// Longest run of squares of which the highest top can be read.
pub(crate) const MAX_TOP_RUN: usize = 512;
/// Fine squares before and after each row.
const SOLID_PADDING: usize = 2 * LANES + MAX_SOLID_RUN + 1;
/// Squares before and after each row.
const TOP_PADDING: usize = LANES + MAX_TOP_RUN;

/// Rows follow each other along `y`, or along `x`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum MainAxis {
    X,
    Y,
}

/// The lowest solid of runs of `2 << level` fine squares.
#[derive(Debug)]
struct SolidTable {
    /// Every so many fine rows have values, as a power of two.
    spacing_log: u32,
    /// The values of squares with even and with odd numbers are apart, so that those of neighbouring bundles are not.
    values: Vec<u16>,
}

/// Heights by rows. Lengths in squares, of which each has 2 x 2 fine squares.
#[derive(Debug)]
pub(crate) struct RowTables {
    pub(crate) rows: usize,
    pub(crate) columns: usize,
    /// Values of fine squares with even numbers in a row of a solid table.
    plane: usize,
    solids: Vec<SolidTable>,
    /// Values of a row of a table of tops.
    top_width: usize,
    /// By the level: the highest top in blocks of `1 << level` rows and `2 << level` squares.
    tops: Vec<Vec<u16>>,
}

impl RowTables {
    pub(crate) fn new(heights: &CityHeights, axis: MainAxis) -> Self {
        let (width, height) = (heights.width, heights.height);
        let (rows, columns) = match axis {
            MainAxis::X => (width, height),
            MainAxis::Y => (height, width),
        };
        let place = |row: usize, column: usize, width: usize| match axis {
            MainAxis::X => column * width + row,
            MainAxis::Y => row * width + column,
        };
        let top_width = columns + 2 * TOP_PADDING;
        let plane = columns + SOLID_PADDING;
        let mut tables = Self {
            rows: rows.next_multiple_of(ROW_MULTIPLE),
            columns,
            plane,
            solids: Vec::with_capacity(SOLID_LEVELS),
            top_width,
            tops: Vec::with_capacity(TOP_LEVELS),
        };
        let mut own = vec![0u16; tables.rows * top_width];
        for (row, values) in own.chunks_exact_mut(top_width).take(rows).enumerate() {
            for (column, value) in values[TOP_PADDING..].iter_mut().take(columns).enumerate() {
                *value = heights.tops[place(row, column, width)];
            }
        }
        tables.add_tops(own);
        let mut first = vec![0u16; 2 * rows * 2 * plane];
        for (row, values) in first.chunks_exact_mut(2 * plane).enumerate() {
            let solid = |column: usize| heights.solids[place(row, column, 2 * width)];
            for column in 0..2 * columns - 1 {
                let at = column + SOLID_PADDING;
                values[(at & 1) * plane + (at >> 1)] = solid(column).min(solid(column + 1));
            }
        }
        tables.add_solids(first);
        tables
    }

    /// Adds the tables of tops, the first of which comes from single squares.
    fn add_tops(&mut self, own: Vec<u16>) {
        let width = self.top_width;
        let joined = |values: &[u16], to: &mut [u16], step: usize| {
            for (i, to) in to.iter_mut().enumerate() {
                *to = (*to).max(values[i]).max(values.get(i + step).copied().unwrap_or(0));
            }
        };
        let mut last = own;
        for level in 0..TOP_LEVELS {
            let together = if level == 0 { 1 } else { 2 };
            let mut next = vec![0u16; last.len() / together];
            for (to, from) in next.chunks_exact_mut(width).zip(last.chunks_exact(width * together)) {
                from.chunks_exact(width).for_each(|row| joined(row, to, 1 << level));
            }
            if level > 0 {
                self.tops.push(std::mem::take(&mut last));
            }
            last = next;
        }
        self.tops.push(last);
    }

    /// Adds the tables of solids after the first.
    fn add_solids(&mut self, first: Vec<u16>) {
        self.solids.push(SolidTable { spacing_log: 0, values: first });
        for level in 1..SOLID_LEVELS {
            let last = &self.solids[level - 1];
            let spacing_log = level.saturating_sub(1) as u32;
            let skipped = spacing_log - last.spacing_log;
            let row = 2 * self.plane;
            let mut values = Vec::with_capacity((last.values.len() >> skipped) + row);
            for from in last.values.chunks_exact(row).step_by(1 << skipped) {
                for from in from.chunks_exact(self.plane) {
                    let step = 1 << (level - 1);
                    values.extend((0..self.plane).map(|i| from[i].min(from.get(i + step).copied().unwrap_or(0))));
                }
            }
            self.solids.push(SolidTable { spacing_log, values });
        }
    }

    /// The lowest solids of runs of `count` fine squares in a fine row, a multiple of `1 << row_log`, that begin at `first` and at
    /// every second square after it. `count` is 2 to [`MAX_SOLID_RUN`]; some of the runs lie within the row.
    #[inline(always)]
    pub(crate) fn solids(&self, row: usize, row_log: u32, first: i32, count: usize) -> [u16; LANES] {
        let level = (count.ilog2() - 1).min(row_log + 1).min(SOLID_LEVELS as u32 - 1);
        let table = &self.solids[level as usize];
        let length = 2usize << level;
        let row = (row >> table.spacing_log) * 2 * self.plane;
        let mut offset = 0;
        let mut lowest = [u16::MAX; LANES];
        loop {
            let at = (first + (offset + SOLID_PADDING) as i32) as usize;
            let at = row + (at & 1) * self.plane + (at >> 1);
            let values = table.values.get(at..).and_then(|values| values.first_chunk()).unwrap_or(&[0; LANES]);
            for lane in 0..LANES {
                lowest[lane] = values[lane].min(lowest[lane]);
            }
            if offset + length >= count {
                return lowest;
            }
            offset = (offset + length).min(count - length);
        }
    }

    /// The highest tops of runs of `count` squares in block `block` of `1 << level` rows, that begin at `first` and at every square
    /// after it. `count` is at most [`MAX_TOP_RUN`]; some of the runs lie within the row.
    #[inline(always)]
    pub(crate) fn tops(&self, block: usize, level: usize, first: i32, count: usize) -> [u16; LANES] {
        let length = 2usize << level;
        let row = block * self.top_width;
        let mut offset = 0;
        let mut highest = [0; LANES];
        loop {
            let at = row + (first + (offset + TOP_PADDING) as i32) as usize;
            let values = self.tops[level].get(at..).and_then(|values| values.first_chunk());
            let values = values.unwrap_or(&[u16::MAX; LANES]);
            for lane in 0..LANES {
                highest[lane] = values[lane].max(highest[lane]);
            }
            if offset + length >= count {
                return highest;
            }
            offset = (offset + length).min(count - length);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::rng::Rng;

    #[test]
    fn runs_have_the_lowest_solid_and_the_highest_top() {
        let mut rng = Rng::new(1);
        let heights = CityHeights::of_squares([3, 2], |_| rng.below(5000) as u16);
        for axis in [MainAxis::X, MainAxis::Y] {
            let tables = RowTables::new(&heights, axis);
            let value = |values: &[u16], width: usize, row: i32, column: i32| {
                let (x, y) = if axis == MainAxis::X { (row, column) } else { (column, row) };
                let is_inside = x >= 0 && y >= 0 && x < width as i32 && (y as usize) < values.len() / width;
                if is_inside { values[y as usize * width + x as usize] } else { 0 }
            };
            for _ in 0..2_000 {
                let (row_log, level) = (rng.below_u32(4), rng.below_u32(TOP_LEVELS as u32));
                let row = rng.below((2 * tables.rows) >> row_log) << row_log;
                let first = rng.below(2 * tables.columns) as i32 - 20;
                let count = 2 + rng.below(MAX_SOLID_RUN - 1);
                let solids = tables.solids(row, row_log, first, count);
                for (lane, found) in (0..).zip(solids) {
                    let run = first + 2 * lane..first + 2 * lane + count as i32;
                    let lowest = run.map(|column| value(&heights.solids, 2 * heights.width, row as i32, column)).min();
                    assert_eq!(Some(found), lowest, "row {row}, run of {count} from {first}, lane {lane}");
                }
                let (first, count) = (first / 2, 1 + rng.below(64));
                let block = rng.below(tables.rows >> level);
                let tops = tables.tops(block, level as usize, first, count);
                for (lane, found) in (0..).zip(tops) {
                    let rows = (block << level) as i32..((block + 1) << level) as i32;
                    // A run is at least as long as the table's.
                    let run = first + lane..first + lane + count.max(2 << level) as i32;
                    let all = rows.flat_map(|row| run.clone().map(move |column| (row, column)));
                    let highest = all.map(|(row, column)| value(&heights.tops, heights.width, row, column)).max();
                    assert_eq!(
                        Some(found),
                        highest,
                        "block {block} of level {level}, run of {count} from {first}, lane {lane}"
                    );
                }
            }
        }
    }
}
