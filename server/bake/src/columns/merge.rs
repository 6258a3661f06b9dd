//! From lines to columns: what most of a cell's vertical lines say is what its column is (design 5, step 1).
//!
//! In: vertical lines with their full runs, and the walls that were seen in the cell. Out: [`MergedColumn`]. Next: `sample::solids`
//! (lines through the source's surfaces) and `lod` (lines through the children's columns) make columns of it.

use crate::columns::{clip::CellClip, voxels::SolidRun};
use glam::Vec2;

/// Lines along a cell's side.
pub(crate) const LINES: usize = 4;
/// Steepest top that is drawn as a slope, rise over run.
const MAX_SLOPE: f32 = 3.0;
/// Flattest.
const MIN_SLOPE: f32 = 0.02;
/// How far, in cells, lines' tops may lie from a common plane.
const PLANE_TOLERANCE: f32 = 0.25;

/// Height of a slab in cells, at most.
const SLAB: f32 = 4.0;
/// Fewest points that say how a top slopes.
const PLANE_POINTS: usize = 4;

/// One vertical line.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct VerticalLine {
    /// Metres from the cell's centre.
    pub(crate) at: Vec2,
    /// Full runs from the bottom up.
    pub(crate) runs: Vec<SolidRun>,
}

/// Where line `i` of a cell stands, in metres from the cell's centre: row by row from the south-west.
pub(crate) fn line_at(i: usize, cell_m: f32) -> Vec2 {
    let place = |k: usize| ((k as f32 + 0.5) / LINES as f32 - 0.5) * cell_m;
    Vec2::new(place(i % LINES), place(i / LINES))
}

/// A cell's column.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct MergedColumn {
    /// From the bottom up; the last one's top is that at the cell's centre.
    pub(crate) solids: Vec<SolidRun>,
    /// Rise of the last top along x and y.
    pub(crate) slope: [f32; 2],
    /// Whether the slope was found.
    pub(crate) inclined: bool,
    /// Where a wall stands inside the cell.
    pub(crate) clip: Option<CellClip>,
}

impl MergedColumn {
    /// Height of the top at a place relative to the cell's centre.
    pub(crate) fn top_at(&self, p_m: Vec2) -> f32 {
        if let Some(clip) = self.clip.filter(|clip| clip.is_outside(p_m)) {
            return clip.outer_top_m.unwrap_or(f32::NEG_INFINITY);
        }
        self.inner_top_at(p_m)
    }

    fn inner_top_at(&self, p_m: Vec2) -> f32 {
        self.solids.last().map_or(f32::NEG_INFINITY, |s| s.top_m) + Vec2::from(self.slope).dot(p_m)
    }

    /// Whether it is so thin that its underside is worth a strip of its own where it hangs in the air.
    pub(crate) fn is_slab(&self, cell_m: f32) -> bool {
        let (Some(first), Some(last)) = (self.solids.first(), self.solids.last()) else { return false };
        last.top_m - first.bottom_m <= SLAB * cell_m
    }

    /// The runs of a vertical line at a place relative to the cell's centre.
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

    /// Metres of `own`'s side, at `half` a cell from its centre, that `other` does not cover; the most of three places along it
    /// where a wall stands inside `other`.
    pub(crate) fn open_side_m(&self, other: Option<&Self>, half: Vec2) -> f32 {
        let clipped = other.is_some_and(|other| other.clip.is_some());
        let along: &[f32] = if clipped { &[-0.9, 0.0, 0.9] } else { &[0.0] };
        along
            .iter()
            .map(|share| half.perp() * *share)
            .fold(0.0, |most, along| most.max(self.open_at_m(other, half, along)))
    }

    fn open_at_m(&self, other: Option<&Self>, half: Vec2, along: Vec2) -> f32 {
        let covers = other.map_or_else(Vec::new, |other| other.runs_at(along - half));
        let mut open = 0.0;
        for run in self.runs_at(along + half) {
            open += run.top_m - run.bottom_m;
            for cover in &covers {
                open -= (run.top_m.min(cover.top_m) - run.bottom_m.max(cover.bottom_m)).max(0.0);
            }
        }
        open
    }
}

/// What at least half of the lines agree on; no solids if there is nothing.
pub(crate) fn merge(lines: &[VerticalLine], cell_m: f32) -> MergedColumn {
    let mut solids = overlap(lines);
    solids.retain(|s| s.top_m - s.bottom_m > cell_m / 64.0);
    if solids.is_empty() {
        solids.extend(steep(lines, cell_m));
    }
    close_gaps(&mut solids, cell_m);
    let Some(top) = solids.last().copied() else { return MergedColumn::default() };
    let mut merged = MergedColumn { solids, ..MergedColumn::default() };
    let tops: Vec<[f32; 3]> = lines
        .iter()
        .filter_map(|line| {
            let z = line.runs.last()?.top_m;
            (z > top.bottom_m).then_some([line.at.x, line.at.y, z])
        })
        .collect();
    if let Some([centre, sx, sy]) = slope(&tops, top.top_m, half(lines), cell_m) {
        merged.slope = [sx, sy];
        merged.inclined = sx.hypot(sy) > MIN_SLOPE;
        if !merged.inclined {
            merged.slope = [0.0; 2];
        }
        if let Some(last) = merged.solids.last_mut() {
            last.top_m = centre.max(last.bottom_m + cell_m / 16.0);
        }
    }
    merged
}

/// Lines that must be full for the cell to be.
fn half(lines: &[VerticalLine]) -> usize {
    lines.len().div_ceil(2)
}

/// Heights at which at least half of the lines are full.
fn overlap(lines: &[VerticalLine]) -> Vec<SolidRun> {
    let mut events: Vec<(f32, i32)> =
        lines.iter().flat_map(|l| &l.runs).flat_map(|s| [(s.bottom_m, 1), (s.top_m, -1)]).collect();
    events.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
    let half = half(lines) as i32;
    let mut solids = Vec::new();
    let (mut count, mut bottom_m) = (0, 0.0);
    for (z, change) in events {
        let before = count;
        count += change;
        if before < half && count >= half {
            bottom_m = z;
        } else if before >= half && count < half {
            solids.push(SolidRun { bottom_m, top_m: z });
        }
    }
    solids
}

/// A steep sheet: half of the lines are full, each somewhere else. Their mean stands for them.
fn steep(lines: &[VerticalLine], cell_m: f32) -> Option<SolidRun> {
    let runs: Vec<SolidRun> = lines.iter().filter_map(|l| l.runs.last().copied()).collect();
    if runs.is_empty() || runs.len() < half(lines) {
        return None;
    }
    let n = runs.len() as f32;
    let top_m = runs.iter().map(|s| s.top_m).sum::<f32>() / n;
    let bottom_m = runs.iter().map(|s| s.bottom_m.max(top_m - cell_m * 4.0)).sum::<f32>() / n;
    let low = runs.iter().map(|s| s.bottom_m).fold(f32::INFINITY, f32::min);
    Some(SolidRun { bottom_m: if low == f32::MIN { low } else { bottom_m.min(top_m - cell_m * 0.25) }, top_m })
}

/// Gaps that the grid cannot show: under half a cell anywhere, under a whole one above the ground (Vacca's figure 4.3).
pub(crate) fn close_gaps(solids: &mut Vec<SolidRun>, cell_m: f32) {
    let mut i = 1;
    while i < solids.len() {
        let limit = if i == 1 { cell_m } else { cell_m * 0.5 };
        if solids[i].bottom_m - solids[i - 1].top_m < limit {
            solids[i - 1].top_m = solids[i - 1].top_m.max(solids[i].top_m);
            solids.remove(i);
        } else {
            i += 1;
        }
    }
}

/// The plane of the tops: all of them, or else those near `top_m`; `None` if they have none in common.
fn slope(tops: &[[f32; 3]], top_m: f32, half: usize, cell_m: f32) -> Option<[f32; 3]> {
    let near: Vec<[f32; 3]> = tops.iter().filter(|t| (t[2] - top_m).abs() < 0.75 * cell_m).copied().collect();
    [tops, &near].into_iter().find_map(|points| {
        let [centre, sx, sy] = plane(points, half)?;
        let off = |t: &[f32; 3]| (t[2] - centre - sx * t[0] - sy * t[1]).abs();
        let fits = points.iter().all(|t| off(t) <= PLANE_TOLERANCE * cell_m) && sx.hypot(sy) <= MAX_SLOPE;
        fits.then_some([centre, sx, sy])
    })
}

/// Least squares: height at the centre and rise along x and y.
fn plane(points: &[[f32; 3]], half: usize) -> Option<[f32; 3]> {
    if points.len() < half.max(PLANE_POINTS) {
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
    Some([mean[2] - sx * mean[0] - sy * mean[1], sx, sy])
}

#[cfg(test)]
mod tests {
    use crate::columns::merge::*;

    fn lines(run: impl Fn(f32, f32) -> Vec<SolidRun>) -> Vec<VerticalLine> {
        (0..LINES * LINES)
            .map(|i| {
                let at = line_at(i, 1.0);
                VerticalLine { at, runs: run(at.x, at.y) }
            })
            .collect()
    }

    #[test]
    fn a_slope_is_found_exactly() {
        let merged = merge(&lines(|x, y| vec![SolidRun { bottom_m: 0.0, top_m: 10.0 + x - 0.5 * y }]), 1.0);
        assert!(merged.inclined);
        assert!((merged.slope[0] - 1.0).abs() < 1e-4 && (merged.slope[1] + 0.5).abs() < 1e-4);
        assert!((merged.solids[0].top_m - 10.0).abs() < 1e-4);
    }

    #[test]
    fn a_wall_through_the_cell_follows_the_larger_half() {
        let wall = |at: f32| {
            merge(&lines(|x, _| vec![SolidRun { bottom_m: 0.0, top_m: if x < at { 20.0 } else { 1.0 } }]), 1.0)
        };
        assert!((wall(0.3).solids[0].top_m - 20.0).abs() < 1e-4);
        assert!((wall(-0.2).solids[0].top_m - 1.0).abs() < 1e-4);
        assert!(!wall(0.3).inclined);
    }

    #[test]
    fn a_bridge_keeps_its_gap_and_a_crack_does_not() {
        let ground = SolidRun { bottom_m: f32::MIN, top_m: 2.0 };
        let bridge = merge(&lines(|_, _| vec![ground, SolidRun { bottom_m: 7.0, top_m: 8.0 }]), 1.0);
        assert_eq!(bridge.solids.len(), 2);
        let crack = merge(&lines(|_, _| vec![ground, SolidRun { bottom_m: 2.5, top_m: 8.0 }]), 1.0);
        assert_eq!(crack.solids, [SolidRun { bottom_m: f32::MIN, top_m: 8.0 }]);
    }
}
