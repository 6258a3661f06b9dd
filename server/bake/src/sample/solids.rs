//! Columns from crossings: which heights of each cell are full, and how the tops slope.
//!
//! Going down a line, the first crossing that is visible from above opens a run, and the next one that is visible from
//! below closes it. The lines of a cell are then merged into one column, which may be clipped at the walls that were
//! seen in the cell (`columns::wall_fit`).

use super::cell_grid::{CellGrid, GridCell, INTO_GROUND};
use super::crossings::{Crossing, Crossings};
use super::floor::Floor;
use super::local_block::{LocalBlock, LocalTriangle};
use super::surfels::Surfel;
use crate::columns::merge::{LEAF_GAPS, LINES_PER_SIDE, VerticalLine, line_position_m};
use crate::columns::voxels::SolidRun;
use crate::columns::wall_fit::{CellObservations, WallPiece};
use glam::{IVec2, Vec2, Vec3, Vec3Swizzles};
use rayon::prelude::*;
use std::cmp::Ordering;

/// Least thickness of a run, in cells. A thin surface that is visible from both sides gets this thickness.
const MIN_THICKNESS: f32 = 0.25;

/// Builds the columns of all cells in and around the block.
pub(super) fn build_columns(block: &LocalBlock, floor: &Floor, crossings: &Crossings, surfels: &[Surfel]) -> CellGrid {
    let [width, height] = block.cells.map(|n| n + 2);
    let lines = BlockLines { block, floor, crossings, starts: crossings.starts() };
    let walls = CellWalls::new(block, surfels);
    let list = (0..width * height)
        .into_par_iter()
        .map(|i| lines.cell(i % width, i / width, &walls.of_cell(i as u32)))
        .collect();
    CellGrid::new(list, width, block.cell_m)
}

/// The vertical lines through a block's surfaces.
struct BlockLines<'a> {
    block: &'a LocalBlock,
    floor: &'a Floor,
    crossings: &'a Crossings,
    starts: Vec<u32>,
}

impl BlockLines<'_> {
    /// The crossings of line (x, y) from the top down.
    fn crossings_of(&self, x: usize, y: usize) -> &[Crossing] {
        let line = y * self.crossings.lines[0] + x;
        &self.crossings.list[self.starts[line] as usize..self.starts[line + 1] as usize]
    }

    fn cell(&self, x: usize, y: usize, walls: &[WallPiece]) -> GridCell {
        let cell_m = self.block.cell_m;
        let mut ground_m: Option<f32> = None;
        let lines: Vec<VerticalLine> = (0..LINES_PER_SIDE * LINES_PER_SIDE)
            .map(|i| {
                let crossings =
                    self.crossings_of(x * LINES_PER_SIDE + i % LINES_PER_SIDE, y * LINES_PER_SIDE + i / LINES_PER_SIDE);
                for crossing in crossings {
                    let triangle = &self.block.triangles[crossing.triangle as usize];
                    if triangle.is_terrain {
                        ground_m = Some(ground_m.map_or(crossing.z, |ground_m| ground_m.min(crossing.z)));
                    }
                }
                VerticalLine { position_m: line_position_m(i, cell_m), runs: full_runs(self.block, crossings) }
            })
            .collect();
        let observations = CellObservations { lines: &lines, walls, cell_m, least_gaps: LEAF_GAPS };
        let column = observations.fit_column(|| self.lines_around(x, y));
        let bottom_m = column.solids.first().map_or(INTO_GROUND, |run| run.bottom_m);
        // The first cell lies around the block.
        let [x_m, y_m] = [x, y].map(|n| (n as f32 - 0.5) * cell_m);
        let is_grounded = bottom_m == INTO_GROUND || bottom_m < self.floor.at(x_m, y_m) + cell_m;
        GridCell { column, ground_m, is_grounded }
    }

    /// The lines up to half a cell outside of a cell.
    fn lines_around(&self, x: usize, y: usize) -> Vec<VerticalLine> {
        const MARGIN: usize = LINES_PER_SIDE / 2;
        let end = 2 * MARGIN + LINES_PER_SIDE;
        let own = MARGIN..MARGIN + LINES_PER_SIDE;
        let steps = (0..end).flat_map(|j| (0..end).map(move |i| (i, j)));
        steps
            .filter(|(i, j)| !own.contains(i) || !own.contains(j))
            .filter_map(|(i, j)| {
                let column = (x * LINES_PER_SIDE + i).checked_sub(MARGIN)?;
                let row = (y * LINES_PER_SIDE + j).checked_sub(MARGIN)?;
                if column >= self.crossings.lines[0] || row >= self.crossings.lines[1] {
                    return None;
                }
                let step = Vec2::new(i as f32 - MARGIN as f32, j as f32 - MARGIN as f32) * self.crossings.step_m;
                let position_m = line_position_m(0, self.block.cell_m) + step;
                Some(VerticalLine { position_m, runs: full_runs(self.block, self.crossings_of(column, row)) })
            })
            .collect()
    }
}

/// The full runs of a line from the bottom up. Its crossings are given from the top down.
fn full_runs(block: &LocalBlock, line: &[Crossing]) -> Vec<SolidRun> {
    let mut runs: Vec<SolidRun> = Vec::new();
    let mut open: Option<&Crossing> = None;
    for crossing in line {
        if crossing.is_visible_from_above() && open.is_none() {
            open = Some(crossing);
        }
        if block.triangles[crossing.triangle as usize].is_terrain {
            // Terrain ends the line. If it is visible it is the top of the ground; if not, what stands on it reaches
            // into it.
            if let Some(top) = open.take() {
                runs.push(SolidRun { bottom_m: INTO_GROUND, top_m: top.z });
            } else if let Some(last) = runs.last_mut().filter(|run| run.bottom_m - crossing.z < block.cell_m) {
                last.bottom_m = INTO_GROUND;
            }
            break;
        }
        if crossing.is_visible_from_below()
            && let Some(top) = open.take()
        {
            runs.push(SolidRun { bottom_m: crossing.z.min(top.z - MIN_THICKNESS * block.cell_m), top_m: top.z });
        }
    }
    // A run that nothing closes ends at its object's foot.
    if let Some(top) = open {
        let foot_m = block.triangles[top.triangle as usize].object_bottom_m;
        runs.push(SolidRun { bottom_m: foot_m.min(top.z - MIN_THICKNESS * block.cell_m), top_m: top.z });
    }
    runs.reverse();
    runs
}

/// Walls whose normal has a smaller |z| are vertical: their place in a cell does not depend on the height.
const VERTICAL_NORMAL_Z: f32 = 0.03;

/// The wall pieces of a block by cell.
pub(super) struct CellWalls {
    /// Number of the cell, then the piece; sorted by cell.
    list: Vec<(u32, WallPiece)>,
    /// Width and height of the block in cells, with one cell more on each side.
    size: [i32; 2],
    cell_m: f32,
}

impl CellWalls {
    /// Collects the walls that are visible in at least one surfel. Vertical triangles are cut exactly at the cells'
    /// borders, others are represented by their visible surfels.
    pub(super) fn new(block: &LocalBlock, surfels: &[Surfel]) -> Self {
        let mut walls = Self { list: Vec::new(), size: block.cells.map(|n| n as i32 + 2), cell_m: block.cell_m };
        for of_triangle in surfels.chunk_by(|a, b| a.triangle == b.triangle) {
            let triangle = &block.triangles[of_triangle[0].triangle as usize];
            let [front, back] =
                [0, 1].map(|side| of_triangle.iter().map(|s| u32::from(s.sightings[side])).sum::<u32>());
            if front.max(back) == 0 || !triangle.is_wall() {
                continue;
            }
            let normal = triangle.normal.xy().normalize() * if back > front { -1.0 } else { 1.0 };
            if triangle.normal.z.abs() < VERTICAL_NORMAL_Z {
                cut_at_cell_borders(triangle, block.cell_m, walls.size, |cell, centre, share| {
                    walls.push(cell, normal, centre, triangle.area_m2 * share);
                });
            } else {
                for surfel in of_triangle.iter().filter(|surfel| surfel.is_visible()) {
                    let p = surfel.position.xy();
                    walls.push((p / block.cell_m).floor().as_ivec2(), normal, p, surfel.area_m2);
                }
            }
        }
        walls.list.sort_by_key(|(cell, _)| *cell);
        walls
    }

    /// The pieces in a cell, which is numbered row-major with the cells around the block included.
    pub(super) fn of_cell(&self, cell: u32) -> Vec<WallPiece> {
        let first = self.list.partition_point(|(c, _)| *c < cell);
        let end = first + self.list[first..].partition_point(|(c, _)| *c == cell);
        self.list[first..end].iter().map(|(_, piece)| *piece).collect()
    }

    fn push(&mut self, cell: IVec2, normal: Vec2, p: Vec2, area_m2: f32) {
        let position_m = p - (cell.as_vec2() + 0.5) * self.cell_m;
        let (x, y) = (cell.x + 1, cell.y + 1);
        let [width, height] = self.size;
        if (0..width).contains(&x) && (0..height).contains(&y) {
            self.list.push(((y * width + x) as u32, WallPiece { normal, position_m, area_m2 }));
        }
    }
}

/// Cuts a vertical triangle, seen from above, at the borders of the block's `size` cells. Calls `each` with the cell, the centre of the
/// piece and its share of the triangle's length.
fn cut_at_cell_borders(triangle: &LocalTriangle, cell_m: f32, size: [i32; 2], mut each: impl FnMut(IVec2, Vec2, f32)) {
    let along = triangle.normal.xy().normalize().perp();
    let distance = |corner: &&Vec3| along.dot(corner.xy());
    let ends = [Ordering::Less, Ordering::Greater].map(|order| {
        triangle.corners.iter().reduce(|a, b| if distance(&b).total_cmp(&distance(&a)) == order { b } else { a })
    });
    let [Some(a), Some(b)] = ends.map(|end| end.map(|corner| corner.xy())) else { return };
    let mut cuts = vec![0.0, 1.0];
    for axis in 0..2 {
        let (from, to) = (a[axis] / cell_m, b[axis] / cell_m);
        // Without borders beyond the block, of which a wall of many kilometres has millions.
        let borders =
            (from.min(to).ceil() as i64).max(-2)..=(from.max(to).floor() as i64).min(i64::from(size[axis]) + 2);
        if from != to {
            cuts.extend(borders.map(|border| ((border as f32 - from) / (to - from)).clamp(0.0, 1.0)));
        }
    }
    cuts.sort_by(f32::total_cmp);
    for pair in cuts.windows(2).filter(|pair| pair[1] > pair[0]) {
        let centre = a.lerp(b, 0.5 * (pair[0] + pair[1]));
        each((centre / cell_m).floor().as_ivec2(), centre, pair[1] - pair[0]);
    }
}
