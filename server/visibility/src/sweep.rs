//! Bundles of lines, and what the eyes on them can see.
//!
//! A cell's outgoing lines are divided by direction into ranges of slopes, and those of a range by where they leave the cell into
//! strips. Each bundle is followed outwards through the city's heights. At every distance its lines cross a short segment of a row of
//! squares. What is solid over the whole segment hides what lies behind, for all lines and thus for all eyes of the bundle together:
//! its slope is kept as a horizon (Bittner, Wonka and Wimmer 2005 subdivide the space of lines; the horizons fuse occluders). What
//! rises above the horizon anywhere near the segment is potentially visible. Bundles side by side are followed together, one in each
//! lane of a vector.
//!
//! Heights only: columns are solid from below up to a height. A line from a lower eye to the same point lies lower everywhere, so the
//! eyes of a layer see at most what its highest eyes see. They are told apart by their place along the bundle ([`SLICES`]) as long as
//! it is near: those in front of a wall do not lower the horizon of those behind it.
//!
//! Lengths are in fine squares, heights in codes, slopes in codes for each fine square.

use crate::Settings;
use crate::heights::CityHeights;
use crate::row_tables::{LANES, MAX_SOLID_RUN, MAX_TOP_RUN, MainAxis, RowTables, TOP_LEVELS};
use fearless_simd::prelude::*;
use fearless_simd::{Level, SimdMask, dispatch, f32x8};
use insula_protocol::visibility_tile::{LAYERS, SCALE_LEVELS, SCALES};

/// Number of a layer, or [`LAYERS`] for what no layer sees.
pub(crate) type LayerNumber = u8;

/// Fine squares across a bundle where it begins.
const STRIP: i32 = 2;
/// Parts of a cell, one behind the other, of which the eyes are looked at apart.
const SLICES: usize = 4;
/// Way between rows whose solids are looked at, as a share of the distance. A block of rows is up to twice as long.
const STEP_SHARE: f32 = 1.0 / 80.0;
/// What is further below the eyes than this is not taken as hiding anything.
const LOW: f32 = 8.0;
/// Slope of a horizon that hides nothing, and of one that hides everything.
const OPEN: f32 = -1e9;
const CLOSED: f32 = 1e9;

#[derive(Debug, Clone, Copy)]
pub(crate) struct ViewCell {
    /// Column and row of its leaf from the south-west.
    pub(crate) leaf: [usize; 2],
    /// The highest eyes of each layer, in codes.
    pub(crate) tops: [f32; LAYERS],
}

/// Follows the bundles of cells whose lines follow one axis more than the other.
pub(crate) struct Sweep<'a> {
    tables: &'a RowTables,
    axis: MainAxis,
    level: Level,
    /// Leaves along the rows' order and across.
    leaves: [usize; 2],
    /// Squares along a leaf's side.
    per_leaf: usize,
    /// Fine squares along a leaf's side, as a power of two.
    side_log: u32,
    /// Most rows that are followed.
    reach: usize,
    /// Least slope between a horizon and what it hides, along a line.
    margin: f32,
    /// Ranges of slopes for each of the two ways.
    ranges: u32,
}

/// Bundles side by side, [`STRIP`] apart, with one range of slopes. Distances along the lines count from where they leave the cell.
#[derive(Clone, Copy)]
struct Fan {
    /// Columns for each row: the least and the greatest.
    slopes: [f32; 2],
    /// Least slope along the rows' order between a horizon and what it hides.
    margin: f32,
    /// Whether lines are followed towards lower rows.
    is_back: bool,
    /// The row after the cell's, counted in the lines' way.
    exit: usize,
    /// First and last column of the cell.
    columns: [i32; 2],
    /// First column of the first bundle where it leaves the cell.
    first: i32,
}

/// What the eyes of one slice on the bundles of a fan know at some distance.
#[derive(Clone, Copy)]
struct Horizons<S: Simd> {
    /// Before all eyes, and behind all of them.
    first: f32x8<S>,
    last: f32x8<S>,
    /// The horizon is a line with this slope that passes through the eyes' height at `origin`. What lies below it is hidden.
    slope: f32x8<S>,
    origin: f32x8<S>,
}

impl<S: Simd> Horizons<S> {
    /// The height above the eyes below which everything between two distances is hidden.
    #[inline(always)]
    fn limit(&self, simd: S, from: f32, to: f32) -> f32x8<S> {
        let (from, to) = (f32x8::splat(simd, from), f32x8::splat(simd, to));
        let is_up = self.slope.simd_gt(f32x8::splat(simd, 0.0));
        let at = is_up.select(from, to);
        self.slope * (at - self.origin).max(f32x8::splat(simd, 0.01))
    }

    /// Takes in what is solid in a row, given above the eyes, in codes.
    #[inline(always)]
    fn raise(&mut self, simd: S, rise: f32x8<S>, at: f32, margin: f32) {
        let at = f32x8::splat(simd, at);
        let is_above = rise.simd_gt(f32x8::splat(simd, 0.0));
        let origin = is_above.select(self.first, self.last);
        let slope = rise / (at - origin) - f32x8::splat(simd, margin);
        let is_higher = at.simd_gt(self.last) & slope.simd_gt(self.slope);
        self.slope = is_higher.select(slope, self.slope);
        self.origin = is_higher.select(origin, self.origin);
    }
}

#[inline(always)]
fn floats<S: Simd>(simd: S, codes: [u16; LANES]) -> f32x8<S> {
    // A loop: `map` of an array is compiled without the instruction set, as calls for each of its elements.
    let mut values = [0.0; LANES];
    for lane in 0..LANES {
        values[lane] = f32::from(codes[lane]);
    }
    f32x8::from_slice(simd, &values)
}

/// The whole number below a value, which must be within those of an i32. Without an instruction of its own, `f32::floor` is a call.
#[inline(always)]
fn floor(v: f32) -> i32 {
    let whole = v as i32;
    whole - i32::from(v < whole as f32)
}

impl<'a> Sweep<'a> {
    pub(crate) fn new(heights: &CityHeights, tables: &'a RowTables, axis: MainAxis, settings: &Settings) -> Self {
        let (width, height) = (heights.leaves.width as usize, heights.leaves.height as usize);
        let widest = 1usize << (SCALE_LEVELS * (SCALES - 1));
        Self {
            tables,
            axis,
            level: Level::new(),
            leaves: match axis {
                MainAxis::X => [width, height],
                MainAxis::Y => [height, width],
            },
            per_leaf: heights.per_leaf as usize,
            side_log: heights.per_leaf.ilog2() + 1,
            reach: (usize::from(settings.reach) + 1) * widest * heights.per_leaf as usize,
            margin: settings.slope_margin * heights.square_m / 2.0 / heights.scale.code_m(),
            ranges: settings.sectors / 4,
        }
    }

    /// Notes in `seen`, for each leaf square, the lowest layer that sees it.
    pub(crate) fn see(&self, cell: &ViewCell, seen: &mut [LayerNumber]) {
        let level = self.level;
        dispatch!(level, simd => self.see_with(simd, cell, seen));
    }

    #[inline(always)]
    fn see_with<S: Simd>(&self, simd: S, cell: &ViewCell, seen: &mut [LayerNumber]) {
        let side = 2 * self.per_leaf as i32;
        let [row, column] = match self.axis {
            MainAxis::X => cell.leaf,
            MainAxis::Y => [cell.leaf[1], cell.leaf[0]],
        };
        let columns = [column as i32 * side, (column as i32 + 1) * side];
        for is_back in [false, true] {
            let exit = match is_back {
                false => 2 * self.per_leaf * (row + 1),
                true => 2 * (self.tables.rows - self.per_leaf * row),
            };
            for range in 0..self.ranges {
                let slopes = [range, range + 1].map(|v| 2.0 * v as f32 / self.ranges as f32 - 1.0);
                // The way along a line is longer than along the rows' order.
                let steepest = slopes[0].abs().max(slopes[1].abs());
                let margin = self.margin * (1.0 + steepest * steepest).sqrt();
                let from = columns[0] + floor((slopes[0] * side as f32).min(0.0));
                let to = columns[1] + floor((slopes[1] * side as f32).max(0.0)) + 1;
                let mut first = from;
                while first < to {
                    let fan = Fan { slopes, margin, is_back, exit, columns, first };
                    simd.vectorize(
                        #[inline(always)]
                        || self.follow(simd, cell, &fan, seen),
                    );
                    first += STRIP * LANES as i32;
                }
            }
        }
    }

    /// The columns that a bundle covers over a part of its way, from where its first line leaves the cell.
    #[inline(always)]
    fn span(fan: &Fan, from: f32, to: f32) -> [f32; 2] {
        let ends = [fan.slopes[0] * from, fan.slopes[0] * to, fan.slopes[1] * from, fan.slopes[1] * to];
        let low = ends[0].min(ends[1]).min(ends[2].min(ends[3]));
        let high = ends[0].max(ends[1]).max(ends[2].max(ends[3]));
        [low, high + STRIP as f32]
    }

    /// The lowest solids where bundles cross a fine row, in codes.
    #[inline(always)]
    fn solids<S: Simd>(&self, simd: S, fan: &Fan, row: usize, row_log: u32, span: [f32; 2]) -> f32x8<S> {
        let first = fan.first + floor(span[0]);
        let count = (fan.first + floor(span[1]) - first + 1) as usize;
        if count > MAX_SOLID_RUN {
            return f32x8::splat(simd, 0.0);
        }
        let row = if fan.is_back { 2 * self.tables.rows - 1 - row } else { row };
        floats(simd, self.tables.solids(row, row_log, first, count))
    }

    /// Where the eyes of each layer and slice are.
    #[inline(always)]
    fn eyes<S: Simd>(&self, simd: S, cell: &ViewCell, fan: &Fan) -> [[Horizons<S>; SLICES]; LAYERS] {
        let none = Horizons {
            first: f32x8::splat(simd, f32::INFINITY),
            last: f32x8::splat(simd, f32::NEG_INFINITY),
            slope: f32x8::splat(simd, CLOSED),
            origin: f32x8::splat(simd, -1e5),
        };
        let mut horizons = [[none; SLICES]; LAYERS];
        let side = 2 * self.per_leaf;
        let lanes: [f32; LANES] = std::array::from_fn(|lane| (fan.first + STRIP * lane as i32) as f32);
        let lanes = f32x8::from_slice(simd, &lanes);
        for row in 0..side {
            let at = row as f32 - side as f32;
            let span = Self::span(fan, at, at + 1.0);
            let solids = self.solids(simd, fan, fan.exit - side + row, 0, span);
            let is_inside = (lanes + f32x8::splat(simd, span[1])).simd_ge(f32x8::splat(simd, fan.columns[0] as f32))
                & (lanes + f32x8::splat(simd, span[0])).simd_lt(f32x8::splat(simd, fan.columns[1] as f32));
            let slice = row * SLICES / side;
            for layer in 0..LAYERS {
                let is_free = solids.simd_lt(f32x8::splat(simd, cell.tops[layer])) & is_inside;
                let eyes = &mut horizons[layer][slice];
                eyes.first = is_free.select(eyes.first.min(f32x8::splat(simd, at)), eyes.first);
                eyes.last = is_free.select(f32x8::splat(simd, at + 1.0), eyes.last);
            }
        }
        for eyes in horizons.iter_mut().flatten() {
            let has_eyes = eyes.last.simd_gt(f32x8::splat(simd, f32::NEG_INFINITY));
            eyes.slope = has_eyes.select(f32x8::splat(simd, OPEN), eyes.slope);
            eyes.origin = has_eyes.select(eyes.last, eyes.origin);
        }
        horizons
    }

    /// Follows bundles side by side outwards, and notes what they may see.
    #[inline(always)]
    fn follow<S: Simd>(&self, simd: S, cell: &ViewCell, fan: &Fan, seen: &mut [LayerNumber]) {
        let horizons = self.eyes(simd, cell, fan);
        for (layer, mut horizons) in horizons.into_iter().enumerate() {
            self.follow_layer(simd, (layer as LayerNumber, cell.tops[layer]), fan, &mut horizons, seen);
        }
    }

    #[inline(always)]
    fn follow_layer<S: Simd>(
        &self,
        simd: S,
        (layer, eye): (LayerNumber, f32),
        fan: &Fan,
        horizons: &mut [Horizons<S>; SLICES],
        seen: &mut [LayerNumber],
    ) {
        let start = horizons.iter().flat_map(|eyes| {
            let last: [f32; LANES] = eyes.last.into();
            last.into_iter().filter(|last| *last > f32::NEG_INFINITY)
        });
        let start = start.fold(f32::INFINITY, f32::min);
        if start == f32::INFINITY {
            return;
        }
        let end = self.tables.rows.min(fan.exit / 2 + self.reach);
        let mut row = (fan.exit as i32 + floor(start)) as usize / 2;
        let merge_row = fan.exit / 2 + self.per_leaf;
        let top_level = self.per_leaf.ilog2().min(TOP_LEVELS as u32 - 1);
        let mut slices = SLICES;
        while row < end {
            let from = 2.0 * row as f32 - fan.exit as f32;
            if slices > 1 && row >= merge_row {
                merge(simd, horizons, from);
                slices = 1;
            }
            let horizons = &mut horizons[..slices];
            let steps = (from * STEP_SHARE).max(1.0) as u32;
            let aligned = row.trailing_zeros();
            let level = steps.ilog2().min(aligned).min(top_level);
            if from > 0.0 && aligned >= level + 2 {
                let wide = aligned.min(level + 3).min(TOP_LEVELS as u32 - 1);
                match self.visible(simd, eye, fan, horizons, (row, wide, from)) {
                    None => return,
                    // Low ground hides nothing, and may be seen already.
                    Some((bits, is_low))
                        if bits == 0
                            || is_low
                                && wide <= top_level
                                && self.all_leaves(fan, (row, wide, from), bits, |at| seen[at] <= layer) =>
                    {
                        row += 1 << wide;
                        continue;
                    }
                    _ => {}
                }
            }
            let (bits, is_low) = match self.visible(simd, eye, fan, horizons, (row, level, from)) {
                Some(seen) => seen,
                None if from >= 0.0 => return,
                None => (0, true),
            };
            if bits != 0 {
                self.all_leaves(fan, (row, level, from), bits, |at| {
                    seen[at] = seen[at].min(layer);
                    true
                });
            }
            if bits != 0 && !is_low {
                self.raise(simd, eye, fan, horizons, (row, level));
            }
            row += 1 << level;
        }
    }

    /// Which of the bundles see something in a block of rows, as bits, and whether all of it is far below the eyes. `None` if the
    /// block is beyond the city.
    #[inline(always)]
    fn visible<S: Simd>(
        &self,
        simd: S,
        eye: f32,
        fan: &Fan,
        horizons: &[Horizons<S>],
        (row, level, from): (usize, u32, f32),
    ) -> Option<(u64, bool)> {
        let to = from + (2 << level) as f32;
        let [low, high] = Self::span(fan, from, to);
        let (low, high) = (floor((fan.first as f32 + low) * 0.5), floor((fan.first as f32 + high) * 0.5));
        let count = (high - low + 1) as usize;
        if low >= self.tables.columns as i32 || high + (LANES as i32) < 0 {
            return None;
        }
        let block = row >> level;
        let block = if fan.is_back { (self.tables.rows >> level) - 1 - block } else { block };
        let tops = floats(simd, self.tables.tops(block, level as usize, low, count.min(MAX_TOP_RUN)));
        let rise = tops - f32x8::splat(simd, eye);
        let mut lowest = f32x8::splat(simd, f32::INFINITY);
        for eyes in horizons {
            let is_behind = f32x8::splat(simd, to).simd_gt(eyes.first);
            let limit = is_behind.select(eyes.limit(simd, from, to), f32x8::splat(simd, CLOSED));
            lowest = lowest.min(limit);
        }
        let is_seen = rise.simd_gt(lowest) & tops.simd_gt(f32x8::splat(simd, 0.0));
        let is_low = !rise.simd_gt(f32x8::splat(simd, -LOW)).any_true();
        Some((is_seen.to_bitmask(), is_low))
    }

    /// Whether a check holds for all leaf squares that bundles, given as bits, cross in a block of rows.
    #[inline(always)]
    fn all_leaves(
        &self,
        fan: &Fan,
        (row, level, from): (usize, u32, f32),
        bits: u64,
        mut check: impl FnMut(usize) -> bool,
    ) -> bool {
        let span = Self::span(fan, from, from + (2 << level) as f32);
        let leaf = |lane: u32, aside: f32| (fan.first + STRIP * lane as i32 + floor(aside)) >> self.side_log;
        let low = leaf(bits.trailing_zeros(), span[0]).max(0);
        let high = leaf(63 - bits.leading_zeros(), span[1]).min(self.leaves[1] as i32 - 1);
        let along = row >> (self.side_log - 1);
        let along = if fan.is_back { (self.tables.rows >> (self.side_log - 1)) - 1 - along } else { along };
        let (along_step, across_step) = match self.axis {
            MainAxis::X => (1, self.leaves[0]),
            MainAxis::Y => (self.leaves[1], 1),
        };
        along >= self.leaves[0] || (low..=high).all(|across| check(along * along_step + across as usize * across_step))
    }

    /// Takes in what is solid in a block of rows.
    #[inline(always)]
    fn raise<S: Simd>(&self, simd: S, eye: f32, fan: &Fan, horizons: &mut [Horizons<S>], (row, level): (usize, u32)) {
        let spacing = 1usize << level;
        for half in 0..2 {
            // The rows of a table are at multiples of the spacing, from the first row of the city on.
            let fine = 2 * row + half * spacing + if fan.is_back { spacing - 1 } else { 0 };
            let at = fine as f32 + 0.5 - fan.exit as f32;
            let rise = self.solids(simd, fan, fine, level, Self::span(fan, at, at)) - f32x8::splat(simd, eye);
            for eyes in horizons.iter_mut() {
                eyes.raise(simd, rise, at, fan.margin);
            }
        }
    }
}

/// Joins the horizons of all slices at a distance: a line is left that is nowhere above any of theirs beyond.
#[inline(always)]
fn merge<S: Simd>(simd: S, horizons: &mut [Horizons<S>; SLICES], at: f32) {
    let mut all = horizons[0];
    let mut lowest = all.limit(simd, at, at);
    for eyes in &horizons[1..] {
        all.first = all.first.min(eyes.first);
        all.last = all.last.max(eyes.last);
        lowest = lowest.min(eyes.limit(simd, at, at));
    }
    let has_eyes = all.last.simd_gt(f32x8::splat(simd, f32::NEG_INFINITY));
    let is_up = lowest.simd_gt(f32x8::splat(simd, 0.0));
    let origin = is_up.select(all.first, all.last);
    let slope = lowest / (f32x8::splat(simd, at) - origin);
    all.slope = has_eyes.select(slope, f32x8::splat(simd, CLOSED));
    all.origin = has_eyes.select(origin, f32x8::splat(simd, -1e5));
    horizons[0] = all;
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::rng::Rng;

    /// Blocks of houses between streets.
    fn town() -> CityHeights {
        let mut rng = Rng::new(2);
        let mut heights = CityHeights::of_squares([6, 5], |_| 800);
        for _ in 0..400 {
            let (x, y) = (rng.below(2 * heights.width - 20), rng.below(2 * heights.height - 20));
            let (code, side) = (rng.between(820, 1_000), 6 + rng.below(14));
            for (x, y) in (y..y + side).flat_map(|y| (x..x + side).map(move |x| (x, y))) {
                heights.solids[y * 2 * heights.width + x] = code;
                let top = &mut heights.tops[y / 2 * heights.width + x / 2];
                *top = code.max(*top);
            }
        }
        heights
    }

    #[test]
    fn sets_do_not_depend_on_the_instruction_set() {
        let heights = town();
        let mut hidden = 0;
        for axis in [MainAxis::X, MainAxis::Y] {
            let tables = RowTables::new(&heights, axis);
            let best = Sweep::new(&heights, &tables, axis, &Settings::default());
            let least = Sweep { level: Level::baseline(), ..Sweep::new(&heights, &tables, axis, &Settings::default()) };
            for leaf in [[2, 2], [0, 4], [5, 1]] {
                let cell = ViewCell { leaf, tops: [824.0, 864.0, 960.0] };
                let [mut a, mut b] = [vec![LAYERS as LayerNumber; 30], vec![LAYERS as LayerNumber; 30]];
                best.see(&cell, &mut a);
                least.see(&cell, &mut b);
                assert_eq!(a, b);
                hidden += a.iter().filter(|layer| **layer > 0).count();
            }
        }
        assert!(hidden > 10, "{hidden}");
    }
}
