//! Greedy merge of solids into rectangles of columns.

use super::solids::Solid;
use super::{QUARTERS, mean};
use insula_protocol::blockmap::{COLUMNS, NODE_CELLS};

/// Most that the tops of a rectangle differ, in sixteenths of a cell: half a cell.
pub(super) const HEIGHT_RANGE: u32 = 8;
/// Most that a component of the colours of a rectangle's tops differs, in 8-bit sRGB.
pub(super) const COLOUR_RANGE: u8 = 40;
/// Sixteenths of a cell in a unit of heights.
const UNIT: u32 = 16 / QUARTERS as u32;

/// A box over a rectangle of columns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Block {
    /// First column and row, and those after the last, in cells.
    pub(super) min: [usize; 2],
    pub(super) max: [usize; 2],
    /// Quarters of a cell above the node's base, `low < high`.
    pub(super) low: u16,
    pub(super) high: u16,
    /// Means of the columns, 8-bit sRGB.
    pub(super) roof: [u8; 3],
    pub(super) wall: [u8; 3],
    pub(super) feature: u32,
    pub(super) is_floating: bool,
}

/// The boxes of one layer.
pub(super) struct Layer {
    pub(super) blocks: Vec<Block>,
    /// Index of the box of each column.
    pub(super) of_column: Vec<Option<usize>>,
}

impl Layer {
    /// Merges solids, by column, row by row from the south-west.
    pub(super) fn of(solids: &[Option<Solid>]) -> Self {
        let mut layer = Self { blocks: Vec::new(), of_column: vec![None; COLUMNS] };
        for i in 0..COLUMNS {
            let is_free = |j: usize| layer.of_column[j].is_none();
            let Some(seed) = solids[i].filter(|_| is_free(i)) else { continue };
            let free = |x: usize, y: usize| {
                let j = y * NODE_CELLS + x;
                (x < NODE_CELLS && y < NODE_CELLS && is_free(j)).then(|| solids[j]).flatten()
            };
            let start = [i % NODE_CELLS, i / NODE_CELLS];
            let [a, b] = [0, 1].map(|axis| grow(start, &seed, axis, &free));
            let area = |[x, y]: [usize; 2]| (x - start[0]) * (y - start[1]);
            let end = if area(b) > area(a) { b } else { a };
            let columns: Vec<usize> = rectangle(start, end).collect();
            let members: Vec<Solid> = columns.iter().filter_map(|j| solids[*j]).collect();
            columns.iter().for_each(|j| layer.of_column[*j] = Some(layer.blocks.len()));
            layer.blocks.push(block(start, end, &members));
        }
        layer
    }
}

fn rectangle(min: [usize; 2], max: [usize; 2]) -> impl Iterator<Item = usize> {
    (min[1]..max[1]).flat_map(move |y| (min[0]..max[0]).map(move |x| y * NODE_CELLS + x))
}

/// The end of the rectangle that grows from `start` along one axis first and then along the other.
fn grow(start: [usize; 2], seed: &Solid, axis: usize, free: &dyn Fn(usize, usize) -> Option<Solid>) -> [usize; 2] {
    let mut end = start.map(|at| at + 1);
    let mut range = Range::of(seed);
    for axis in [axis, 1 - axis] {
        loop {
            // The next row or column of the rectangle.
            let (mut min, mut max) = (start, end);
            (min[axis], max[axis]) = (end[axis], end[axis] + 1);
            let grown = (min[1]..max[1]).try_fold(range, |range, y| {
                (min[0]..max[0]).try_fold(range, |range, x| range.with(seed, &free(x, y)?))
            });
            match grown {
                Some(grown) => (range, end) = (grown, max),
                None => break,
            }
        }
    }
    end
}

/// What the tops of a rectangle are between.
#[derive(Debug, Clone, Copy)]
struct Range {
    high: [u32; 2],
    roof: [[u8; 3]; 2],
}

impl Range {
    fn of(solid: &Solid) -> Self {
        Self { high: [solid.high; 2], roof: [solid.roof; 2] }
    }

    /// The range with another solid; `None` if that must not be merged with `seed`, or the range becomes too large.
    fn with(&self, seed: &Solid, solid: &Solid) -> Option<Self> {
        let is_alike = solid.feature == seed.feature && solid.is_floating == seed.is_floating;
        let has_bottom = !solid.is_floating || solid.low.abs_diff(seed.low) <= HEIGHT_RANGE / 2;
        let high = [self.high[0].min(solid.high), self.high[1].max(solid.high)];
        let roof = [
            [0, 1, 2].map(|k| self.roof[0][k].min(solid.roof[k])),
            [0, 1, 2].map(|k| self.roof[1][k].max(solid.roof[k])),
        ];
        let is_near = high[1] - high[0] <= HEIGHT_RANGE && (0..3).all(|k| roof[1][k] - roof[0][k] <= COLOUR_RANGE);
        (is_alike && has_bottom && is_near).then_some(Self { high, roof })
    }
}

/// The box of a rectangle: its top is in the middle of the tops of its `members`, its bottom at their lowest.
fn block(min: [usize; 2], max: [usize; 2], members: &[Solid]) -> Block {
    let fold =
        |value: fn(&Solid) -> u32, pick: fn(u32, u32) -> u32| members.iter().map(value).reduce(pick).unwrap_or(0);
    let high = fold(|solid| solid.high, u32::min) + fold(|solid| solid.high, u32::max);
    // Codes of heights have at most 16 bits in sixteenths of a cell.
    let high = ((high + UNIT) / (2 * UNIT)).max(1) as u16;
    let low = ((fold(|solid| solid.low, u32::min) / UNIT) as u16).min(high - 1);
    let roof = mean(members.iter().map(|solid| solid.roof)).unwrap_or_default();
    let wall = mean(members.iter().filter_map(|solid| solid.wall)).unwrap_or(roof);
    let (feature, is_floating) = members.first().map_or((0, false), |solid| (solid.feature, solid.is_floating));
    Block { min, max, low, high, roof, wall, feature, is_floating }
}
