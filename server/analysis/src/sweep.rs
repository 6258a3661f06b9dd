//! Sweeps over a height field: the lines of one direction, all cells of a row at a time.
//!
//! A line runs along a direction on the map. From row to row it moves by the direction's slope, and it passes the cell that is nearest. All
//! lines are parallel, so that all of them move by the same whole number of cells from one row to the next, and a row of lines lies beside
//! a row of cells. Each cell lies on exactly one line: the work is constant for each cell, however far away what hides it stands.

use crate::raster::Raster;

/// A direction on the map, of unit length; x east, y north.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Heading {
    pub(crate) x: f64,
    pub(crate) y: f64,
}

impl Heading {
    /// `azimuth_deg` is from the grid's north over east.
    pub(crate) fn of_azimuth(azimuth_deg: f64) -> Self {
        let (x, y) = azimuth_deg.to_radians().sin_cos();
        Self { x, y }
    }

    /// Whether lines advance from column to column instead of from row to row.
    pub(crate) fn is_transposed(self) -> bool {
        self.x.abs() > self.y.abs()
    }
}

/// How lines pass through the rows of a raster, of which columns are rows if the heading says so.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lines {
    width: usize,
    height: usize,
    /// Whether the first row is the last one of the raster.
    is_reversed: bool,
    /// Cells along the row for each row, towards the origin of the lines; -1 to 1.
    slope: f64,
    /// Length of a line from row to row in cells.
    pub(crate) step: f64,
}

impl Lines {
    /// Lines that come from where `towards` points. `width` and `height` are those of the raster that is swept, after it was transposed.
    pub(crate) fn new(towards: Heading, width: usize, height: usize) -> Self {
        let (along, across) = if towards.is_transposed() { (towards.x, towards.y) } else { (towards.y, towards.x) };
        let main = along.abs().max(f64::MIN_POSITIVE);
        Self { width, height, is_reversed: along > 0.0, slope: across / main, step: 1.0 / main }
    }

    /// Number of lines.
    pub(crate) fn count(&self) -> usize {
        self.width + self.drift(self.height.saturating_sub(1)).unsigned_abs()
    }

    /// Cells by which the lines have moved after so many rows.
    fn drift(&self, rows: usize) -> isize {
        (self.slope * rows as f64).round() as isize
    }

    /// The rows in the order in which the lines pass them, with the line of each row's first cell.
    pub(crate) fn rows(self) -> impl Iterator<Item = (usize, usize)> {
        let all = self.drift(self.height.saturating_sub(1));
        (0..self.height).map(move |i| {
            let row = if self.is_reversed { self.height - 1 - i } else { i };
            // Looking back to the origin, a line comes from a cell further along `slope`: in this row it starts that much before.
            let first = if all >= 0 { self.drift(i) } else { self.drift(i) - all };
            (row, first.unsigned_abs())
        })
    }
}

/// A cell that is higher than the next one by more than this many sides of a cell ends there with a wall, halfway between their middles.
/// Others are parts of a slope.
pub(crate) const WALL_SLOPE: f64 = 2.0;

/// Heights of columns are rounded to a sixteenth of a cell: a top is in shadow when more than this of it is.
pub(crate) const TOLERANCE_M: f32 = 0.1;

/// Passes each row to `visit` with the height up to which each of its cells is in the shadow of obstacles towards a light; negative
/// infinity in the open. A cell's own top is no part of its shadow. `slope` is the tangent of the light's altitude. `tops` is transposed
/// if the heading says so.
pub(crate) fn sweep_shadows(
    tops: &Raster<f32>,
    cell_m: f64,
    towards: Heading,
    slope: f64,
    shadows: &mut Shadows,
    mut visit: impl FnMut(usize, &[f32]),
) {
    let lines = Lines::new(towards, tops.width, tops.height);
    let rise = slope * cell_m * lines.step;
    let (wall, half) = ((WALL_SLOPE * cell_m) as f32, (rise / 2.0) as f32);
    for heights in [&mut shadows.heights, &mut shadows.latest] {
        heights.clear();
        heights.resize(lines.count(), f32::NEG_INFINITY);
    }
    shadows.row.resize(tops.width, 0.0);
    for (i, (row, first)) in lines.rows().enumerate() {
        // Lines sink by `rise` from row to row. Counted from a level that sinks with them, they stay.
        let sunk = (rise * i as f64) as f32;
        let before = (rise * (i as f64 - 1.0)) as f32;
        let lines = first..first + tops.width;
        let line = shadows.heights[lines.clone()].iter_mut().zip(&mut shadows.latest[lines]);
        for ((shadow, (height, latest)), top) in shadows.row.iter_mut().zip(line).zip(tops.row(row)) {
            let edge = if *latest - before - top > wall { *latest + half } else { f32::NEG_INFINITY };
            *height = height.max(*latest).max(edge);
            *shadow = *height - sunk;
            *latest = top + sunk;
        }
        visit(row, &shadows.row);
    }
}

/// Memory of [`sweep_shadows`], to be used again.
#[derive(Debug, Default)]
pub(crate) struct Shadows {
    heights: Vec<f32>,
    /// The last top of each line.
    latest: Vec<f32>,
    row: Vec<f32>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shadows(tops: &Raster<f32>, azimuth_deg: f64, slope: f64) -> Raster<f32> {
        let heading = Heading::of_azimuth(azimuth_deg);
        let swept = if heading.is_transposed() { tops.transposed() } else { tops.clone() };
        let mut out = Raster::filled(swept.width, swept.height, 0.0);
        sweep_shadows(&swept, 1.0, heading, slope, &mut Shadows::default(), |row, shadow| {
            out.row_mut(row).copy_from_slice(shadow);
        });
        if heading.is_transposed() { out.transposed() } else { out }
    }

    #[test]
    fn each_cell_lies_on_one_line() {
        for azimuth in (0..360).step_by(7) {
            let lines = Lines::new(Heading::of_azimuth(f64::from(azimuth)), 9, 20);
            let rows: Vec<_> = lines.rows().collect();
            assert_eq!(rows.len(), 20);
            assert!(rows.iter().all(|(row, first)| *row < 20 && first + 9 <= lines.count()), "{azimuth}");
        }
    }

    /// A tower of 10 m and three cells' width throws a shadow away from the light that sinks by the tangent of its altitude, in all directions.
    #[test]
    fn shadows_fall_away_from_the_light() {
        let mut tops = Raster::filled(61, 61, 0.0f32);
        (29..32).for_each(|y| tops.row_mut(y)[29..32].fill(10.0));
        for azimuth in [0.0, 30.0, 45.0, 77.0, 90.0, 135.0, 180.0, 200.0, 270.0, 300.0, 359.0f64] {
            let shadow = shadows(&tops, azimuth, 0.5);
            let heading = Heading::of_azimuth(azimuth);
            for distance in [3.0, 8.0, 15.0f64] {
                let [x, y] = [heading.x, heading.y].map(|k| (30.0 - k * distance).round() as usize);
                let (found, wanted) = (f64::from(shadow.row(y)[x]), 10.0 - distance * 0.5);
                // It begins up to half of the tower's diagonal nearer, and cells' middles are up to half a diagonal from the place.
                assert!((-0.4..1.5).contains(&(found - wanted)), "{azimuth} {distance}: {found}, not {wanted}");
            }
            let [x, y] = [heading.x, heading.y].map(|k| (30.0 + k * 8.0).round() as usize);
            assert!(shadow.row(y)[x] < 0.0, "{azimuth}: nothing is in shadow towards the light");
        }
    }

    #[test]
    fn what_is_not_there_throws_no_shadow() {
        let tops = Raster::filled(5, 4, f32::NEG_INFINITY);
        assert!(shadows(&tops, 200.0, 1.0).values.iter().all(|height| *height == f32::NEG_INFINITY));
        assert!(shadows(&Raster::filled(0, 0, 0.0), 10.0, 1.0).values.is_empty());
    }
}
