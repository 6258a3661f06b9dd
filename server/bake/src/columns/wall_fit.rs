//! Walls inside their cells: a column ends at a vertical plane where one was seen (the thesis's walls stand on cell borders,
//! which is what its figure 4.3 shows).
//!
//! In: a cell's lines and the planes of the walls that were seen in it. Out: [`MergedColumn`], clipped where that is nearer to the
//! lines than a whole cell. Next: `sample::solids`, `lod`.

use crate::columns::{
    clip::{CellClip, SAME_COSINE, WallPlane},
    merge::{MergedColumn, VerticalLine, merge},
    voxels::SolidRun,
};
use glam::Vec2;

/// ... if they also lie within so many cells of each other.
const SAME_OFFSET: f32 = 0.12;
/// Walls of a cell that are looked at.
const WALLS: usize = 3;
/// Planes nearer to a cell's corner than this, in cells, cut nothing off.
const SLIVER: f32 = 1.0 / 64.0;
/// Lines of a side that say what stands there; with fewer, lines of the neighbours are asked as well.
const ENOUGH: usize = 4;
/// Height, in cells, by which what is beyond a wall must be lower than the wall.
const LOWER: f32 = 0.25;
/// Most that one line counts as wrong, in cells.
const MOST: f32 = 4.0;
/// What a plane must be worth, in cubic cells.
const PLANE_COST: f32 = 0.002;

/// A piece of a wall in a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WallPiece {
    /// Horizontal unit vector out of the wall.
    pub(crate) normal: Vec2,
    /// Where it is, in metres from the cell's centre.
    pub(crate) at: Vec2,
    /// Its area.
    pub(crate) area_m2: f32,
}

/// The column of a cell with these lines and walls, clipped where that tells more of them right.
///
/// `around` gives lines up to half a cell outside, for what the cell's own lines are too few to say.
pub(crate) fn merge_with_walls(
    lines: &[VerticalLine],
    around: impl FnOnce() -> Vec<VerticalLine>,
    walls: &[WallPiece],
    cell_m: f32,
) -> MergedColumn {
    let whole = merge(lines, cell_m);
    let clips = clips(lines, walls, cell_m);
    if clips.is_empty() {
        return whole;
    }
    let around = around();
    let mut best = (wrong_m3(lines, walls, &whole, cell_m), whole);
    for clip in clips {
        let Some(column) = clipped(lines, &around, clip, cell_m) else { continue };
        let planes = if clip.corner.is_some() { 2.0 } else { 1.0 };
        let wrong = wrong_m3(lines, walls, &column, cell_m) + planes * PLANE_COST * cell_m.powi(3);
        if wrong < best.0 {
            best = (wrong, column);
        }
    }
    best.1
}

/// Clips worth a try: the largest walls, each two of them as a corner, and a plane across the corner of the largest two.
fn clips(lines: &[VerticalLine], walls: &[WallPiece], cell_m: f32) -> Vec<CellClip> {
    let planes = planes(walls, cell_m);
    let alone = |plane: WallPlane| CellClip { plane, corner: None, outer_top_m: None };
    let mut clips: Vec<CellClip> = planes.iter().map(|(plane, _)| alone(*plane)).collect();
    for (i, (a, _)) in planes.iter().enumerate() {
        for (b, _) in &planes[i + 1..] {
            // Planes that are nearly the same or back to back make no corner.
            if a.normal.dot(b.normal).abs() < SAME_COSINE {
                clips.extend([false, true].map(|concave| CellClip { corner: Some((*b, concave)), ..alone(*a) }));
            }
        }
    }
    if let [a, b, ..] = planes[..]
        && let Some(across) = across(lines, a, b)
    {
        clips.push(alone(across));
    }
    clips
}

/// The largest walls of a cell, as planes with their areas.
fn planes(walls: &[WallPiece], cell_m: f32) -> Vec<(WallPlane, f32)> {
    let mut sums: Vec<(WallPlane, Vec2, f32)> = Vec::new();
    for wall in walls {
        let offset_m = wall.normal.dot(wall.at);
        let same = |(sum, ..): &&mut (WallPlane, Vec2, f32)| {
            sum.normal.dot(wall.normal) > SAME_COSINE && (sum.offset_m - offset_m).abs() < SAME_OFFSET * cell_m
        };
        match sums.iter_mut().find(same) {
            Some((plane, normals, area_m2)) => {
                *normals += wall.normal * wall.area_m2;
                *area_m2 += wall.area_m2;
                plane.normal = normals.normalize_or(plane.normal);
                plane.offset_m += (offset_m - plane.offset_m) * wall.area_m2 / *area_m2;
            }
            None => sums.push((WallPlane { normal: wall.normal, offset_m }, wall.normal * wall.area_m2, wall.area_m2)),
        }
    }
    sums.retain(|(plane, ..)| {
        let reach = 0.5 * cell_m * (plane.normal.x.abs() + plane.normal.y.abs());
        plane.offset_m.abs() <= reach - SLIVER * cell_m
    });
    sums.sort_by(|a, b| b.2.total_cmp(&a.2));
    sums.truncate(WALLS);
    sums.into_iter().map(|(plane, _, area_m2)| (plane, area_m2)).collect()
}

/// A plane across the corner of two walls, as far out as the lines that reach higher than half of the cell's heights.
fn across(lines: &[VerticalLine], a: (WallPlane, f32), b: (WallPlane, f32)) -> Option<WallPlane> {
    let normal = (a.0.normal * a.1 + b.0.normal * b.1).try_normalize()?;
    let top = |line: &VerticalLine| line.runs.last().map(|s| s.top_m);
    let high = lines.iter().filter_map(top).fold(f32::MIN, f32::max);
    let empty = lines.iter().any(|line| line.runs.is_empty());
    let low = lines.iter().map(|line| top(line).unwrap_or(f32::MIN)).fold(high, f32::min);
    let split = if empty { f32::MIN } else { 0.5 * (high + low) };
    let inside = lines.iter().filter(|line| top(line).is_some_and(|z| z > split)).count();
    let mut places: Vec<f32> = lines.iter().map(|line| normal.dot(line.at)).collect();
    places.sort_by(f32::total_cmp);
    let (before, after) = (places.get(inside.checked_sub(1)?)?, places.get(inside)?);
    Some(WallPlane { normal, offset_m: 0.5 * (before + after) })
}

fn clipped(lines: &[VerticalLine], around: &[VerticalLine], mut clip: CellClip, cell_m: f32) -> Option<MergedColumn> {
    let mut column = merge(&side(lines, around, &clip, false), cell_m);
    let outer = merge(&side(lines, around, &clip, true), cell_m);
    let last = column.solids.last()?.top_m;
    if let Some(lower) = outer.solids.first() {
        if lower.top_m > last - LOWER * cell_m {
            return None;
        }
        clip.outer_top_m = Some(lower.top_m);
        let first = column.solids.first_mut()?;
        first.bottom_m = first.bottom_m.min(lower.bottom_m);
    }
    column.clip = Some(clip);
    Some(column)
}

/// The lines of one side of the plane.
fn side(lines: &[VerticalLine], around: &[VerticalLine], clip: &CellClip, outside: bool) -> Vec<VerticalLine> {
    let of = |lines: &[VerticalLine]| -> Vec<VerticalLine> {
        lines.iter().filter(|line| clip.is_outside(line.at) == outside).cloned().collect()
    };
    let mut own = of(lines);
    if own.len() < ENOUGH {
        own.extend(of(around));
    }
    own
}

/// Volume between the column and what its lines and the walls in its cell say.
fn wrong_m3(lines: &[VerticalLine], walls: &[WallPiece], column: &MergedColumn, cell_m: f32) -> f32 {
    let floor = lines.iter().flat_map(|line| &line.runs).map(|s| s.top_m).fold(f32::MAX, f32::min) - cell_m;
    let above = |s: &SolidRun| (s.top_m - s.bottom_m.max(floor)).max(0.0);
    let line_m = |line: &VerticalLine| {
        let drawn = column.runs_at(line.at);
        let both: f32 = drawn
            .iter()
            .flat_map(|a| line.runs.iter().map(move |b| (a, b)))
            .map(|(a, b)| (a.top_m.min(b.top_m) - a.bottom_m.max(b.bottom_m).max(floor)).max(0.0))
            .sum();
        let all: f32 = drawn.iter().chain(&line.runs).map(above).sum();
        (all - 2.0 * both).min(MOST * cell_m)
    };
    let wall_m = |wall: &WallPiece| {
        let to_border = 0.5 * cell_m - wall.at.abs().max_element();
        match column.clip {
            _ if to_border < 0.0 => 0.0,
            _ if column.solids.is_empty() => cell_m,
            Some(clip) => clip.beyond_m(wall.at).abs().min(cell_m),
            None => to_border,
        }
    };
    let lines_m3 = lines.iter().map(line_m).sum::<f32>() * cell_m * cell_m / lines.len().max(1) as f32;
    lines_m3 + walls.iter().map(|wall| wall_m(wall) * wall.area_m2).sum::<f32>()
}

#[cfg(test)]
mod tests {
    use crate::columns::merge::{LINES, line_at};
    use crate::columns::wall_fit::*;
    use std::f32::consts::FRAC_PI_2;

    fn cell(around: bool, top: impl Fn(Vec2) -> f32) -> Vec<VerticalLine> {
        let ring = if around { -2..LINES as i32 + 2 } else { 0..LINES as i32 };
        let places = ring.clone().flat_map(|y| ring.clone().map(move |x| (x, y)));
        places
            .map(|(x, y)| {
                let at = line_at(0, 1.0) + Vec2::new(x as f32, y as f32) / LINES as f32;
                VerticalLine { at, runs: vec![SolidRun { bottom_m: -1.0, top_m: top(at) }] }
            })
            .collect()
    }

    /// Pieces of a wall all over the cell.
    fn wall(angle: f32, offset_m: f32, clipped_by: impl Fn(Vec2) -> bool) -> Vec<WallPiece> {
        let normal = Vec2::from_angle(angle);
        let at = |i: i32| normal * offset_m + normal.perp() * (i as f32 * 0.1);
        let inside = |p: &Vec2| p.abs().max_element() < 0.5 && !clipped_by(*p);
        (-8..=8).map(at).filter(inside).map(|at| WallPiece { normal, at, area_m2: 0.8 }).collect()
    }

    fn build(walls: &[WallPiece], top: impl Fn(Vec2) -> f32) -> MergedColumn {
        merge_with_walls(&cell(false, &top), || cell(true, &top), walls, 1.0)
    }

    #[test]
    fn a_wall_is_where_it_was_seen() {
        for (angle, offset) in [(0.4, 0.13), (2.0, -0.31), (4.0, 0.4), (0.0, 0.45), (0.0, -0.45)] {
            let normal = Vec2::from_angle(angle);
            let merged = build(&wall(angle, offset, |_| false), |p| if normal.dot(p) <= offset { 9.0 } else { 1.0 });
            let clip = merged.clip.unwrap();
            assert!((clip.plane.offset_m - offset).abs() < 1e-5 && clip.plane.normal.dot(normal) > 0.9999);
            assert!(merged.solids.len() == 1 && (merged.solids[0].top_m - 9.0).abs() < 1e-4);
            assert!((clip.outer_top_m.unwrap() - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn a_wall_that_says_nothing_of_the_lines_is_left_out() {
        assert_eq!(build(&wall(0.4, 0.1, |_| false), |_| 5.0).clip, None, "nothing is lower");
        assert_eq!(build(&wall(0.0, 0.5, |_| false), |_| 9.0).clip, None, "on the cell's border");
    }

    #[test]
    fn corners_have_two_planes() {
        let (east, north) = (|p: Vec2| p.x > 0.2, |p: Vec2| p.y > 0.3);
        let walls = [wall(0.0, 0.2, north), wall(FRAC_PI_2, 0.3, east)].concat();
        let convex = build(&walls, |p| if !east(p) && !north(p) { 9.0 } else { 1.0 }).clip.unwrap();
        assert!(convex.corner.is_some_and(|(_, concave)| !concave), "{convex:?}");
        let walls = [wall(0.0, 0.2, |p| !north(p)), wall(FRAC_PI_2, 0.3, |p| !east(p))].concat();
        let concave = build(&walls, |p| if !east(p) || !north(p) { 9.0 } else { 1.0 }).clip.unwrap();
        assert!(concave.corner.is_some_and(|(_, concave)| concave), "{concave:?}");
    }
}
