//! The cells of a city, and their sets.

use crate::Settings;
use crate::heights::{CityExtent, CityHeights, LeafRectangle};
use crate::row_tables::{MainAxis, RowTables};
use crate::sweep::{LayerNumber, Sweep, ViewCell};
use insula_protocol::visibility_tile::{LAYERS, SCALE_LEVELS, SCALES, UNSEEN, VisibleCell, block_of_leaf};
use insula_protocol::{BlockMap, TileId, VisibilityTile};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Buildings are narrower than about twice this, in metres.
const GROUND_REACH_M: f32 = 30.0;

const AXES: [MainAxis; 2] = [MainAxis::X, MainAxis::Y];
/// Number of sweeps of each cell.
pub const SWEEPS: u64 = AXES.len() as u64;

/// The sets of a city's cells, one for each leaf.
#[derive(Debug)]
pub struct CitySets {
    depth: u8,
    settings: Settings,
    leaves: LeafRectangle,
    /// Row by row; `None` for leaf squares that are no nodes of their own.
    cells: Vec<Option<VisibleCell>>,
}

impl CitySets {
    /// Computes the sets of the cells of all leaves, and calls `advance` [`SWEEPS`] times for each. `None` if the city has no sets
    /// ([`CityExtent::check`]). Fails with the first error of `read`, which decodes the V-BlockMap of a node of `extent`.
    pub fn compute<E: Send>(
        extent: &CityExtent,
        settings: &Settings,
        read: impl Fn(TileId) -> Result<BlockMap, E> + Sync,
        advance: impl Fn() + Sync,
    ) -> Result<Option<Self>, E> {
        let Some(heights) = CityHeights::read(extent, read)? else { return Ok(None) };
        let leaves = heights.leaves;
        let mut cells: Vec<Option<(VisibleCell, ViewCell)>> = {
            let grounds = CellGrounds::new(&heights);
            let cell_at = |i: usize| {
                let (ground, cell) = grounds.cell(i, settings);
                (VisibleCell { ground, seen: Vec::new() }, cell)
            };
            (0..leaves.len()).into_par_iter().map(|i| heights.is_leaf[i].then(|| cell_at(i))).collect()
        };
        // Land around the leaves is not computed: it counts as seen.
        let is_land = |id: &TileId| id.level() < extent.depth && !leaves.contains(*id, extent.depth);
        let beyond = if extent.terminals.iter().any(is_land) { 0 } else { UNSEEN };
        for axis in AXES {
            let tables = RowTables::new(&heights, axis);
            let sweep = Sweep::new(&heights, &tables, axis, settings);
            cells.par_iter_mut().enumerate().for_each(|(i, cell)| {
                let Some((set, cell)) = cell else { return };
                let mut seen = vec![UNSEEN as LayerNumber; leaves.len()];
                seen[i] = 0;
                sweep.see(cell, &mut seen);
                let seen = around(&leaves, i, settings.reach, &seen, beyond);
                if set.seen.is_empty() {
                    set.seen = seen;
                } else {
                    set.seen.iter_mut().zip(seen).for_each(|(a, b)| *a = (*a).min(b));
                }
                advance();
            });
        }
        let cells = cells.into_iter().map(|cell| cell.map(|(set, _)| set)).collect();
        Ok(Some(Self { depth: extent.depth, settings: *settings, leaves, cells }))
    }

    /// The nodes that have a visibility tile.
    pub fn blocks(&self) -> Vec<TileId> {
        let all = self.cells.iter().enumerate().filter(|(_, cell)| cell.is_some());
        let leaves = all.filter_map(|(i, _)| {
            let (x, y) = self.leaves.place(i);
            TileId::new(self.depth, x, y)
        });
        leaves.map(block_of_leaf).collect::<BTreeSet<_>>().into_iter().collect()
    }

    /// The visibility tile of a node: the cells of its leaves, and of those around it.
    pub fn tile(&self, block: TileId) -> VisibilityTile {
        let levels = self.depth - block.level();
        let across = (1i64 << levels) + 2;
        let corner = [block.x(), block.y()].map(|v| (i64::from(v) << levels) - 1);
        let cell_at = |x: i64, y: i64| {
            let i = self.leaves.index(u32::try_from(x).ok()?, u32::try_from(y).ok()?)?;
            self.cells[i].clone()
        };
        VisibilityTile {
            id: block,
            depth: self.depth,
            reach: self.settings.reach,
            layers_dm: self.settings.layers_dm,
            cells: (0..across * across).map(|i| cell_at(corner[0] + i % across, corner[1] + i / across)).collect(),
        }
    }

    /// The cell above a leaf square.
    pub fn cell(&self, x: u32, y: u32) -> Option<&VisibleCell> {
        self.cells[self.leaves.index(x, y)?].as_ref()
    }
}

/// What a cell sees of the squares of all scales around it. `beyond` is the value of what lies beyond the leaves.
fn around(leaves: &LeafRectangle, i: usize, reach: u8, seen: &[LayerNumber], beyond: LayerNumber) -> Vec<u8> {
    let (x, y) = leaves.place(i);
    let reach = i64::from(reach);
    let side = 2 * reach + 1;
    let [west, south] = [leaves.x, leaves.y].map(i64::from);
    let [east, north] = [west + i64::from(leaves.width), south + i64::from(leaves.height)];
    let mut all = Vec::with_capacity(usize::from(SCALES) * (side * side) as usize);
    for scale in 0..SCALES {
        let levels = SCALE_LEVELS * scale;
        let corner = [x, y].map(|v| (i64::from(v) >> levels) - reach);
        let first = all.len();
        all.extend((0..side * side).map(|k| {
            let [x, y] = [corner[0] + k % side, corner[1] + k / side].map(|v| v << levels);
            let width = 1 << levels;
            let is_within = x >= west && y >= south && x + width <= east && y + width <= north;
            if is_within { UNSEEN } else { beyond }
        }));
        // The leaves of the squares.
        let range =
            |corner: i64, low: i64, high: i64| (corner << levels).max(low)..((corner + side) << levels).min(high);
        for y in range(corner[1], south, north) {
            let row = ((y >> levels) - corner[1]) * side - corner[0];
            for x in range(corner[0], west, east) {
                let layer = seen[((y - south) * (east - west) + x - west) as usize];
                let value = &mut all[first + (row + (x >> levels)) as usize];
                *value = (*value).min(layer);
            }
        }
    }
    all
}

/// Where the ground is.
struct CellGrounds<'a> {
    heights: &'a CityHeights,
    /// Lowest tops around each square: the ground between the buildings, if the city stores none.
    lowest: LowestWindows,
}

impl<'a> CellGrounds<'a> {
    fn new(heights: &'a CityHeights) -> Self {
        Self { heights, lowest: LowestWindows::new(heights.width, heights.height, &heights.tops) }
    }

    /// The cell of a leaf, and its ground in half metres.
    fn cell(&self, i: usize, settings: &Settings) -> (i16, ViewCell) {
        let heights = self.heights;
        let leaf = [i % heights.leaves.width as usize, i / heights.leaves.width as usize];
        let ground_m = heights.scale.height_m(self.ground(i, leaf));
        let ground = (ground_m * 2.0).ceil().clamp(f32::from(i16::MIN), f32::from(i16::MAX)) as i16;
        let top_m = |top: u16| f64::from(ground) / 2.0 + f64::from(top) / 10.0;
        let tops: [f32; LAYERS] = settings.layers_dm.map(|top| heights.scale.code_at(top_m(top)));
        (ground, ViewCell { leaf, tops })
    }

    fn ground(&self, i: usize, [column, row]: [usize; 2]) -> u16 {
        let heights = self.heights;
        let stored = heights.ground[i];
        if stored > 0 {
            return stored;
        }
        // The lowest tops around each place, so that buildings do not count.
        let reach = (GROUND_REACH_M / heights.square_m) as isize;
        let window = WINDOW_SIDE as isize;
        let lowest_around = |x: isize, y: isize| {
            let places = |v: isize| [v - reach, v - window / 2, v + reach - window];
            let all = places(y).into_iter().flat_map(|y| places(x).map(|x| self.lowest.at(x, y)));
            all.filter(|code| *code > 0).min().unwrap_or(0)
        };
        let side = heights.per_leaf as usize;
        let range = |v: usize| (v * side) as isize..((v + 1) * side) as isize;
        let places = range(row).step_by(4).flat_map(|y| range(column).step_by(4).map(move |x| (x, y)));
        places.map(|(x, y)| lowest_around(x, y)).max().unwrap_or(0)
    }
}

/// Squares along a window's side, as a power of two.
const SIDE_LOG: usize = 4;
/// Squares along a window's side.
const WINDOW_SIDE: usize = 1 << SIDE_LOG;

/// A grid's lowest values in all square windows. Zeroes are no values.
#[derive(Debug)]
pub(crate) struct LowestWindows {
    /// Size with the windows that begin to the west and south of the grid.
    width: usize,
    height: usize,
    values: Vec<u16>,
}

impl LowestWindows {
    /// The windows of a grid of `width` squares a row.
    pub(crate) fn new(width: usize, height: usize, values: &[u16]) -> Self {
        let (inner_width, width, height) = (width, width + WINDOW_SIDE, height + WINDOW_SIDE);
        let mut all = vec![0; width * height];
        for (row, values) in all.chunks_exact_mut(width).skip(WINDOW_SIDE).zip(values.chunks_exact(inner_width)) {
            row[WINDOW_SIDE..].copy_from_slice(values);
        }
        let lower = |a: u16, b: u16| if a.min(b) == 0 { a.max(b) } else { a.min(b) };
        for k in 0..SIDE_LOG {
            // Values of windows half as wide, in place: those that are still needed lie further on.
            let step = 1 << k;
            for row in all.chunks_exact_mut(width) {
                (0..width - step).for_each(|x| row[x] = lower(row[x], row[x + step]));
            }
            for i in 0..width * (height - step) {
                all[i] = lower(all[i], all[i + width * step]);
            }
        }
        Self { width, height, values: all }
    }

    /// The lowest value of the window whose south-western square is `x`, `y`. 0 where it has none.
    pub(crate) fn at(&self, x: isize, y: isize) -> u16 {
        let [x, y] = [x, y].map(|v| usize::try_from(v + WINDOW_SIDE as isize).unwrap_or(usize::MAX));
        if x < self.width && y < self.height { self.values[y * self.width + x] } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_have_the_lowest_value_that_is_not_zero() {
        let (width, height) = (23usize, 19usize);
        let values: Vec<u16> = (0..width * height).map(|i| ((i * 7919) % 97) as u16 * u16::from(i % 5 != 0)).collect();
        let windows = LowestWindows::new(width, height, &values);
        let side = WINDOW_SIDE as isize;
        for y in -side - 2..height as isize + 2 {
            for x in -side - 2..width as isize + 2 {
                let inside = |v: isize, size: usize| v.max(0) as usize..(v + side).clamp(0, size as isize) as usize;
                let all = inside(y, height).flat_map(|y| inside(x, width).map(move |x| y * width + x));
                let lowest = all.map(|i| values[i]).filter(|value| *value > 0).min().unwrap_or(0);
                assert_eq!(windows.at(x, y), lowest, "{x} {y}");
            }
        }
    }
}
