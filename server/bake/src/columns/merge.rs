//! One column from the vertical lines of a cell.
//!
//! This is the supersampling of Vacca 2008, 3.4.2, with a vote instead of partial coverage
//! (docs/decisions/0013-coverage.md): a height is full where at
//! least half of the lines are full. The top becomes a slope where the lines' tops lie in one plane. For leaves the
//! lines run through the source's surfaces (`sample::solids`), for parents through the children's columns
//! (`downsample`).

use crate::columns::clip::CellClip;
use crate::columns::voxels::{SolidRun, ThinShares};
use glam::Vec2;

/// Number of vertical lines along a cell's side.
pub(crate) const LINES_PER_SIDE: usize = 4;
/// Steepest top that becomes a slope, rise over run.
const MAX_SLOPE: f32 = 3.0;
/// Tops that are flatter than this become horizontal, rise over run.
const MIN_SLOPE: f32 = 0.02;
/// Largest distance, in cells, of a line's top from the plane of a slope.
const SLOPE_TOLERANCE: f32 = 0.25;
/// Fewest tops that define a slope.
const MIN_SLOPE_POINTS: usize = 4;
/// Gaps of a leaf's columns that are lower than this are closed, in cells: above the lowest run, and elsewhere (Vacca 2008,
/// figure 4.3).
pub(crate) const LEAF_GAPS: [f32; 2] = [1.0, 0.5];
/// The same in parents. What the leaves left open stays open as long as a cell can show it.
pub(crate) const PARENT_GAPS: [f32; 2] = [0.5, 0.5];
/// Largest height of a slab, in cells.
const MAX_SLAB_HEIGHT: f32 = 4.0;

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct VerticalLine {
    /// Metres from the cell's centre.
    pub(crate) position_m: Vec2,
    /// Full runs from the bottom up.
    pub(crate) runs: Vec<SolidRun>,
}

/// Position of line `i` of a cell in metres from the cell's centre. Lines are row-major from the south-west.
pub(crate) fn line_position_m(i: usize, cell_m: f32) -> Vec2 {
    let along = |k: usize| ((k as f32 + 0.5) / LINES_PER_SIDE as f32 - 0.5) * cell_m;
    Vec2::new(along(i % LINES_PER_SIDE), along(i / LINES_PER_SIDE))
}

/// The column of one cell.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct MergedColumn {
    /// From the bottom up. The last run's top is the height at the cell's centre.
    pub(crate) solids: Vec<SolidRun>,
    /// Rise of the last top along x and y; zero unless `is_inclined`.
    pub(crate) slope: [f32; 2],
    pub(crate) is_inclined: bool,
    /// Where the column ends inside the cell.
    pub(crate) clip: Option<CellClip>,
    /// What of the last run is full, if that is a thin object. Then there is neither a slope nor a clip.
    pub(crate) thin: Option<ThinShares>,
}

/// A plane through the tops of lines.
#[derive(Debug, Clone, Copy)]
struct TopPlane {
    /// Height at the cell's centre.
    centre_m: f32,
    /// Rise along x and y.
    slope: [f32; 2],
}

impl MergedColumn {
    /// Height of the top at a point relative to the cell's centre; negative infinity where nothing stands.
    pub(crate) fn top_at(&self, p_m: Vec2) -> f32 {
        if let Some(clip) = self.clip.filter(|clip| clip.is_outside(p_m)) {
            return clip.outer_top_m.unwrap_or(f32::NEG_INFINITY);
        }
        self.inner_top_at(p_m)
    }

    fn inner_top_at(&self, p_m: Vec2) -> f32 {
        self.solids.last().map_or(f32::NEG_INFINITY, |run| run.top_m) + Vec2::from(self.slope).dot(p_m)
    }

    /// Whether the column is so thin that it gets a wall strip for its underside where it hangs in the air.
    pub(crate) fn is_slab(&self, cell_m: f32) -> bool {
        let (Some(first), Some(last)) = (self.solids.first(), self.solids.last()) else { return false };
        last.top_m - first.bottom_m <= MAX_SLAB_HEIGHT * cell_m
    }

    /// The full runs of a vertical line at a point relative to the cell's centre.
    pub(crate) fn runs_at(&self, p_m: Vec2) -> Vec<SolidRun> {
        let Some(first) = self.solids.first() else { return Vec::new() };
        if let Some(clip) = self.clip.filter(|clip| clip.is_outside(p_m)) {
            return clip.outer_top_m.map(|top_m| SolidRun { bottom_m: first.bottom_m, top_m }).into_iter().collect();
        }
        let mut runs = self.solids.clone();
        if let Some(last) = runs.last_mut() {
            last.top_m = self.inner_top_at(p_m).max(last.bottom_m + 1e-3);
        }
        runs
    }

    /// The runs that no ray passes.
    pub(crate) fn opaque_solids(&self) -> &[SolidRun] {
        &self.solids[..self.solids.len() - usize::from(self.thin.is_some())]
    }

    /// The same runs at a point relative to the cell's centre.
    pub(crate) fn opaque_runs_at(&self, p_m: Vec2) -> Vec<SolidRun> {
        let mut runs = self.runs_at(p_m);
        runs.truncate(self.opaque_solids().len());
        runs
    }

    pub(crate) fn cut(&mut self, top_m: f32) {
        let below = std::mem::take(self).solids.into_iter().filter(|run| run.bottom_m < top_m);
        self.solids = below.map(|run| SolidRun { top_m: run.top_m.min(top_m), ..run }).collect();
    }

    /// Puts an opaque run on top of the column.
    pub(crate) fn put(&mut self, run: SolidRun) {
        match self.solids.last_mut().filter(|below| below.top_m >= run.bottom_m) {
            Some(below) => below.top_m = run.top_m,
            None => self.solids.push(run),
        }
        self.slope = [0.0; 2];
        self.is_inclined = false;
        self.clip = None;
    }

    /// Puts a thin object on top of the column.
    pub(crate) fn put_thin(&mut self, run: SolidRun, shares: ThinShares) {
        self.solids.push(run);
        self.slope = [0.0; 2];
        self.is_inclined = false;
        self.thin = Some(shares);
    }

    /// Height of the column's side that its neighbour does not cover, in metres. `half_step` leads from the cell's
    /// centre to the middle of the shared border. Where the neighbour is clipped, the largest of three points along the
    /// border counts.
    pub(crate) fn open_side_m(&self, neighbour: Option<&Self>, half_step: Vec2) -> f32 {
        let is_clipped = neighbour.is_some_and(|neighbour| neighbour.clip.is_some());
        let along: &[f32] = if is_clipped { &[-0.9, 0.0, 0.9] } else { &[0.0] };
        along
            .iter()
            .map(|share| half_step.perp() * *share)
            .fold(0.0, |most, along| most.max(self.open_height_at(neighbour, half_step, along)))
    }

    fn open_height_at(&self, neighbour: Option<&Self>, half_step: Vec2, along: Vec2) -> f32 {
        let covers = neighbour.map_or_else(Vec::new, |neighbour| neighbour.opaque_runs_at(along - half_step));
        let mut open_m = 0.0;
        for run in self.runs_at(along + half_step) {
            open_m += run.top_m - run.bottom_m;
            for cover in &covers {
                open_m -= (run.top_m.min(cover.top_m) - run.bottom_m.max(cover.bottom_m)).max(0.0);
            }
        }
        open_m
    }
}

/// The column that at least half of the lines agree on. It has no solids if the cell is empty. `least_gaps` are
/// [`LEAF_GAPS`] or [`PARENT_GAPS`].
pub(crate) fn merge(lines: &[VerticalLine], cell_m: f32, least_gaps: [f32; 2]) -> MergedColumn {
    let mut solids = majority_runs(lines);
    solids.retain(|run| run.top_m - run.bottom_m > cell_m / 64.0);
    if solids.is_empty() {
        solids.extend(mean_top_run(lines, cell_m));
    }
    close_gaps(&mut solids, cell_m, least_gaps);
    let Some(top) = solids.last().copied() else { return MergedColumn::default() };
    let mut merged = MergedColumn { solids, ..MergedColumn::default() };
    let tops: Vec<[f32; 3]> = lines
        .iter()
        .filter_map(|line| {
            let z = line.runs.last()?.top_m;
            (z > top.bottom_m).then_some([line.position_m.x, line.position_m.y, z])
        })
        .collect();
    if let Some(TopPlane { centre_m, slope }) = fit_slope(&tops, top.top_m, majority(lines), cell_m) {
        merged.is_inclined = libm::hypotf(slope[0], slope[1]) > MIN_SLOPE;
        merged.slope = if merged.is_inclined { slope } else { [0.0; 2] };
        if let Some(last) = merged.solids.last_mut() {
            last.top_m = centre_m.max(last.bottom_m + cell_m / 16.0);
        }
    }
    merged
}

/// Number of lines that must be full for the cell to be full.
fn majority(lines: &[VerticalLine]) -> usize {
    lines.len().div_ceil(2)
}

/// Heights at which at least half of the lines are full.
fn majority_runs(lines: &[VerticalLine]) -> Vec<SolidRun> {
    let mut events: Vec<(f32, i32)> =
        lines.iter().flat_map(|line| &line.runs).flat_map(|run| [(run.bottom_m, 1), (run.top_m, -1)]).collect();
    // At equal heights, runs begin before others end: runs that touch leave no gap.
    events.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
    let majority = majority(lines) as i32;
    let mut solids = Vec::new();
    let (mut count, mut bottom_m) = (0, 0.0);
    for (z, change) in events {
        let before = count;
        count += change;
        if before < majority && count >= majority {
            bottom_m = z;
        } else if before >= majority && count < majority {
            solids.push(SolidRun { bottom_m, top_m: z });
        }
    }
    solids
}

/// The mean of the lines' highest runs, for a steep thin surface: half of the lines are full, each at another height.
fn mean_top_run(lines: &[VerticalLine], cell_m: f32) -> Option<SolidRun> {
    let runs: Vec<SolidRun> = lines.iter().filter_map(|line| line.runs.last().copied()).collect();
    if runs.is_empty() || runs.len() < majority(lines) {
        return None;
    }
    let n = runs.len() as f32;
    let top_m = runs.iter().map(|run| run.top_m).sum::<f32>() / n;
    let bottom_m = runs.iter().map(|run| run.bottom_m.max(top_m - cell_m * 4.0)).sum::<f32>() / n;
    let lowest_m = runs.iter().map(|run| run.bottom_m).fold(f32::INFINITY, f32::min);
    // `f32::MIN` marks a run that reaches into the ground; the mark must survive.
    Some(SolidRun {
        bottom_m: if lowest_m == f32::MIN { lowest_m } else { bottom_m.min(top_m - cell_m * 0.25) },
        top_m,
    })
}

/// Closes gaps that the grid cannot show: those lower than `least_gaps`, above the lowest run and elsewhere.
pub(crate) fn close_gaps(solids: &mut Vec<SolidRun>, cell_m: f32, least_gaps: [f32; 2]) {
    let mut i = 1;
    while i < solids.len() {
        let limit_m = least_gaps[usize::from(i > 1)] * cell_m;
        if solids[i].bottom_m - solids[i - 1].top_m < limit_m {
            solids[i - 1].top_m = solids[i - 1].top_m.max(solids[i].top_m);
            solids.remove(i);
        } else {
            i += 1;
        }
    }
}

/// The plane of all tops, or else that of the tops near `top_m`; `None` if neither set lies in one plane.
fn fit_slope(tops: &[[f32; 3]], top_m: f32, min_points: usize, cell_m: f32) -> Option<TopPlane> {
    let near: Vec<[f32; 3]> = tops.iter().filter(|t| (t[2] - top_m).abs() < 0.75 * cell_m).copied().collect();
    [tops, &near].into_iter().find_map(|points| {
        let plane = fit_plane(points, min_points)?;
        let [sx, sy] = plane.slope;
        let distance_m = |t: &[f32; 3]| (t[2] - plane.centre_m - sx * t[0] - sy * t[1]).abs();
        let fits =
            points.iter().all(|t| distance_m(t) <= SLOPE_TOLERANCE * cell_m) && libm::hypotf(sx, sy) <= MAX_SLOPE;
        fits.then_some(plane)
    })
}

/// Least-squares plane through points relative to the cell's centre; `None` if they are too few or nearly on one line.
fn fit_plane(points: &[[f32; 3]], min_points: usize) -> Option<TopPlane> {
    if points.len() < min_points.max(MIN_SLOPE_POINTS) {
        return None;
    }
    let n = points.len() as f32;
    let mean = points.iter().fold([0.0f32; 3], |m, p| [m[0] + p[0] / n, m[1] + p[1] / n, m[2] + p[2] / n]);
    let (mut xx, mut xy, mut yy, mut xz, mut yz) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for p in points {
        let [x, y, z] = [p[0] - mean[0], p[1] - mean[1], p[2] - mean[2]];
        xx += x * x;
        xy += x * y;
        yy += y * y;
        xz += x * z;
        yz += y * z;
    }
    let det = xx * yy - xy * xy;
    if det <= 0.05 * xx * yy || det <= 0.0 {
        return None;
    }
    let (sx, sy) = ((xz * yy - yz * xy) / det, (yz * xx - xz * xy) / det);
    Some(TopPlane { centre_m: mean[2] - sx * mean[0] - sy * mean[1], slope: [sx, sy] })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(runs: impl Fn(f32, f32) -> Vec<SolidRun>) -> Vec<VerticalLine> {
        (0..LINES_PER_SIDE * LINES_PER_SIDE)
            .map(|i| {
                let position_m = line_position_m(i, 1.0);
                VerticalLine { position_m, runs: runs(position_m.x, position_m.y) }
            })
            .collect()
    }

    #[test]
    fn plane_of_tops_becomes_a_slope() {
        let merged = merge(&lines(|x, y| vec![SolidRun { bottom_m: 0.0, top_m: 10.0 + x - 0.5 * y }]), 1.0, LEAF_GAPS);
        assert!(merged.is_inclined);
        assert!((merged.slope[0] - 1.0).abs() < 1e-4 && (merged.slope[1] + 0.5).abs() < 1e-4);
        assert!((merged.solids[0].top_m - 10.0).abs() < 1e-4);
    }

    #[test]
    fn step_in_the_cell_takes_the_height_of_the_larger_half() {
        let step = |at: f32| {
            merge(
                &lines(|x, _| vec![SolidRun { bottom_m: 0.0, top_m: if x < at { 20.0 } else { 1.0 } }]),
                1.0,
                LEAF_GAPS,
            )
        };
        assert!((step(0.3).solids[0].top_m - 20.0).abs() < 1e-4);
        assert!((step(-0.2).solids[0].top_m - 1.0).abs() < 1e-4);
        assert!(!step(0.3).is_inclined);
    }

    #[test]
    fn wide_gap_stays_and_narrow_gap_is_closed() {
        let ground = SolidRun { bottom_m: f32::MIN, top_m: 2.0 };
        let above = |bottom_m: f32, least_gaps: [f32; 2]| {
            merge(&lines(|_, _| vec![ground, SolidRun { bottom_m, top_m: 8.0 }]), 1.0, least_gaps).solids
        };
        assert_eq!(above(7.0, LEAF_GAPS).len(), 2);
        assert_eq!(above(2.6, LEAF_GAPS), [SolidRun { bottom_m: f32::MIN, top_m: 8.0 }]);
        assert_eq!(above(2.6, PARENT_GAPS).len(), 2, "more than half a cell");
        assert_eq!(above(2.4, PARENT_GAPS).len(), 1);
    }
    fn column(runs: &[[f32; 2]]) -> MergedColumn {
        let solids = runs.iter().map(|[bottom_m, top_m]| SolidRun { bottom_m: *bottom_m, top_m: *top_m }).collect();
        MergedColumn { solids, ..MergedColumn::default() }
    }

    #[test]
    fn open_sides_are_what_the_neighbour_does_not_cover() {
        let half_step = Vec2::new(0.5, 0.0);
        let open_m = |neighbour: Option<&[[f32; 2]]>| {
            column(&[[1.0, 5.0], [8.0, 10.0]]).open_side_m(neighbour.map(column).as_ref(), half_step)
        };
        assert_eq!(open_m(None), 6.0);
        assert_eq!(open_m(Some(&[])), 6.0);
        assert_eq!(open_m(Some(&[[20.0, 30.0]])), 6.0);
        // It covers 3 m of the lower run and 1 m of the upper one.
        assert_eq!(open_m(Some(&[[2.0, 9.0]])), 2.0);
        assert_eq!(open_m(Some(&[[0.0, 3.0], [8.5, 20.0]])), 2.5);
    }

    #[test]
    fn slabs_are_thin_from_their_lowest_to_their_highest_run() {
        let cell_m = 2.0;
        let is_slab = |thickness: f32| column(&[[30.0, 30.1], [30.2, 30.0 + thickness * cell_m]]).is_slab(cell_m);
        assert!(is_slab(MAX_SLAB_HEIGHT - 0.01) && !is_slab(MAX_SLAB_HEIGHT + 0.01));
        assert!(!column(&[]).is_slab(cell_m));
    }
    #[test]
    fn steep_thin_surfaces_have_the_mean_of_their_runs() {
        let steep = |x: f32, y: f32| {
            let top_m = 10.0 + 0.6 * LINES_PER_SIDE as f32 * y;
            if x < 0.0 { vec![SolidRun { bottom_m: top_m - 0.5, top_m }] } else { Vec::new() }
        };
        assert!(majority_runs(&lines(steep)).is_empty());
        let run = mean_top_run(&lines(steep), 1.0).unwrap();
        assert!((run.top_m - 10.0).abs() < 1e-4 && (run.bottom_m - 9.5).abs() < 1e-4, "{run:?}");
        assert!(mean_top_run(&lines(|x, y| if x < -0.2 { steep(x, y) } else { Vec::new() }), 1.0).is_none());
    }
}
