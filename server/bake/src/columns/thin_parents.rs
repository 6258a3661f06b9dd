//! What is thin in a parent: the thin parts of its children, what of their opaque parts would get lost, and masts that would swell.

use crate::columns::downsample::{ParentColumns, four_children};
use crate::columns::merge::MergedColumn;
use crate::columns::voxels::{LEAST_THIN_RISE, SolidRun, ThinShares};
use glam::Vec2;
use insula_protocol::NODE_CELLS;
use insula_protocol::blockmap::COLUMNS;

/// A mast that is drawn wider or narrower by more than this share becomes thin, or is moved into one cell.
const WIDTH_TOLERANCE: f32 = 0.2;

/// What becomes of a column.
enum ThinChange {
    /// What is above a height is drawn elsewhere.
    Cut(f32),
    /// This part replaces what the column has above its bottom.
    Part(ThinPart),
}

/// Two by two cells with nothing as high around them.
struct MastWindow {
    cells: [usize; 4],
    /// The highest opaque top around them.
    base_m: f32,
}

impl ParentColumns {
    /// Puts what is thin on top of the columns.
    pub(super) fn add_thin(&mut self) {
        let changes: Vec<Option<ThinChange>> = (0..COLUMNS).map(|i| self.thin_change(i)).collect();
        for (i, change) in changes.into_iter().enumerate() {
            match change {
                None => {}
                Some(ThinChange::Cut(top_m)) => self.merged[i].cut(top_m),
                Some(ThinChange::Part(part)) => self.put_part(i, &part),
            }
        }
    }

    fn put_part(&mut self, i: usize, part: &ThinPart) {
        let merged = &mut self.merged[i];
        if merged.solids.last().is_some_and(|run| run.top_m > part.run.bottom_m) {
            merged.cut(part.run.bottom_m);
        }
        if merged.clip.is_some() {
            return;
        }
        if merged.solids.is_empty() {
            let children = four_children(&self.children, i);
            self.is_grounded[i] = children.into_iter().flatten().any(|child| child.is_grounded);
        }
        if part.shares.is_thin() {
            merged.put_thin(part.run, part.shares);
        } else {
            merged.put(part.run);
        }
    }

    fn thin_change(&self, i: usize) -> Option<ThinChange> {
        if four_children(&self.children, i).iter().all(Option::is_none) {
            return None;
        }
        if let Some(change) = self.windows(i).find_map(|window| self.mast(i, &window)) {
            return Some(change);
        }
        let own = &self.merged[i];
        if own.clip.is_some() {
            return None;
        }
        let own_m = own.solids.last().map_or(f32::NEG_INFINITY, |run| run.top_m);
        let lost = |source: &ThinSource| self.is_lost(i, own_m, source);
        let parts = self.sources(i, |child| ThinSource::thin(child).or_else(|| self.opaque(child).filter(lost)));
        ThinPart::of(&parts, [own_m; 2], (2, self.cell_m)).map(ThinChange::Part)
    }

    fn opaque(&self, child: &MergedColumn) -> Option<ThinSource> {
        ThinSource::opaque(child, self.cell_m / 2.0)
    }

    /// Parts of the children of column `i`, with their places among these.
    fn sources(&self, i: usize, part: impl Fn(&MergedColumn) -> Option<ThinSource>) -> Vec<([usize; 2], ThinSource)> {
        let children = four_children(&self.children, i).into_iter().enumerate();
        children.filter_map(|(q, child)| Some(([q & 1, q >> 1], part(&child?.merged)?))).collect()
    }

    /// Whether the opaque part of a child is above its parent's column, and no opaque column around that is as high as it: then
    /// it is not the edge of a body.
    fn is_lost(&self, i: usize, own_m: f32, source: &ThinSource) -> bool {
        let run = source.run();
        // What stands deeper than its parent's column may be rough ground.
        let rise_m = if run.bottom_m < own_m {
            LEAST_THIN_RISE * self.cell_m
        } else {
            (0.5 * self.cell_m).min(0.5 * (run.top_m - run.bottom_m))
        };
        let from_m = run.bottom_m.max(own_m) + rise_m;
        let is_apart = |j: usize| self.merged[j].solids.iter().all(|run| run.top_m <= from_m);
        let step = NODE_CELLS + 1;
        run.top_m > from_m && is_inner(i) && rows(i - step, 3).all(is_apart)
    }

    /// The windows that hold column `i`.
    fn windows(&self, i: usize) -> impl Iterator<Item = MastWindow> + '_ {
        let corners = [0, 1, NODE_CELLS, NODE_CELLS + 1].into_iter().filter_map(move |step| i.checked_sub(step));
        corners.filter_map(move |first| {
            let last = first + NODE_CELLS + 1;
            if !is_inner(first) || last >= COLUMNS || !is_inner(last) {
                return None;
            }
            let cells = [first, first + 1, first + NODE_CELLS, last];
            let around = rows(first - NODE_CELLS - 1, 4).filter(|j| !cells.contains(j));
            let tops = around.filter_map(|j| Some(self.merged[j].solids.last()?.top_m));
            Some(MastWindow { cells, base_m: tops.fold(f32::NEG_INFINITY, f32::max) })
        })
    }

    /// What becomes of column `i` if a mast rises in a window, and is drawn too wide or too narrow.
    fn mast(&self, i: usize, window: &MastWindow) -> Option<ThinChange> {
        let of_window = |part: &dyn Fn(&MergedColumn) -> Option<ThinSource>| -> Vec<([usize; 2], ThinSource)> {
            let cell = |(k, j): (usize, &usize)| {
                let [x, y] = [k & 1, k >> 1].map(|n| 2 * n);
                self.sources(*j, part).into_iter().map(move |(place, part)| ([place[0] + x, place[1] + y], part))
            };
            window.cells.iter().enumerate().flat_map(cell).collect()
        };
        let own_m = |i: usize| self.merged[i].solids.last().map_or(f32::NEG_INFINITY, |run| run.top_m);
        let (base_m, size) = (window.base_m, (2, self.cell_m));
        let children = window.cells.iter().flat_map(|j| four_children(&self.children, *j)).flatten();
        let top_m =
            children.filter_map(|child| child.merged.solids.last()).fold(f32::MIN, |top_m, run| top_m.max(run.top_m));
        if top_m - base_m < LEAST_THIN_RISE * self.cell_m {
            return None;
        }
        let opaque = ThinPart::of(&of_window(&|child| self.opaque(child)), [base_m; 2], size)?;
        if opaque.run.top_m - opaque.run.bottom_m < LEAST_THIN_RISE * self.cell_m || opaque.shares.side > 1.0 {
            return None;
        }
        let drawn = window
            .cells
            .iter()
            .enumerate()
            .filter_map(|(k, j)| Some(([k & 1, k >> 1], ThinSource::opaque(&self.merged[*j], self.cell_m)?)));
        let drawn = ThinPart::of(&drawn.collect::<Vec<_>>(), [base_m; 2], (1, self.cell_m));
        let drawn = drawn.map_or(0.0, |part| part.shares.side);
        if (drawn - opaque.shares.side).abs() <= WIDTH_TOLERANCE * opaque.shares.side {
            return None;
        }
        // All of it goes to the cell that has the most.
        let area = |j: usize| {
            self.sources(j, |child| self.opaque(child)).iter().map(|(_, part)| part.top_above(base_m)).sum::<f32>()
        };
        let most = window.cells.iter().fold(window.cells[0], |most, j| if area(*j) > area(most) { *j } else { most });
        if most != i {
            return (area(i) > 0.0).then_some(ThinChange::Cut(base_m));
        }
        let all = of_window(&|child| ThinSource::thin(child).or_else(|| self.opaque(child)));
        let low_m = own_m(i).min(base_m);
        ThinPart::of(&all, [low_m, base_m], size).map(ThinChange::Part)
    }
}

/// Whether a column is not on the border of its node.
fn is_inner(i: usize) -> bool {
    let last = NODE_CELLS - 1;
    ![0, last].contains(&(i % NODE_CELLS)) && ![0, last].contains(&(i / NODE_CELLS))
}

/// The columns of a square, whose side has `side` of them, from the south-west on.
fn rows(first: usize, side: usize) -> impl Iterator<Item = usize> {
    (0..side * side).map(move |k| first + k / side * NODE_CELLS + k % side)
}

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
