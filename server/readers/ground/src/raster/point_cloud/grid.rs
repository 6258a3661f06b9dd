//! The raster's cells: where they are, and the height of each from its points.

use super::super::error::RasterError;
use super::super::facts::RasterSize;
use super::super::place::GeoPlace;
use super::header::Scaling;
use super::survey::KindSurvey;

/// Sizes of cells in metres: these, and ten times more, and so on.
const STEPS_M: [f64; 3] = [1.0, 2.0, 5.0];
/// Smaller sizes for dense clouds.
const SMALL_STEPS_M: [f64; 2] = [0.25, 0.5];
/// The mean distance of points is known so well only: cells may be smaller by this factor.
const TOLERANCE: f64 = 0.9;
/// Numbers of points in a cell are counted up to this.
const MAX_COUNT: u64 = 0xffff;
const COUNT_BITS: u32 = 16;

/// Where the cells are. Their borders are at multiples of the step, so that those of neighbouring clouds meet.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    /// Of the lowest cell's lowest corner, in steps.
    first: [f64; 2],
    step: [f64; 2],
    pub(super) step_m: f64,
    pub(super) size: RasterSize,
    /// Cells are larger than points are apart, because there would be too many.
    pub(super) is_coarse: bool,
}

impl Grid {
    /// A grid for points with a mean distance. Fails if there is no size of cells with at most `max_cells` of them.
    pub(super) fn new(
        points: &KindSurvey,
        scaling: &Scaling,
        distance_m: f64,
        unit_m: [f64; 2],
        max_cells: u64,
    ) -> Result<Self, RasterError> {
        let ends = [points.low, points.high].map(|[x, y]| scaling.position([x, y, 0]));
        let mut steps = sizes_m().skip_while(|step_m| *step_m < distance_m * TOLERANCE).enumerate();
        let grid = steps.find_map(|(number, step_m)| {
            let step = unit_m.map(|unit_m| step_m / unit_m);
            let first = [0, 1].map(|axis| (ends[0][axis] / step[axis]).floor());
            let [columns, rows] = [0, 1].map(|axis| (ends[1][axis] / step[axis]).floor() - first[axis] + 1.0);
            // Each is at least 1, so that both are small enough for the conversion.
            let fits = columns >= 1.0 && rows >= 1.0 && columns * rows <= max_cells as f64;
            let size = RasterSize { width: columns as u32, height: rows as u32 };
            let is_coarse = number > 0;
            (fits && max_cells <= u64::from(u32::MAX)).then_some(Self { first, step, step_m, size, is_coarse })
        });
        grid.ok_or_else(|| RasterError::damaged("its points are too far apart"))
    }

    /// Fails if the coordinates are too large.
    pub(super) fn place(&self) -> Result<GeoPlace, RasterError> {
        let top = self.first[1] + f64::from(self.size.height) - 0.5;
        let origin = [(self.first[0] + 0.5) * self.step[0], top * self.step[1]];
        let place = GeoPlace::checked(origin, [self.step[0], 0.0], [0.0, -self.step[1]]);
        place.ok_or_else(|| RasterError::damaged("its coordinates are too large"))
    }

    /// Index of the cell at a position, by row from the top.
    pub(super) fn index(&self, position: [f64; 2]) -> usize {
        let RasterSize { width, height } = self.size;
        let [column, row] = [0, 1].map(|axis| (position[axis] / self.step[axis]).floor() - self.first[axis]);
        let column = (column.max(0.0) as u32).min(width - 1);
        let row = height - 1 - (row.max(0.0) as u32).min(height - 1);
        row as usize * width as usize + column as usize
    }

    pub(super) fn cells(&self) -> usize {
        self.size.width as usize * self.size.height as usize
    }
}

/// All sizes of cells from small to large.
fn sizes_m() -> impl Iterator<Item = f64> {
    let large = (0..12).flat_map(|power| STEPS_M.map(|step| step * 10_f64.powi(power)));
    SMALL_STEPS_M.into_iter().chain(large)
}

/// What is known of the points in a cell, in the whole numbers of the file.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Cell {
    /// The sum of the heights above the lowest number that there is, and in the lowest bits their count.
    sum_and_count: u64,
    low: i32,
    high: i32,
}

impl Cell {
    /// Adds a point, unless the cell has too many.
    pub(super) fn add(&mut self, height: i32) {
        let count = self.sum_and_count & MAX_COUNT;
        if count == 0 {
            (self.low, self.high) = (height, height);
        } else if count == MAX_COUNT {
            return;
        }
        // 65,535 numbers of 32 bits need 48 bits.
        self.sum_and_count += (u64::from(height.abs_diff(i32::MIN)) << COUNT_BITS) + 1;
        self.low = self.low.min(height);
        self.high = self.high.max(height);
    }

    /// The mean height, of three or more points without the lowest and the highest one; `None` without points.
    ///
    /// It does not depend on the order of the points.
    pub(super) fn mean(&self) -> Option<f64> {
        let (sum, count) = (self.sum_and_count >> COUNT_BITS, self.sum_and_count & MAX_COUNT);
        let above = |height: i32| u64::from(height.abs_diff(i32::MIN));
        let (sum, count) = match count {
            0 => return None,
            1 | 2 => (sum, count),
            _ => (sum - above(self.low) - above(self.high), count - 2),
        };
        Some(sum as f64 / count as f64 + f64::from(i32::MIN))
    }

    /// The lowest height; `None` without points.
    pub(super) fn lowest(&self) -> Option<f64> {
        (self.sum_and_count & MAX_COUNT > 0).then_some(f64::from(self.low))
    }
}
