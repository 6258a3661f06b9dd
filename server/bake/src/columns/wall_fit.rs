//! The clip of a cell's column that fits the observations best.
//!
//! Each wall that was seen inside a cell proposes vertical planes. For every proposal the lines on either side of the
//! plane are merged separately. The error of a column is the volume between it and the lines, plus the area of the
//! walls times their distance from the column's border. The column with the smallest error wins; each plane adds a
//! small cost, so a clip that improves nothing loses to the whole cell.

use crate::columns::clip::{CellClip, CornerPlane, PARALLEL_COSINE, WallPlane};
use crate::columns::merge::{MergedColumn, VerticalLine, merge};
use crate::columns::voxels::SolidRun;
use glam::Vec2;

/// Parallel wall pieces whose offsets differ by less, in cells, belong to one plane.
const SAME_PLANE_OFFSET: f32 = 0.12;
/// Number of planes of a cell that are tried, the largest first.
const MAX_PLANES: usize = 3;
/// Planes nearer to a corner of the cell than this, in cells, cut nothing off.
const SLIVER: f32 = 1.0 / 64.0;
/// With fewer lines on one side of a plane, lines outside of the cell are used as well.
const MIN_SIDE_LINES: usize = 4;
/// Height, in cells, by which the top beyond a clip must be lower than the column's.
const MIN_DROP: f32 = 0.25;
/// Largest error that one line contributes, in cells.
const MAX_LINE_ERROR: f32 = 4.0;
/// Cost of one plane, in cubic cells.
const PLANE_COST: f32 = 0.002;

/// A piece of a wall in a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WallPiece {
    /// Horizontal unit vector out of the wall.
    pub(crate) normal: Vec2,
    /// Centre of the piece, in metres from the cell's centre.
    pub(crate) position_m: Vec2,
    pub(crate) area_m2: f32,
}

/// What was observed in one cell.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CellObservations<'a> {
    pub(crate) lines: &'a [VerticalLine],
    pub(crate) walls: &'a [WallPiece],
    /// Side of the cell.
    pub(crate) cell_m: f32,
    /// Which gaps are closed, see [`merge`].
    pub(crate) least_gaps: [f32; 2],
}

/// A wall plane and the area that was seen of it.
#[derive(Debug, Clone, Copy)]
struct MeasuredPlane {
    plane: WallPlane,
    area_m2: f32,
}

impl CellObservations<'_> {
    /// The column with the smallest error: whole, or clipped at one or two of the walls.
    ///
    /// `lines_around` returns the lines up to half a cell outside of the cell; it is called only if there is a wall to
    /// try.
    pub(crate) fn fit_column(&self, lines_around: impl FnOnce() -> Vec<VerticalLine>) -> MergedColumn {
        let whole = merge(self.lines, self.cell_m, self.least_gaps);
        let clips = self.proposed_clips();
        if clips.is_empty() {
            return whole;
        }
        let lines_around = lines_around();
        let mut best = (self.error_m3(&whole), whole);
        for clip in clips {
            let Some(column) = self.clipped_column(clip, &lines_around) else { continue };
            let planes = if clip.corner.is_some() { 2.0 } else { 1.0 };
            let error_m3 = self.error_m3(&column) + planes * PLANE_COST * self.cell_m.powi(3);
            if error_m3 < best.0 {
                best = (error_m3, column);
            }
        }
        best.1
    }

    /// The largest planes, each pair of them as a convex and as a concave corner, and a chamfer across the largest two.
    fn proposed_clips(&self) -> Vec<CellClip> {
        let planes = self.largest_planes();
        let mut clips: Vec<CellClip> = planes.iter().map(|measured| CellClip::at_plane(measured.plane)).collect();
        for (i, a) in planes.iter().enumerate() {
            for b in &planes[i + 1..] {
                // Planes that are nearly parallel make no corner.
                if a.plane.normal.dot(b.plane.normal).abs() < PARALLEL_COSINE {
                    clips.extend([false, true].map(|is_concave| CellClip {
                        corner: Some(CornerPlane { plane: b.plane, is_concave }),
                        ..CellClip::at_plane(a.plane)
                    }));
                }
            }
        }
        if let [a, b, ..] = planes[..]
            && let Some(chamfer) = self.chamfer(a, b)
        {
            clips.push(CellClip::at_plane(chamfer));
        }
        clips
    }

    /// The walls of the cell merged into planes, at most [`MAX_PLANES`], the largest first.
    fn largest_planes(&self) -> Vec<MeasuredPlane> {
        // Each plane with the sum of its normals, weighted by area.
        let mut planes: Vec<(MeasuredPlane, Vec2)> = Vec::new();
        for wall in self.walls {
            let offset_m = wall.normal.dot(wall.position_m);
            let is_same = |(measured, _): &&mut (MeasuredPlane, Vec2)| {
                measured.plane.normal.dot(wall.normal) > PARALLEL_COSINE
                    && (measured.plane.offset_m - offset_m).abs() < SAME_PLANE_OFFSET * self.cell_m
            };
            match planes.iter_mut().find(is_same) {
                Some((MeasuredPlane { plane, area_m2 }, normal_sum)) => {
                    *normal_sum += wall.normal * wall.area_m2;
                    *area_m2 += wall.area_m2;
                    plane.normal = normal_sum.normalize_or(plane.normal);
                    plane.offset_m += (offset_m - plane.offset_m) * wall.area_m2 / *area_m2;
                }
                None => {
                    let plane = WallPlane { normal: wall.normal, offset_m };
                    planes.push((MeasuredPlane { plane, area_m2: wall.area_m2 }, wall.normal * wall.area_m2));
                }
            }
        }
        planes.retain(|(MeasuredPlane { plane, .. }, _)| {
            let corner_m = 0.5 * self.cell_m * (plane.normal.x.abs() + plane.normal.y.abs());
            plane.offset_m.abs() <= corner_m - SLIVER * self.cell_m
        });
        planes.sort_by(|a, b| b.0.area_m2.total_cmp(&a.0.area_m2));
        planes.truncate(MAX_PLANES);
        planes.into_iter().map(|(measured, _)| measured).collect()
    }

    /// A plane across the corner of two walls. Its offset leaves as many lines inside as reach above the middle of the
    /// cell's heights.
    fn chamfer(&self, a: MeasuredPlane, b: MeasuredPlane) -> Option<WallPlane> {
        let normal = (a.plane.normal * a.area_m2 + b.plane.normal * b.area_m2).try_normalize()?;
        let top_m = |line: &VerticalLine| line.runs.last().map(|run| run.top_m);
        let high_m = self.lines.iter().filter_map(top_m).fold(f32::MIN, f32::max);
        let has_empty_line = self.lines.iter().any(|line| line.runs.is_empty());
        let low_m = self.lines.iter().map(|line| top_m(line).unwrap_or(f32::MIN)).fold(high_m, f32::min);
        let split_m = if has_empty_line { f32::MIN } else { 0.5 * (high_m + low_m) };
        let inside = self.lines.iter().filter(|line| top_m(line).is_some_and(|z| z > split_m)).count();
        let mut offsets_m: Vec<f32> = self.lines.iter().map(|line| normal.dot(line.position_m)).collect();
        offsets_m.sort_by(f32::total_cmp);
        let (before_m, after_m) = (offsets_m.get(inside.checked_sub(1)?)?, offsets_m.get(inside)?);
        Some(WallPlane { normal, offset_m: 0.5 * (before_m + after_m) })
    }

    /// The column that ends at `clip`; `None` if nothing is inside, or if what is outside is not clearly lower.
    fn clipped_column(&self, mut clip: CellClip, lines_around: &[VerticalLine]) -> Option<MergedColumn> {
        let mut column = merge(&self.lines_of_side(lines_around, &clip, false), self.cell_m, self.least_gaps);
        let outer = merge(&self.lines_of_side(lines_around, &clip, true), self.cell_m, self.least_gaps);
        let top_m = column.solids.last()?.top_m;
        if let Some(lower) = outer.solids.first() {
            if lower.top_m > top_m - MIN_DROP * self.cell_m {
                return None;
            }
            clip.outer_top_m = Some(lower.top_m);
            let first = column.solids.first_mut()?;
            first.bottom_m = first.bottom_m.min(lower.bottom_m);
        }
        column.clip = Some(clip);
        Some(column)
    }

    /// The cell's lines on one side of the clip, with those around the cell if they are too few.
    fn lines_of_side(&self, lines_around: &[VerticalLine], clip: &CellClip, is_outside: bool) -> Vec<VerticalLine> {
        let of_side = |lines: &[VerticalLine]| -> Vec<VerticalLine> {
            lines.iter().filter(|line| clip.is_outside(line.position_m) == is_outside).cloned().collect()
        };
        let mut lines = of_side(self.lines);
        if lines.len() < MIN_SIDE_LINES {
            lines.extend(of_side(lines_around));
        }
        lines
    }

    /// Volume by which the column disagrees with the lines, plus wall area times distance from the column's border.
    fn error_m3(&self, column: &MergedColumn) -> f32 {
        let cell_m = self.cell_m;
        // Runs that reach into the ground end one cell below the lowest top.
        let floor_m =
            self.lines.iter().flat_map(|line| &line.runs).map(|run| run.top_m).fold(f32::MAX, f32::min) - cell_m;
        let height_m = |run: &SolidRun| (run.top_m - run.bottom_m.max(floor_m)).max(0.0);
        let line_error_m = |line: &VerticalLine| {
            let drawn = column.runs_at(line.position_m);
            let both_m: f32 = drawn
                .iter()
                .flat_map(|a| line.runs.iter().map(move |b| (a, b)))
                .map(|(a, b)| (a.top_m.min(b.top_m) - a.bottom_m.max(b.bottom_m).max(floor_m)).max(0.0))
                .sum();
            let all_m: f32 = drawn.iter().chain(&line.runs).map(height_m).sum();
            (all_m - 2.0 * both_m).min(MAX_LINE_ERROR * cell_m)
        };
        let wall_error_m = |wall: &WallPiece| {
            let to_border_m = 0.5 * cell_m - wall.position_m.abs().max_element();
            match column.clip {
                _ if to_border_m < 0.0 => 0.0,
                _ if column.solids.is_empty() => cell_m,
                Some(clip) => clip.signed_distance_m(wall.position_m).abs().min(cell_m),
                None => to_border_m,
            }
        };
        let lines_m3 =
            self.lines.iter().map(line_error_m).sum::<f32>() * cell_m * cell_m / self.lines.len().max(1) as f32;
        lines_m3 + self.walls.iter().map(|wall| wall_error_m(wall) * wall.area_m2).sum::<f32>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::merge::{LEAF_GAPS, LINES_PER_SIDE, line_position_m};
    use std::f32::consts::FRAC_PI_2;

    /// The lines of a cell of side 1, or with `around` those up to half a cell further out as well.
    fn lines(around: bool, top: impl Fn(Vec2) -> f32) -> Vec<VerticalLine> {
        let range = if around { -2..LINES_PER_SIDE as i32 + 2 } else { 0..LINES_PER_SIDE as i32 };
        let steps = range.clone().flat_map(|y| range.clone().map(move |x| (x, y)));
        steps
            .map(|(x, y)| {
                let position_m = line_position_m(0, 1.0) + Vec2::new(x as f32, y as f32) / LINES_PER_SIDE as f32;
                VerticalLine { position_m, runs: vec![SolidRun { bottom_m: -1.0, top_m: top(position_m) }] }
            })
            .collect()
    }

    /// Pieces of a wall through the whole cell.
    fn wall(angle: f32, offset_m: f32, clipped_by: impl Fn(Vec2) -> bool) -> Vec<WallPiece> {
        let normal = Vec2::from_angle(angle);
        let at = |i: i32| normal * offset_m + normal.perp() * (i as f32 * 0.1);
        let inside = |p: &Vec2| p.abs().max_element() < 0.5 && !clipped_by(*p);
        (-8..=8).map(at).filter(inside).map(|position_m| WallPiece { normal, position_m, area_m2: 0.8 }).collect()
    }

    fn fit(walls: &[WallPiece], top: impl Fn(Vec2) -> f32) -> MergedColumn {
        let observations = CellObservations { lines: &lines(false, &top), walls, cell_m: 1.0, least_gaps: LEAF_GAPS };
        observations.fit_column(|| lines(true, &top))
    }

    #[test]
    fn clips_at_the_plane_of_the_wall() {
        for (angle, offset) in [(0.4, 0.13), (2.0, -0.31), (4.0, 0.4), (0.0, 0.45), (0.0, -0.45)] {
            let normal = Vec2::from_angle(angle);
            let merged = fit(&wall(angle, offset, |_| false), |p| if normal.dot(p) <= offset { 9.0 } else { 1.0 });
            let clip = merged.clip.unwrap();
            assert!((clip.plane.offset_m - offset).abs() < 1e-5 && clip.plane.normal.dot(normal) > 0.9999);
            assert!(merged.solids.len() == 1 && (merged.solids[0].top_m - 9.0).abs() < 1e-4);
            assert!((clip.outer_top_m.unwrap() - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn ignores_walls_that_do_not_separate_heights() {
        assert_eq!(fit(&wall(0.4, 0.1, |_| false), |_| 5.0).clip, None, "nothing is lower");
        assert_eq!(fit(&wall(0.0, 0.5, |_| false), |_| 9.0).clip, None, "on the cell's border");
    }

    #[test]
    fn convex_and_concave_corners_get_two_planes() {
        let (east, north) = (|p: Vec2| p.x > 0.2, |p: Vec2| p.y > 0.3);
        let walls = [wall(0.0, 0.2, north), wall(FRAC_PI_2, 0.3, east)].concat();
        let convex = fit(&walls, |p| if !east(p) && !north(p) { 9.0 } else { 1.0 }).clip.unwrap();
        assert!(convex.corner.is_some_and(|corner| !corner.is_concave), "{convex:?}");
        let walls = [wall(0.0, 0.2, |p| !north(p)), wall(FRAC_PI_2, 0.3, |p| !east(p))].concat();
        let concave = fit(&walls, |p| if !east(p) || !north(p) { 9.0 } else { 1.0 }).clip.unwrap();
        assert!(concave.corner.is_some_and(|corner| corner.is_concave), "{concave:?}");
    }
}
