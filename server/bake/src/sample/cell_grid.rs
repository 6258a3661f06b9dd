//! The columns of a block's cells while they are made.

use crate::columns::clip::{CellClip, WallPlane};
use crate::columns::merge::{LEAF_GAPS, MergedColumn, close_gaps};
use crate::columns::voxels::{SolidRun, ThinShares};
use glam::Vec2;

/// Bottom of a run that reaches into the ground. [`CellGrid::new`] replaces it by a height a little below the ground.
pub(super) const INTO_GROUND: f32 = f32::MIN;
/// How far, in cells, such a run reaches below the lowest ground around it.
const SKIRT: f32 = 0.25;
/// Largest distance, in cells, of a wall from a clip's plane to count as the same wall.
const SAME_WALL_OFFSET: f32 = 0.15;

#[derive(Debug, Clone, Default)]
pub(super) struct GridCell {
    pub(super) column: MergedColumn,
    /// Lowest terrain in the cell, visible or not.
    pub(super) ground_m: Option<f32>,
    /// Whether the lowest run stands on the terrain or on the floor.
    pub(super) is_grounded: bool,
}

/// The block's cells, and one more cell on each side.
#[derive(Debug)]
pub(super) struct CellGrid {
    /// Row-major from the south-west.
    list: Vec<GridCell>,
    width: usize,
    cell_m: f32,
}

impl CellGrid {
    /// `list` is row-major, `width` cells per row, including the cells around the block.
    pub(super) fn new(list: Vec<GridCell>, width: usize, cell_m: f32) -> Self {
        let mut cells = Self { list, width, cell_m };
        cells.end_runs_below_ground();
        cells
    }

    pub(super) fn cell_m(&self) -> f32 {
        self.cell_m
    }

    /// The cell at `x`, `y` of the block. The cells around the block have the coordinates -1 and one past the end.
    pub(super) fn at(&self, x: i32, y: i32) -> Option<&GridCell> {
        let (x, y) = (usize::try_from(x + 1).ok()?, usize::try_from(y + 1).ok()?);
        if x >= self.width { None } else { self.list.get(y * self.width + x) }
    }

    /// Adds a run to a cell and joins it with the runs that it touches. `wall` is the plane of the wall that the run
    /// belongs to, `floor_m` the floor of the cell.
    pub(super) fn insert(&mut self, x: i32, y: i32, run: SolidRun, floor_m: f32, wall: Option<WallPlane>) {
        let (Ok(column), Ok(row)) = (usize::try_from(x + 1), usize::try_from(y + 1)) else { return };
        let cell_m = self.cell_m;
        let Some(cell) = self.list.get_mut(row * self.width + column).filter(|_| column < self.width) else { return };
        let solids = &mut cell.column.solids;
        let top_before_m = solids.last().map_or(f32::MIN, |run| run.top_m);
        let is_clipped_here = |clip: CellClip| wall.is_some_and(|wall| clip.has_wall(wall, SAME_WALL_OFFSET * cell_m));
        if solids.is_empty() {
            cell.is_grounded = run.bottom_m < floor_m + cell_m;
            cell.column.clip = wall.map(CellClip::at_plane);
        } else if !cell.column.clip.is_some_and(is_clipped_here) {
            // The clip belongs to another wall and would cut off the new run.
            cell.column.clip = None;
        }
        solids.push(run);
        solids.sort_unstable_by(|a, b| a.bottom_m.total_cmp(&b.bottom_m));
        close_gaps(solids, cell_m, LEAF_GAPS);
        if solids.last().is_some_and(|run| run.top_m > top_before_m) {
            cell.column.slope = [0.0; 2];
            cell.column.is_inclined = false;
        }
    }

    /// Puts a thin object on top of a cell's column. A column that ends inside the cell stays as it is.
    pub(super) fn insert_thin(&mut self, at: [i32; 2], run: SolidRun, floor_m: f32, shares: ThinShares) {
        let is_below = |cell: &GridCell| cell.column.solids.last().is_some_and(|bar| run.bottom_m < bar.bottom_m);
        let has_bar = self.has_bar(at) && self.at(at[0], at[1]).is_some_and(is_below);
        let cell_m = self.cell_m;
        let Some(cell) = self.at_mut(at).filter(|cell| cell.column.clip.is_none() || has_bar) else { return };
        let (mut bottom_m, mut run) = (run.bottom_m, run);
        if let Some(bar) = cell.column.solids.last().filter(|_| has_bar) {
            run.top_m = run.top_m.max(bar.top_m);
            cell.column = MergedColumn::default();
        }
        match cell.column.solids.last() {
            Some(below) if bottom_m - below.top_m < LEAF_GAPS[0] * cell_m => bottom_m = below.top_m,
            Some(_) => {}
            None => cell.is_grounded = bottom_m < floor_m + cell_m,
        }
        if run.top_m > bottom_m {
            cell.column.put_thin(SolidRun { bottom_m, ..run }, shares);
        }
    }

    /// Whether a cell has nothing but a bar that is thinner than half of it in height and ends inside the cell, such as the top of a
    /// railing, and the cells around it have no more.
    pub(super) fn has_bar(&self, [x, y]: [i32; 2]) -> bool {
        let is_bar = |column: &MergedColumn| match column.solids[..] {
            [run] => {
                run.top_m - run.bottom_m < 0.5 * self.cell_m
                    && column.clip.is_some_and(|clip| clip.outer_top_m.is_none())
            }
            _ => false,
        };
        let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
        let mut columns = around.filter_map(|(x, y)| Some(&self.at(x, y)?.column));
        self.at(x, y).is_some_and(|cell| is_bar(&cell.column))
            && columns.all(|column| column.thin.is_some() || column.solids.is_empty() || is_bar(column))
    }

    /// Cuts a column off at a height.
    pub(super) fn cut(&mut self, at: [i32; 2], top_m: f32) {
        if let Some(cell) = self.at_mut(at) {
            cell.column.cut(top_m);
        }
    }

    fn at_mut(&mut self, [x, y]: [i32; 2]) -> Option<&mut GridCell> {
        let (x, y) = (usize::try_from(x + 1).ok()?, usize::try_from(y + 1).ok()?);
        if x >= self.width { None } else { self.list.get_mut(y * self.width + x) }
    }

    /// Ends runs that reach into the ground a little below the lowest ground around them.
    fn end_runs_below_ground(&mut self) {
        let width = self.width as isize;
        let grounds_m: Vec<Option<f32>> = self.list.iter().map(|cell| cell.ground_m).collect();
        for i in 0..self.list.len() {
            let column = &mut self.list[i].column;
            let Some(first) = column.solids.first_mut().filter(|run| run.bottom_m == INTO_GROUND) else { continue };
            let around = [-width - 1, -width, -width + 1, -1, 0, 1, width - 1, width, width + 1];
            let lowest_m = around
                .iter()
                .filter_map(|step| *grounds_m.get(i.checked_add_signed(*step)?)?)
                .fold(first.top_m, f32::min);
            first.bottom_m = lowest_m - SKIRT * self.cell_m;
        }
    }

    /// Whether the column of a cell shows more than one voxel of a side and so needs a wall strip (Vacca 2008, 3.1.1).
    ///
    /// A column with a gap is always exposed: gaps exist only where they were visible.
    pub(super) fn is_exposed(&self, x: i32, y: i32) -> bool {
        let Some(own) = self.at(x, y) else { return false };
        own.column.clip.is_some()
            || own.column.thin.is_some()
            || own.column.solids.len() > 1
            || (!own.is_grounded && own.column.is_slab(self.cell_m))
            || [(1, 0), (-1, 0), (0, 1), (0, -1)].into_iter().any(|(dx, dy)| {
                let neighbour = self.at(x + dx, y + dy).map(|cell| &cell.column);
                let half_step = Vec2::new(dx as f32, dy as f32) * (0.5 * self.cell_m);
                own.column.open_side_m(neighbour, half_step) > self.cell_m
            })
    }
}
