//! The lowest foot of each square of the grid, and medians of those around.

use super::grid::GroundGrid;
use std::cmp::Ordering;

/// Triangles whose unit normal has a smaller absolute z are walls.
pub(super) const MAX_WALL_NORMAL_Z: f32 = 0.35;
/// A foot that is lower than the median around it by more metres is a basement's.
const BASEMENT_M: f32 = 5.0;
/// A foot that is higher by more metres is that of an overhanging wall.
const OVERHANG_M: f32 = 3.0;
/// Distance in metres of the neighbours that a foot is compared with, and the fewest.
const MEDIAN_REACH_M: f64 = 24.0;
pub(super) const MEDIAN_NEIGHBOURS: usize = 8;
/// Lower walls are as often those of decks and roofs in the air as of something on the ground.
pub(super) const LOW_WALL_M: f32 = 2.0;
/// Walls that begin within this height above their object's lowest point are its lowest.
pub(super) const LOWEST_M: f32 = 1.0;

/// The lowest foot of a square.
#[derive(Debug, Clone, Copy)]
pub(super) struct LowFoot {
    /// Infinite if the square has none.
    pub(super) z_m: f32,
    /// Highest point of the wall's triangle.
    pub(super) wall_top_m: f32,
    /// Place a little behind the wall and away from its ends, which may touch other objects.
    pub(super) behind: [f32; 2],
    /// Index into the city's objects.
    pub(super) object: u32,
    /// Whether it is one of the lowest of an object that is higher than a slab.
    pub(super) is_lowest: bool,
}

impl LowFoot {
    pub(super) const NONE: Self =
        Self { z_m: f32::INFINITY, wall_top_m: f32::INFINITY, behind: [0.0; 2], object: 0, is_lowest: false };

    /// Whether it is lower. Of equal ones, that of the higher wall is, so that the order of triangles does not matter.
    pub(super) fn is_before(&self, other: &Self) -> bool {
        let [own, others] = [self, other].map(|foot| [foot.z_m, -foot.wall_top_m, foot.behind[0], foot.behind[1]]);
        own.iter().zip(&others).map(|(a, b)| a.total_cmp(b)).find(|order| order.is_ne()).is_some_and(Ordering::is_lt)
    }

    /// Whether the square has one whose wall is high enough to tell where the ground is.
    pub(super) fn is_sure(&self) -> bool {
        self.z_m.is_finite() && self.wall_top_m - self.z_m >= LOW_WALL_M
    }

    /// Whether it is neither that of an overhanging wall nor a basement's. All are, if the median is not known.
    pub(super) fn is_near_median(&self, median_m: f32) -> bool {
        median_m.is_nan() || (median_m - BASEMENT_M..=median_m + OVERHANG_M).contains(&self.z_m)
    }
}

/// Median of the chosen feet around a square; `None` where there are too few.
pub(super) fn median_around(
    lowest: &[LowFoot],
    grid: &GroundGrid,
    i: usize,
    is_chosen: impl Fn(&LowFoot) -> bool,
) -> Option<f32> {
    let chosen = feet_around(lowest, grid, i).filter(|foot| is_chosen(foot));
    let mut heights: Vec<f32> = chosen.map(|foot| foot.z_m).collect();
    median(&mut heights).filter(|_| heights.len() > MEDIAN_NEIGHBOURS)
}

/// The lowest feet of the squares around one that have any.
pub(super) fn feet_around<'a>(
    lowest: &'a [LowFoot],
    grid: &'a GroundGrid,
    i: usize,
) -> impl Iterator<Item = &'a LowFoot> {
    let reach = (MEDIAN_REACH_M / grid.step_m).round().max(2.0) as usize;
    let [x, y] = grid.place(i);
    let [first, last] = [x.saturating_sub(reach), (x + reach).min(grid.size[0] - 1)];
    let rows = y.saturating_sub(reach)..=(y + reach).min(grid.size[1] - 1);
    let squares = rows.flat_map(move |row| &lowest[grid.index(first, row)..=grid.index(last, row)]);
    squares.filter(|foot| foot.z_m.is_finite())
}

/// The upper one of two in the middle; `None` without any.
pub(super) fn median(heights: &mut [f32]) -> Option<f32> {
    let middle = heights.len() / 2;
    (!heights.is_empty()).then(|| *heights.select_nth_unstable_by(middle, f32::total_cmp).1)
}
