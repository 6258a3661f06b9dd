//! Thin objects of parents. Of a parent's cell they cover less than of its children's, by as much as it is larger: their area stays.

use crate::columns::merge::MergedColumn;
use crate::columns::voxels::{SolidRun, ThinShares};
use glam::Vec2;

/// Heights at which the children are looked at.
const SLICES: usize = 16;
/// Sample points along each side of a cell whose column is clipped.
const POINTS: usize = 16;
/// Most rows of cells that are looked at: of two cells of a parent.
const ROWS: usize = 4;
/// A thin object that covers less is left out.
const LEAST_SIDE: f32 = 1.0 / 512.0;

/// The highest run of a child's column, and what it covers of the child's cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct ThinSource {
    run: SolidRun,
    /// Seen along x and along y.
    sides: [f32; 2],
    top: f32,
    is_opaque: bool,
}

/// The thin part of a parent's column.
#[derive(Debug, Clone, Copy)]
pub(super) struct ThinPart {
    pub(super) run: SolidRun,
    pub(super) shares: ThinShares,
}

impl ThinSource {
    /// The column's thin part; `None` without one.
    pub(super) fn thin(merged: &MergedColumn) -> Option<Self> {
        let ThinShares { side, top } = merged.thin?;
        Some(Self { run: *merged.solids.last()?, sides: [side; 2], top, is_opaque: false })
    }

    /// Its highest opaque run; `None` without one. `cell_m` is the side of the child's cell.
    pub(super) fn opaque(merged: &MergedColumn, cell_m: f32) -> Option<Self> {
        let run = *merged.opaque_solids().last()?;
        let Some(clip) = merged.clip else { return Some(Self { run, sides: [1.0; 2], top: 1.0, is_opaque: true }) };
        let at = |n: usize| ((n as f32 + 0.5) / POINTS as f32 - 0.5) * cell_m;
        let is_full = |x: usize, y: usize| !clip.is_outside(Vec2::new(at(x), at(y)));
        let share = |count: usize, of: usize| count as f32 / of as f32;
        let rows = (0..POINTS).filter(|y| (0..POINTS).any(|x| is_full(x, *y))).count();
        let columns = (0..POINTS).filter(|x| (0..POINTS).any(|y| is_full(*x, y))).count();
        let points = (0..POINTS * POINTS).filter(|i| is_full(i % POINTS, i / POINTS)).count();
        let sides = [share(rows, POINTS), share(columns, POINTS)];
        Some(Self { run, sides, top: share(points, POINTS * POINTS), is_opaque: true })
    }

    pub(super) fn run(&self) -> SolidRun {
        self.run
    }

    /// What it covers seen from above, if it reaches above a height.
    pub(super) fn top_above(&self, base_m: f32) -> f32 {
        if self.run.top_m > base_m { self.top } else { 0.0 }
    }

    fn side_at(&self, z_m: f32, axis: usize) -> f32 {
        if z_m >= self.run.bottom_m && z_m < self.run.top_m { self.sides[axis] } else { 0.0 }
    }
}

impl ThinPart {
    /// What columns cover that reach above `base_m`, from `low_m` on. They are given with their cells' places; `cells` of them lie along
    /// the side of the cell, `cell_m`, of which the shares are. `None` if there is nothing.
    pub(super) fn of(
        columns: &[([usize; 2], ThinSource)],
        [low_m, base_m]: [f32; 2],
        (cells, cell_m): (usize, f32),
    ) -> Option<Self> {
        let columns: Vec<_> = columns.iter().filter(|(_, column)| column.run.top_m > base_m).collect();
        let runs = || columns.iter().map(|(_, column)| column.run);
        let top_m = runs().fold(f32::NEG_INFINITY, |top_m, run| top_m.max(run.top_m));
        let bottom_m = runs().fold(f32::INFINITY, |bottom_m, run| bottom_m.min(run.bottom_m)).max(low_m);
        if bottom_m >= top_m {
            return None;
        }
        // A column has at least one code.
        let run = SolidRun { bottom_m, top_m: top_m.max(bottom_m + cell_m / 16.0) };
        let mut sides = [0.0; 2];
        for slice in 0..SLICES {
            let z_m = bottom_m + (slice as f32 + 0.5) / SLICES as f32 * (run.top_m - bottom_m);
            for (axis, side) in sides.iter_mut().enumerate() {
                // Seen along an axis, opaque parts of one body lie behind each other, and thin ones show what is behind them.
                let mut rows = [(0.0f32, 1.0f32); ROWS];
                for (place, column) in &columns {
                    let (opaque, open) = &mut rows[place[1 - axis] % ROWS];
                    let covered = column.side_at(z_m, axis);
                    if column.is_opaque { *opaque = opaque.max(covered) } else { *open *= 1.0 - covered }
                }
                let covered: f32 = rows.iter().map(|(opaque, open)| 1.0 - (1.0 - opaque) * open).sum();
                *side += covered / (cells * SLICES) as f32;
            }
        }
        let top = columns.iter().map(|(_, column)| column.top).sum::<f32>() / (cells * cells) as f32;
        let shares = ThinShares { side: sides[0].max(sides[1]), top };
        (shares.side >= LEAST_SIDE).then_some(Self { run, shares })
    }
}
