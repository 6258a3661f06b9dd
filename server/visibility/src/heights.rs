//! The heights of a whole city on one grid: up to where each square is solid, and how high its highest point is.
//!
//! They come from the shapes of all nodes without children; `cells` makes tables of them.

use crate::height_scale::HeightScale;
use crate::shape::NodeShape;
use insula_protocol::{BlockMap, NODE_CELLS, TileId};
use rayon::prelude::*;
use std::collections::HashMap;

/// Most squares of a grid. A larger city has larger squares, and its sets are less tight.
const MAX_SQUARES: u64 = 12 << 20;

/// Narrowest leaves of a city with sets, in metres: from higher than a leaf is wide, an eye sees over too much.
pub const MIN_LEAF_M: f64 = 16.0;
/// Most leaf squares of the rectangle around the leaves of a city with sets. Each cell's sweep takes time in proportion to the width and
/// height of the rectangle.
pub const MAX_LEAF_SQUARES: u64 = 1 << 16;

/// Why a city has no sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoSets {
    /// No node is a leaf.
    NoLeaves,
    /// Leaves are narrower than [`MIN_LEAF_M`].
    NarrowLeaves,
    /// There are more than [`MAX_LEAF_SQUARES`].
    TooLarge,
}

/// What a city's tree says about its nodes.
#[derive(Debug, Clone)]
pub struct CityExtent {
    /// Level of the leaves.
    pub depth: u8,
    /// Side of a leaf's column in metres.
    pub cell_m: f64,
    /// The lowest point of the city, in metres above its origin.
    pub lowest_m: f64,
    /// The nodes without children, in any order.
    pub terminals: Vec<TileId>,
}

impl CityExtent {
    /// Fails if the city has no sets.
    pub fn check(&self) -> Result<(), NoSets> {
        self.leaf_rectangle().map(drop)
    }

    fn leaf_rectangle(&self) -> Result<LeafRectangle, NoSets> {
        let leaves = self.terminals.iter().copied().filter(|id| id.level() == self.depth);
        let rectangle = LeafRectangle::around(leaves).ok_or(NoSets::NoLeaves)?;
        if self.cell_m * (NODE_CELLS as f64) < MIN_LEAF_M {
            return Err(NoSets::NarrowLeaves);
        }
        let squares = u64::from(rectangle.width) * u64::from(rectangle.height);
        if squares > MAX_LEAF_SQUARES { Err(NoSets::TooLarge) } else { Ok(rectangle) }
    }
}

/// The rectangle of leaf squares around all leaves: those of coarser nodes in it belong to it too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct LeafRectangle {
    /// The south-western leaf.
    pub(crate) x: u32,
    pub(crate) y: u32,
    /// Number of leaves to the east and to the north.
    pub(crate) width: u32,
    pub(crate) height: u32,
}

impl LeafRectangle {
    /// `None` without leaves.
    fn around(leaves: impl Iterator<Item = TileId> + Clone) -> Option<Self> {
        let range = |of: fn(TileId) -> u32| Some((leaves.clone().map(of).min()?, leaves.clone().map(of).max()?));
        let ((x, right), (y, top)) = (range(TileId::x)?, range(TileId::y)?);
        Some(Self { x, y, width: right - x + 1, height: top - y + 1 })
    }

    pub(crate) fn len(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// The number of a leaf square, row by row from the south-west.
    pub(crate) fn index(&self, x: u32, y: u32) -> Option<usize> {
        let (dx, dy) = (x.checked_sub(self.x)?, y.checked_sub(self.y)?);
        (dx < self.width && dy < self.height).then(|| dy as usize * self.width as usize + dx as usize)
    }

    /// Whether a node of a city with `depth` levels lies within the rectangle.
    pub(crate) fn contains(&self, id: TileId, depth: u8) -> bool {
        let levels = depth.saturating_sub(id.level());
        let is_within = |v: u32, first: u32, count: u32| v << levels >= first && (v + 1) << levels <= first + count;
        is_within(id.x(), self.x, self.width) && is_within(id.y(), self.y, self.height)
    }

    /// Column and row of a leaf square by its number.
    pub(crate) fn place(&self, index: usize) -> (u32, u32) {
        let index = index as u32;
        (self.x + index % self.width, self.y + index / self.width)
    }
}

/// The heights of a city. Rows go from south to north.
#[derive(Debug)]
pub(crate) struct CityHeights {
    pub(crate) leaves: LeafRectangle,
    /// Squares along a leaf's side.
    pub(crate) per_leaf: u32,
    /// Side of a square in metres.
    pub(crate) square_m: f32,
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) scale: HeightScale,
    /// Up to which code everything is solid, in squares of half the side.
    pub(crate) solids: Vec<u16>,
    /// The highest code of each square.
    pub(crate) tops: Vec<u16>,
    /// The highest ground of each leaf; 0 where the city stores none.
    pub(crate) ground: Vec<u16>,
    /// Whether a leaf square is a node of its own.
    pub(crate) is_leaf: Vec<bool>,
}

impl CityHeights {
    /// Reads all nodes without children. `None` if the city has no sets. Fails with the first error of `read`.
    pub(crate) fn read<E: Send>(
        extent: &CityExtent,
        read: impl Fn(TileId) -> Result<BlockMap, E> + Sync,
    ) -> Result<Option<Self>, E> {
        let Ok(rectangle) = extent.leaf_rectangle() else { return Ok(None) };
        let mut heights = Self::empty(extent, rectangle);
        heights.read_coarse_nodes(extent, &read)?;
        heights.read_leaves(extent, &read)?;
        Ok(Some(heights))
    }

    fn empty(extent: &CityExtent, leaves: LeafRectangle) -> Self {
        let mut per_leaf = NODE_CELLS as u32 / 2;
        while per_leaf > 1 && leaves.len() as u64 * u64::from(per_leaf * per_leaf) > MAX_SQUARES {
            per_leaf /= 2;
        }
        let (width, height) = ((leaves.width * per_leaf) as usize, (leaves.height * per_leaf) as usize);
        Self {
            leaves,
            per_leaf,
            square_m: (extent.cell_m * NODE_CELLS as f64 / f64::from(per_leaf)) as f32,
            width,
            height,
            scale: HeightScale::new(extent.lowest_m),
            solids: vec![0; 4 * width * height],
            tops: vec![0; width * height],
            ground: vec![0; leaves.len()],
            is_leaf: vec![false; leaves.len()],
        }
    }

    /// A city of `width` x `height` leaves with the same values of solids and tops that `value` gives one after the other.
    #[cfg(test)]
    pub(crate) fn of_squares([width, height]: [u32; 2], mut value: impl FnMut(usize) -> u16) -> Self {
        let extent = CityExtent { depth: 8, cell_m: 1.0, lowest_m: 0.0, terminals: Vec::new() };
        let mut heights = Self::empty(&extent, LeafRectangle { x: 0, y: 0, width, height });
        heights.solids.iter_mut().chain(&mut heights.tops).enumerate().for_each(|(i, to)| *to = value(i));
        heights.is_leaf.fill(true);
        heights
    }

    /// Reads the leaves row by row. Three rows are in memory at a time.
    fn read_leaves<E: Send>(
        &mut self,
        extent: &CityExtent,
        read: &(impl Fn(TileId) -> Result<BlockMap, E> + Sync),
    ) -> Result<(), E> {
        let mut rows: Vec<Vec<TileId>> = vec![Vec::new(); self.leaves.height as usize];
        for id in extent.terminals.iter().filter(|id| id.level() == extent.depth) {
            rows[(id.y() - self.leaves.y) as usize].push(*id);
        }
        let scale = self.scale;
        let load = |row: Option<&Vec<TileId>>| -> Result<HashMap<u32, NodeShape>, E> {
            let ids = row.map(Vec::as_slice).unwrap_or_default();
            ids.par_iter().map(|id| Ok((id.x(), NodeShape::new(read(*id)?, &scale)))).collect()
        };
        let (mut south, mut here) = (HashMap::new(), load(rows.first())?);
        for (y, row) in rows.iter().enumerate() {
            let north = load(rows.get(y + 1))?;
            let finished: Vec<(u32, NodeShape)> = row
                .par_iter()
                .filter_map(|id| {
                    let x = id.x();
                    let at = |x: Option<u32>| x.and_then(|x| here.get(&x));
                    let around = [at(x.checked_add(1)), north.get(&x), at(x.checked_sub(1)), south.get(&x)];
                    Some((x, here.get(&x)?.clone().open_gaps(around)))
                })
                .collect();
            for (x, shape) in &finished {
                self.put_leaf(*x - self.leaves.x, y as u32, shape);
            }
            (south, here) = (here, north);
        }
        Ok(())
    }

    /// Writes a leaf's shape; `x` and `y` count from the rectangle's corner.
    fn put_leaf(&mut self, x: u32, y: u32, shape: &NodeShape) {
        let index = (y * self.leaves.width + x) as usize;
        (self.ground[index], self.is_leaf[index]) = (shape.ground, true);
        let all = 0..NODE_CELLS;
        let fine = 2 * self.per_leaf as usize;
        for (row, column) in all.clone().flat_map(|row| all.clone().map(move |column| (row, column))) {
            let i = row * NODE_CELLS + column;
            let (sx, sy) =
                (x as usize * fine + column * fine / NODE_CELLS, y as usize * fine + row * fine / NODE_CELLS);
            let top = &mut self.tops[sy / 2 * self.width + sx / 2];
            *top = (*top).max(shape.tops[i]);
            let solid = &mut self.solids[sy * 2 * self.width + sx];
            let is_first = (row * fine).is_multiple_of(NODE_CELLS) && (column * fine).is_multiple_of(NODE_CELLS);
            *solid = if is_first { shape.solids[i] } else { (*solid).min(shape.solids[i]) };
        }
    }

    /// Writes the nodes of plain land above the leaves' level, as far as they lie in the rectangle.
    fn read_coarse_nodes<E: Send>(
        &mut self,
        extent: &CityExtent,
        read: &(impl Fn(TileId) -> Result<BlockMap, E> + Sync),
    ) -> Result<(), E> {
        for id in extent.terminals.iter().filter(|id| id.level() < extent.depth) {
            let levels = extent.depth - id.level();
            let start = |leaf: u32, first: u32| (leaf << levels).max(first);
            let end = |leaf: u32, first: u32, count: u32| ((leaf + 1) << levels).min(first + count);
            let (x0, x1) = (start(id.x(), self.leaves.x), end(id.x(), self.leaves.x, self.leaves.width));
            let (y0, y1) = (start(id.y(), self.leaves.y), end(id.y(), self.leaves.y, self.leaves.height));
            if x0 >= x1 || y0 >= y1 {
                continue;
            }
            let shape = NodeShape::new(read(*id)?, &self.scale).open_gaps([None; 4]);
            // A square that two columns share has the lower solid of both.
            let fine = u64::from(2 * self.per_leaf);
            let column_of = |square: u64, first_leaf: u64| {
                let scaled =
                    |square: u64| ((square - first_leaf * fine) * NODE_CELLS as u64 / (fine << levels)) as usize;
                scaled(square)
            };
            let corner = [id.x(), id.y()].map(|v| u64::from(v << levels));
            for y in u64::from(y0) * fine..u64::from(y1) * fine {
                for x in u64::from(x0) * fine..u64::from(x1) * fine {
                    let i = column_of(y, corner[1]) * NODE_CELLS + column_of(x, corner[0]);
                    let sy = (y - u64::from(self.leaves.y) * fine) as usize;
                    let sx = (x - u64::from(self.leaves.x) * fine) as usize;
                    self.solids[sy * 2 * self.width + sx] = shape.solids[i];
                    let top = &mut self.tops[sy / 2 * self.width + sx / 2];
                    *top = (*top).max(shape.tops[i]);
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cities_without_streets_have_no_sets() {
        let of = |cell_m: f64, terminals: &[(u8, u32, u32)]| {
            let terminals = terminals.iter().map(|(level, x, y)| TileId::new(*level, *x, *y).unwrap()).collect();
            CityExtent { depth: 9, cell_m, lowest_m: 0.0, terminals }.check()
        };
        assert_eq!(of(1.0, &[(9, 10, 20), (9, 265, 275), (2, 0, 0)]), Ok(()));
        assert_eq!(of(1.0, &[(9, 10, 20), (9, 265, 276)]), Err(NoSets::TooLarge));
        assert_eq!(of(0.25, &[(9, 1, 1)]), Ok(()));
        assert_eq!(of(0.24, &[(9, 1, 1)]), Err(NoSets::NarrowLeaves));
        assert_eq!(of(1.0, &[(8, 1, 1)]), Err(NoSets::NoLeaves));
    }
}
