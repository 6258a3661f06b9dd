//! Horizons by sweeps: along each line of a direction, the steepest slope to an obstacle before a cell.
//!
//! A line keeps the upper hull of the tops that it has passed, seen from the cells to come (Timonen and Westerholm, Scalable Height Field
//! Self-Shadowing, Computer Graphics Forum 29(2), 2010). What a later top hides from all that follows is dropped, so that each top is
//! added and dropped once at most.

use crate::raster::Raster;
use crate::sweep::{Heading, Lines, WALL_SLOPE};

/// The tops of a line that can still be a horizon, the nearest last: distance along the line in cells, and height in metres.
#[derive(Debug, Clone, Default)]
pub(crate) struct Hull(Vec<(f32, f32)>);

impl Hull {
    /// Adds the edge of a wall: the last top ends at a distance behind its middle. It is part of the hull as a top is.
    fn end_last(&mut self, at: f32, least_drop: f32, top: f32) {
        if let Some((_, height)) = self.0.last().copied()
            && height - top > least_drop
        {
            self.advance(at, height);
        }
    }

    /// Adds the top of a cell at a distance along the line, and returns the tangent of the horizon's altitude from there, in metres a cell;
    /// negative infinity if nothing was before. Distances ascend.
    fn advance(&mut self, at: f32, top: f32) -> f32 {
        let mut slope = self.last_slope(at, top);
        while let [.., before, _] = self.0[..]
            && slope_to(before, at, top) >= slope
        {
            self.0.pop();
            slope = slope_to(before, at, top);
        }
        // A top that is no higher than the last slope goes on is part of the hull all the same: it hides what is lower behind it.
        self.0.push((at, top));
        slope
    }

    /// The slope of the horizon from a height at a distance, without adding a top.
    pub(crate) fn slope_from(&self, at: f32, height: f32) -> f32 {
        let mut slope = f32::NEG_INFINITY;
        for point in self.0.iter().rev() {
            let next = slope_to(*point, at, height);
            if next < slope {
                break;
            }
            slope = next;
        }
        slope
    }

    fn last_slope(&self, at: f32, top: f32) -> f32 {
        self.0.last().map_or(f32::NEG_INFINITY, |last| slope_to(*last, at, top))
    }
}

fn slope_to((distance, height): (f32, f32), at: f32, top: f32) -> f32 {
    (height - top) / (at - distance)
}

/// Passes each row with the hulls of the lines of its cells to `before`, and then the tangents of the horizon's altitude of its cells to
/// `visit`; at most 0 where nothing is higher. `tops` is transposed if the heading says so.
pub(crate) fn sweep_horizons(
    tops: &Raster<f32>,
    towards: Heading,
    cell_m: f64,
    hulls: &mut Vec<Hull>,
    mut before: impl FnMut(usize, &[Hull], f32),
    mut visit: impl FnMut(usize, &[f32]),
) {
    let lines = Lines::new(towards, tops.width, tops.height);
    hulls.iter_mut().for_each(|hull| hull.0.clear());
    hulls.resize_with(lines.count().max(hulls.len()), Hull::default);
    let (step, per_metre) = (lines.step as f32, (1.0 / cell_m) as f32);
    let wall = (WALL_SLOPE * cell_m) as f32;
    let mut slopes = vec![f32::NEG_INFINITY; tops.width];
    for (i, (row, first)) in lines.rows().enumerate() {
        let at = i as f32 * step;
        let line = &mut hulls[first..first + tops.width];
        for (hull, top) in line.iter_mut().zip(tops.row(row)) {
            hull.end_last(at - 0.5 * step, wall, *top);
        }
        before(row, line, at);
        for ((slope, hull), top) in slopes.iter_mut().zip(line.iter_mut()).zip(tops.row(row)) {
            *slope = if top.is_finite() { hull.advance(at, *top) * per_metre } else { f32::NEG_INFINITY };
        }
        visit(row, &slopes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The steepest of all tops before and their edges, found by trying each.
    fn by_trying(tops: &[f32], at: usize, height: f32) -> f32 {
        let slope = |i: usize| {
            let (top, next) = (tops[i], tops[i + 1]);
            let edge = if top - next > 2.0 { 0.5 } else { 0.0 };
            let ahead = (at - i) as f32;
            slope_to((0.0, top), ahead, height).max(slope_to((edge, top), ahead, height))
        };
        (0..at).map(slope).fold(f32::NEG_INFINITY, f32::max)
    }

    #[test]
    fn hulls_have_the_steepest_top() {
        // A walk that a small generator makes, with steps, plains and towers.
        let mut state = 7u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 24
        };
        let top = |v: u32| if v > 240 { v as f32 } else { (v / 16) as f32 };
        let mut tops: Vec<f32> = (0..400).map(|_| top(next())).collect();
        // A low house before a tower, whose edge must not hide the tower.
        tops.extend([0.0, 90.0, 90.0, 6.0, 6.0, 6.0, 0.0, 0.0, 0.0, 0.0]);
        let mut hull = Hull::default();
        for (i, top) in tops.iter().enumerate() {
            hull.end_last(i as f32 - 0.5, 2.0, *top);
            for height in [*top, top + 3.0, 100.0, 400.0] {
                let (found, wanted) = (hull.slope_from(i as f32, height), by_trying(&tops, i, height));
                assert!(found == wanted || (found - wanted).abs() < 1e-4, "{i} {height}: {found}, not {wanted}");
            }
            let (found, wanted) = (hull.advance(i as f32, *top), by_trying(&tops, i, *top));
            assert!(found == wanted || (found - wanted).abs() < 1e-4, "{i}: {found}, not {wanted}");
        }
    }

    #[test]
    fn a_wall_hides_the_sky_by_its_height_and_distance() {
        let mut tops = Raster::filled(40, 30, 0.0f32);
        (0..30).for_each(|y| tops.row_mut(y)[30] = 12.0);
        for (azimuth, cells) in [(90.0, 10.0), (60.0, 10.0 / 60f64.to_radians().sin())] {
            let heading = Heading::of_azimuth(azimuth);
            let swept = tops.transposed();
            let mut found = Vec::new();
            sweep_horizons(
                &swept,
                heading,
                2.0,
                &mut Vec::new(),
                |_, _, _| {},
                |x, slopes| {
                    if x == 20 {
                        found = slopes.to_vec();
                    }
                },
            );
            // 12 m over so many cells of 2 m, of which the wall's own has only a half.
            assert!(
                (f64::from(found[10]) - 12.0 / ((cells - cells / 20.0) * 2.0)).abs() < 1e-4,
                "{azimuth}: {}",
                found[10]
            );
        }
    }
}
