//! Columns from crossings: which heights of each cell are full, and how their tops slope.
//!
//! In: [`Crossings`] with their sightings. Out: [`Cells`]. Next: `attributes` colours them.

use super::{
    crossings::{Crossing, Crossings},
    local::Block,
};
use crate::{
    merge::{LINES, Lines, Merged, close_gaps, merge},
    voxels::Solid,
};
use rayon::prelude::*;

/// Bottom of what goes on into the ground; replaced by a little under the lowest neighbour's ground.
const DOWN: f32 = f32::MIN;
/// Thickness, in cells, of a sheet that is seen from both sides.
const SHEET: f32 = 0.25;
/// How far, in cells, the ground's columns reach under the lowest ground around.
const SKIRT: f32 = 0.25;

/// One cell.
#[derive(Debug, Clone, Default)]
pub(super) struct Cell {
    pub(super) column: Merged,
    /// Lowest terrain under it, seen or not.
    pub(super) ground_m: Option<f32>,
    /// Whether the lowest solid stands on the terrain or on its object's foot.
    pub(super) grounded: bool,
}

/// The block's cells and one more on either side.
#[derive(Debug)]
pub(super) struct Cells {
    list: Vec<Cell>,
    width: usize,
    cell_m: f32,
}

/// Builds all columns.
pub(super) fn build(block: &Block, crossings: &Crossings) -> Cells {
    let [width, height] = block.cells.map(|n| n + 2);
    let starts = line_starts(crossings);
    let list =
        (0..width * height).into_par_iter().map(|i| cell(block, crossings, &starts, i % width, i / width)).collect();
    let mut cells = Cells { list, width, cell_m: block.cell_m };
    cells.ground_bottoms();
    cells
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

fn cell(block: &Block, crossings: &Crossings, starts: &[u32], x: usize, y: usize) -> Cell {
    let mut ground_m: Option<f32> = None;
    let mut foot_m = f32::INFINITY;
    let lines: Lines = std::array::from_fn(|i| {
        let line = (y * LINES + i / LINES) * crossings.lines[0] + x * LINES + i % LINES;
        let range = starts[line] as usize..starts[line + 1] as usize;
        let list = &crossings.list[range];
        for c in list {
            let triangle = &block.triangles[c.triangle as usize];
            if triangle.terrain {
                ground_m = Some(ground_m.map_or(c.z, |g| g.min(c.z)));
            } else {
                foot_m = foot_m.min(triangle.base_z_m);
            }
        }
        runs(block, list)
    });
    let column = merge(&lines, block.cell_m);
    let bottom = column.solids.first().map_or(DOWN, |s| s.bottom_m);
    let grounded = bottom == DOWN || bottom < foot_m + block.cell_m;
    Cell { column, ground_m, grounded }
}

/// A line's full runs: a side seen from above opens one, a side seen from below closes it (design 5, step 1).
fn runs(block: &Block, line: &[Crossing]) -> Vec<Solid> {
    let mut found: Vec<Solid> = Vec::new();
    let mut open: Option<&Crossing> = None;
    for crossing in line {
        let terrain = block.triangles[crossing.triangle as usize].terrain;
        if crossing.seen_above() && open.is_none() {
            open = Some(crossing);
        }
        if terrain {
            // Terrain ends the line: seen, it is the top of the ground; unseen, what stands on it goes into it.
            if let Some(top) = open.take() {
                found.push(Solid { bottom_m: DOWN, top_m: top.z });
            } else if let Some(last) = found.last_mut().filter(|l| l.bottom_m - crossing.z < block.cell_m) {
                last.bottom_m = DOWN;
            }
            break;
        }
        if crossing.seen_below()
            && let Some(top) = open.take()
        {
            found.push(Solid { bottom_m: crossing.z.min(top.z - SHEET * block.cell_m), top_m: top.z });
        }
    }
    if let Some(top) = open {
        let foot = block.triangles[top.triangle as usize].base_z_m;
        found.push(Solid { bottom_m: foot.min(top.z - SHEET * block.cell_m), top_m: top.z });
    }
    found.reverse();
    found
}

impl Cells {
    pub(super) fn cell_m(&self) -> f32 {
        self.cell_m
    }

    /// The cell at `x`, `y` of the block; -1 and one past the end are there too.
    pub(super) fn at(&self, x: i32, y: i32) -> Option<&Cell> {
        let (x, y) = (usize::try_from(x + 1).ok()?, usize::try_from(y + 1).ok()?);
        if x >= self.width { None } else { self.list.get(y * self.width + x) }
    }

    /// Makes a run of a cell full; it joins what it touches.
    pub(super) fn insert(&mut self, x: i32, y: i32, solid: Solid, base_z_m: f32) {
        let (Ok(column), Ok(row)) = (usize::try_from(x + 1), usize::try_from(y + 1)) else { return };
        let cell_m = self.cell_m;
        let Some(cell) = self.list.get_mut(row * self.width + column).filter(|_| column < self.width) else { return };
        let solids = &mut cell.column.solids;
        let top_before = solids.last().map_or(f32::MIN, |s| s.top_m);
        if solids.is_empty() {
            cell.grounded = solid.bottom_m < base_z_m + cell_m;
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

    /// Whether more than one voxel of a side is open: whether the column is a wall (Vacca 2008, 3.1.1).
    pub(super) fn exposed(&self, x: i32, y: i32) -> bool {
        let Some(own) = self.at(x, y) else { return false };
        [(1, 0), (-1, 0), (0, 1), (0, -1)].into_iter().any(|(dx, dy)| {
            let other = self.at(x + dx, y + dy).map(|c| &c.column);
            let half = [dx as f32 * 0.5 * self.cell_m, dy as f32 * 0.5 * self.cell_m];
            open_side(&own.column, other, half) > self.cell_m
        })
    }
}

/// Metres of `own`'s side, at `half` a cell from its centre, that `other` does not cover.
pub(crate) fn open_side(own: &Merged, other: Option<&Merged>, half: [f32; 2]) -> f32 {
    let top = own.top_at(half[0], half[1]);
    let other_top = other.map_or(f32::NEG_INFINITY, |o| o.top_at(-half[0], -half[1]));
    let last = own.solids.len().saturating_sub(1);
    let mut open = 0.0;
    for (i, solid) in own.solids.iter().enumerate() {
        let high = if i == last { top } else { solid.top_m };
        open += (high - solid.bottom_m).max(0.0);
        let others = other.map_or(&[][..], |o| &o.solids);
        for (j, cover) in others.iter().enumerate() {
            let cover_top = if j + 1 == others.len() { other_top } else { cover.top_m };
            open -= (high.min(cover_top) - solid.bottom_m.max(cover.bottom_m)).max(0.0);
        }
    }
    open
}
