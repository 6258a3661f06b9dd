//! Columns from crossings: which heights of each cell are full, and how their tops slope.
//!
//! In: [`Crossings`] and candidates with their sightings. Out: [`CellGrid`]. Next: `attributes` colours them.

use super::crossings::{Crossing, Crossings};
use crate::columns::{
    clip::{CellClip, WallPlane},
    merge::{LINES, MergedColumn, VerticalLine, close_gaps, line_at},
    voxels::SolidRun,
    wall_fit::{WallPiece, merge_with_walls},
};
use crate::sample::{
    local_block::{LocalBlock, LocalTriangle, TOP_Z},
    surface_samples::SurfaceSample,
};
use glam::{IVec2, Vec2, Vec3, Vec3Swizzles};
use rayon::prelude::*;
use std::cmp::Ordering;

/// Bottom of what goes on into the ground; replaced by a little under the lowest neighbour's ground.
const DOWN: f32 = f32::MIN;
/// Thickness, in cells, of a sheet that is seen from both sides.
const SHEET: f32 = 0.25;
/// How far, in cells, the ground's columns reach under the lowest ground around.
const SKIRT: f32 = 0.25;

/// Walls whose normals rise or fall less stand upright: where they are does not depend on the height.
const UPRIGHT_Z: f32 = 0.03;

/// How far, in cells, walls of one plane may be apart.
const ALIGNED: f32 = 0.15;

/// One cell.
#[derive(Debug, Clone, Default)]
pub(super) struct GridCell {
    pub(super) column: MergedColumn,
    /// Lowest terrain under it, seen or not.
    pub(super) ground_m: Option<f32>,
    /// Whether the lowest solid stands on the terrain or on its object's foot.
    pub(super) grounded: bool,
}

/// The block's cells and one more on either side.
#[derive(Debug)]
pub(super) struct CellGrid {
    list: Vec<GridCell>,
    width: usize,
    cell_m: f32,
}

/// Builds all columns.
pub(super) fn build(block: &LocalBlock, crossings: &Crossings, candidates: &[SurfaceSample]) -> CellGrid {
    let [width, height] = block.cells.map(|n| n + 2);
    let lines = SourceLines { block, crossings, starts: line_starts(crossings) };
    let walls = walls(block, candidates);
    let list = (0..width * height)
        .into_par_iter()
        .map(|i| {
            let first = walls.partition_point(|(cell, _)| *cell < i as u32);
            let end = first + walls[first..].partition_point(|(cell, _)| *cell == i as u32);
            let walls: Vec<WallPiece> = walls[first..end].iter().map(|(_, wall)| *wall).collect();
            lines.cell(i % width, i / width, &walls)
        })
        .collect();
    let mut cells = CellGrid { list, width, cell_m: block.cell_m };
    cells.ground_bottoms();
    cells
}

/// The walls that were seen, sorted by the cell that they are in.
fn walls(block: &LocalBlock, candidates: &[SurfaceSample]) -> Vec<(u32, WallPiece)> {
    let [width, height] = block.cells.map(|n| n as i32 + 2);
    let c = block.cell_m;
    let mut walls = Vec::new();
    let mut push = |cell: IVec2, normal: Vec2, p: Vec2, area_m2: f32| {
        let at = p - (cell.as_vec2() + 0.5) * c;
        let (x, y) = (cell.x + 1, cell.y + 1);
        if (0..width).contains(&x) && (0..height).contains(&y) {
            walls.push(((y * width + x) as u32, WallPiece { normal, at, area_m2 }));
        }
    };
    for sheet in candidates.chunk_by(|a, b| a.triangle == b.triangle) {
        let triangle = &block.triangles[sheet[0].triangle as usize];
        let [front, back] = [0, 1].map(|k| sheet.iter().map(|s| u32::from(s.sightings[k])).sum::<u32>());
        if front.max(back) == 0 || triangle.terrain || triangle.normal.z.abs() > TOP_Z {
            continue;
        }
        let normal = triangle.normal.xy().normalize() * if back > front { -1.0 } else { 1.0 };
        if triangle.normal.z.abs() < UPRIGHT_Z {
            each_piece(triangle, c, |cell, p, share| push(cell, normal, p, triangle.area_m2 * share));
        } else {
            for candidate in sheet.iter().filter(|s| s.sightings[0].max(s.sightings[1]) > 0) {
                let p = candidate.p.xy();
                push((p / c).floor().as_ivec2(), normal, p, candidate.area_m2);
            }
        }
    }
    walls.sort_by_key(|(cell, _)| *cell);
    walls
}

/// Cuts an upright triangle, seen from above, at the cells' borders: calls `each` with the cell, the middle of the piece and
/// its share of the length.
fn each_piece(triangle: &LocalTriangle, cell_m: f32, mut each: impl FnMut(IVec2, Vec2, f32)) {
    let along = triangle.normal.xy().normalize().perp();
    let place = |corner: &&Vec3| along.dot(corner.xy());
    let ends = [Ordering::Less, Ordering::Greater].map(|order| {
        triangle.corners.iter().reduce(|a, b| if place(&b).total_cmp(&place(&a)) == order { b } else { a })
    });
    let [Some(a), Some(b)] = ends.map(|end| end.map(|corner| corner.xy())) else { return };
    let mut cuts = vec![0.0, 1.0];
    for axis in 0..2 {
        let (from, to) = (a[axis] / cell_m, b[axis] / cell_m);
        let borders = (from.min(to).ceil() as i64)..=(from.max(to).floor() as i64);
        if from != to {
            cuts.extend(borders.map(|border| ((border as f32 - from) / (to - from)).clamp(0.0, 1.0)));
        }
    }
    cuts.sort_by(f32::total_cmp);
    for pair in cuts.windows(2).filter(|pair| pair[1] > pair[0]) {
        let middle = a.lerp(b, 0.5 * (pair[0] + pair[1]));
        each((middle / cell_m).floor().as_ivec2(), middle, pair[1] - pair[0]);
    }
}

fn line_starts(crossings: &Crossings) -> Vec<u32> {
    let mut starts = vec![0u32; crossings.lines[0] * crossings.lines[1] + 1];
    for crossing in &crossings.list {
        starts[crossing.line as usize + 1] += 1;
    }
    for i in 1..starts.len() {
        starts[i] += starts[i - 1];
    }
    starts
}

/// The vertical lines through the source's surfaces.
struct SourceLines<'a> {
    block: &'a LocalBlock,
    crossings: &'a Crossings,
    starts: Vec<u32>,
}

impl SourceLines<'_> {
    /// The crossings of line (x, y).
    fn crossings(&self, x: usize, y: usize) -> &[Crossing] {
        let line = y * self.crossings.lines[0] + x;
        &self.crossings.list[self.starts[line] as usize..self.starts[line + 1] as usize]
    }

    fn cell(&self, x: usize, y: usize, walls: &[WallPiece]) -> GridCell {
        let cell_m = self.block.cell_m;
        let mut ground_m: Option<f32> = None;
        let mut foot_m = f32::INFINITY;
        let lines: Vec<VerticalLine> = (0..LINES * LINES)
            .map(|i| {
                let list = self.crossings(x * LINES + i % LINES, y * LINES + i / LINES);
                for c in list {
                    let triangle = &self.block.triangles[c.triangle as usize];
                    if triangle.terrain {
                        ground_m = Some(ground_m.map_or(c.z, |g| g.min(c.z)));
                    } else {
                        foot_m = foot_m.min(triangle.base_z_m);
                    }
                }
                VerticalLine { at: line_at(i, cell_m), runs: runs(self.block, list) }
            })
            .collect();
        let column = merge_with_walls(&lines, || self.around(x, y), walls, cell_m);
        let bottom = column.solids.first().map_or(DOWN, |s| s.bottom_m);
        let grounded = bottom == DOWN || bottom < foot_m + cell_m;
        GridCell { column, ground_m, grounded }
    }

    /// The lines up to half a cell outside of a cell.
    fn around(&self, x: usize, y: usize) -> Vec<VerticalLine> {
        const RIM: usize = LINES / 2;
        let end = 2 * RIM + LINES;
        let own = RIM..RIM + LINES;
        let places = (0..end).flat_map(|j| (0..end).map(move |i| (i, j)));
        places
            .filter(|(i, j)| !own.contains(i) || !own.contains(j))
            .filter_map(|(i, j)| {
                let (column, row) = ((x * LINES + i).checked_sub(RIM)?, (y * LINES + j).checked_sub(RIM)?);
                if column >= self.crossings.lines[0] || row >= self.crossings.lines[1] {
                    return None;
                }
                let step = Vec2::new(i as f32 - RIM as f32, j as f32 - RIM as f32) * self.crossings.step_m;
                let at = line_at(0, self.block.cell_m) + step;
                Some(VerticalLine { at, runs: runs(self.block, self.crossings(column, row)) })
            })
            .collect()
    }
}

/// A line's full runs: a side seen from above opens one, a side seen from below closes it (design 5, step 1).
fn runs(block: &LocalBlock, line: &[Crossing]) -> Vec<SolidRun> {
    let mut found: Vec<SolidRun> = Vec::new();
    let mut open: Option<&Crossing> = None;
    for crossing in line {
        let terrain = block.triangles[crossing.triangle as usize].terrain;
        if crossing.seen_above() && open.is_none() {
            open = Some(crossing);
        }
        if terrain {
            // Terrain ends the line: seen, it is the top of the ground; unseen, what stands on it goes into it.
            if let Some(top) = open.take() {
                found.push(SolidRun { bottom_m: DOWN, top_m: top.z });
            } else if let Some(last) = found.last_mut().filter(|l| l.bottom_m - crossing.z < block.cell_m) {
                last.bottom_m = DOWN;
            }
            break;
        }
        if crossing.seen_below()
            && let Some(top) = open.take()
        {
            found.push(SolidRun { bottom_m: crossing.z.min(top.z - SHEET * block.cell_m), top_m: top.z });
        }
    }
    if let Some(top) = open {
        let foot = block.triangles[top.triangle as usize].base_z_m;
        found.push(SolidRun { bottom_m: foot.min(top.z - SHEET * block.cell_m), top_m: top.z });
    }
    found.reverse();
    found
}

impl CellGrid {
    pub(super) fn cell_m(&self) -> f32 {
        self.cell_m
    }

    /// The cell at `x`, `y` of the block; -1 and one past the end are there too.
    pub(super) fn at(&self, x: i32, y: i32) -> Option<&GridCell> {
        let (x, y) = (usize::try_from(x + 1).ok()?, usize::try_from(y + 1).ok()?);
        if x >= self.width { None } else { self.list.get(y * self.width + x) }
    }

    /// Makes a run of a cell full; it joins what it touches. `wall` is the plane of the wall that was seen there.
    pub(super) fn insert(&mut self, x: i32, y: i32, solid: SolidRun, base_z_m: f32, wall: Option<WallPlane>) {
        let (Ok(column), Ok(row)) = (usize::try_from(x + 1), usize::try_from(y + 1)) else { return };
        let cell_m = self.cell_m;
        let Some(cell) = self.list.get_mut(row * self.width + column).filter(|_| column < self.width) else { return };
        let solids = &mut cell.column.solids;
        let top_before = solids.last().map_or(f32::MIN, |s| s.top_m);
        if solids.is_empty() {
            cell.grounded = solid.bottom_m < base_z_m + cell_m;
            cell.column.clip = wall.map(|plane| CellClip { plane, corner: None, outer_top_m: None });
        } else if !wall.is_some_and(|wall| cell.column.clip.is_some_and(|clip| clip.ends_at(wall, ALIGNED * cell_m))) {
            // What is seen where nothing was drawn is not cut off by another wall.
            cell.column.clip = None;
        }
        solids.push(solid);
        solids.sort_unstable_by(|a, b| a.bottom_m.total_cmp(&b.bottom_m));
        close_gaps(solids, cell_m);
        if solids.last().is_some_and(|s| s.top_m > top_before) {
            cell.column.slope = [0.0; 2];
            cell.column.inclined = false;
        }
    }

    /// Ends what goes down into the ground a little under the lowest ground around (design 5, step 2).
    fn ground_bottoms(&mut self) {
        let width = self.width as isize;
        let grounds: Vec<Option<f32>> = self.list.iter().map(|c| c.ground_m).collect();
        for i in 0..self.list.len() {
            let column = &mut self.list[i].column;
            let Some(first) = column.solids.first_mut().filter(|s| s.bottom_m == DOWN) else { continue };
            let around = [-width - 1, -width, -width + 1, -1, 0, 1, width - 1, width, width + 1];
            let lowest = around
                .iter()
                .filter_map(|step| *grounds.get(i.checked_add_signed(*step)?)?)
                .fold(first.top_m, f32::min);
            first.bottom_m = lowest - SKIRT * self.cell_m;
        }
    }

    /// Whether more than one voxel of a side is open: whether the column is a wall (Vacca 2008, 3.1.1). A gap was seen, or it
    /// would not be there, even where all columns around have the same.
    pub(super) fn exposed(&self, x: i32, y: i32) -> bool {
        let Some(own) = self.at(x, y) else { return false };
        own.column.clip.is_some()
            || own.column.solids.len() > 1
            || (!own.grounded && own.column.is_slab(self.cell_m))
            || [(1, 0), (-1, 0), (0, 1), (0, -1)].into_iter().any(|(dx, dy)| {
                let other = self.at(x + dx, y + dy).map(|c| &c.column);
                let half = Vec2::new(dx as f32, dy as f32) * (0.5 * self.cell_m);
                own.column.open_side_m(other, half) > self.cell_m
            })
    }
}
