//! Triangles into blocks of leaves.
//!
//! In: the scene and its grid. Out: [`Partition`]: the leaves that may hold something, block by block, and the triangles
//! that may touch or shade them. Next: `sample`, one block at a time.
//!
//! Linear in the triangles: each is looked at three times (which leaves, how many blocks, which blocks).

use std::collections::BTreeMap;

use insula_protocol::TileId;
use rayon::prelude::*;

use crate::{
    grid::{BLOCK_LEAVES, Grid},
    scene::{Scene, Triangle},
};

const _: () = assert!(BLOCK_LEAVES <= 8, "a block's leaves are kept as the bits of a u64");
/// Triangles that one task looks at.
const CHUNK: usize = 1 << 14;

/// One block: at most `BLOCK_LEAVES` x `BLOCK_LEAVES` leaves, aligned to multiples of that.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Block {
    /// Column of blocks.
    pub x: u32,
    /// Row of blocks.
    pub y: u32,
    /// Bit `y * BLOCK_LEAVES + x` is set if that leaf may hold something.
    leaves: u64,
    first: usize,
    end: usize,
}

/// All blocks that hold something, row by row.
#[derive(Debug, Clone)]
pub struct Partition {
    /// In order of (y, x).
    pub blocks: Vec<Block>,
    depth: u8,
    triangles: Vec<u32>,
}

impl Partition {
    /// Sorts the scene's triangles. `margin_m` is how far around a block a triangle still counts for it, because it may
    /// shade it (design 5). The triangles must be finite.
    pub fn new(scene: &Scene, grid: &Grid, margin_m: f64) -> Self {
        let leaves = leaves_by_block(scene, grid);
        let mut blocks: Vec<Block> =
            leaves.into_iter().map(|((y, x), leaves)| Block { x, y, leaves, first: 0, end: 0 }).collect();
        let reach = Reach::new(grid, margin_m);
        let mut counts = vec![0usize; blocks.len()];
        for triangle in &scene.triangles {
            reach.each_block(triangle, &blocks, |i| counts[i] += 1);
        }
        let mut total = 0;
        for (block, count) in blocks.iter_mut().zip(&counts) {
            (block.first, block.end) = (total, total);
            total += count;
        }
        let mut triangles = vec![0u32; total];
        let mut ends: Vec<usize> = blocks.iter().map(|block| block.end).collect();
        for (index, triangle) in scene.triangles.iter().enumerate() {
            reach.each_block(triangle, &blocks, |i| {
                triangles[ends[i]] = index as u32;
                ends[i] += 1;
            });
        }
        for (block, end) in blocks.iter_mut().zip(ends) {
            block.end = end;
        }
        Self { blocks, depth: grid.depth, triangles }
    }

    /// Indices of the triangles that touch the block and its margin, ascending.
    pub fn triangles(&self, block: &Block) -> &[u32] {
        &self.triangles[block.first..block.end]
    }

    /// The block's leaves that may hold something, row by row.
    pub fn leaves(&self, block: &Block) -> Vec<TileId> {
        (0..BLOCK_LEAVES * BLOCK_LEAVES)
            .filter(|bit| block.leaves >> bit & 1 == 1)
            .filter_map(|bit| {
                let (x, y) = (block.x * BLOCK_LEAVES + bit % BLOCK_LEAVES, block.y * BLOCK_LEAVES + bit / BLOCK_LEAVES);
                TileId::new(self.depth, x, y)
            })
            .collect()
    }
}

type Masks = BTreeMap<(u32, u32), u64>;

fn leaves_by_block(scene: &Scene, grid: &Grid) -> Masks {
    let merge = |mut all: Masks, one: Masks| {
        for (block, mask) in one {
            *all.entry(block).or_default() |= mask;
        }
        all
    };
    scene.triangles.par_chunks(CHUNK).map(|triangles| masks_of(triangles, grid)).reduce(Masks::new, merge)
}

fn masks_of(triangles: &[Triangle], grid: &Grid) -> Masks {
    let side = grid.node_side_m(grid.depth);
    let last = (1u32 << grid.depth) - 1;
    let mut masks = Masks::new();
    for triangle in triangles {
        let p = corners_in(triangle, grid);
        let [x, y] = [0, 1].map(|axis| range(span(&p, axis), side, last));
        let one = x[0] == x[1] && y[0] == y[1];
        for leaf_y in y[0]..=y[1] {
            for leaf_x in x[0]..=x[1] {
                let low = [f64::from(leaf_x) * side, f64::from(leaf_y) * side];
                if one || touches(&p, low, side) {
                    let bit = leaf_y % BLOCK_LEAVES * BLOCK_LEAVES + leaf_x % BLOCK_LEAVES;
                    *masks.entry((leaf_y / BLOCK_LEAVES, leaf_x / BLOCK_LEAVES)).or_default() |= 1 << bit;
                }
            }
        }
    }
    masks
}

/// Corners in metres from the grid's corner, seen from above.
fn corners_in(triangle: &Triangle, grid: &Grid) -> [[f64; 2]; 3] {
    triangle.corners.map(|c| [f64::from(c[0]) - grid.corner[0], f64::from(c[1]) - grid.corner[1]])
}

fn span(p: &[[f64; 2]; 3], axis: usize) -> [f64; 2] {
    let v = p.map(|corner| corner[axis]);
    [v[0].min(v[1]).min(v[2]), v[0].max(v[1]).max(v[2])]
}

/// First and last square of side `side` that the closed interval touches, within `0..=last`.
fn range(span: [f64; 2], side: f64, last: u32) -> [u32; 2] {
    // A float cast saturates: what lies outside the root counts for its rim.
    [((span[0] / side).ceil() as i64 - 1).clamp(0, i64::from(last)) as u32, ((span[1] / side) as u32).min(last)]
}

/// Whether the triangle touches the square at `low`, given that its bounding box does: no edge separates them.
fn touches(p: &[[f64; 2]; 3], low: [f64; 2], side: f64) -> bool {
    let q = [low, [low[0] + side, low[1]], [low[0], low[1] + side], [low[0] + side, low[1] + side]];
    let separates = |i: usize| {
        let (a, b) = (p[i], p[(i + 1) % 3]);
        let distance = |c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let own = distance(p[(i + 2) % 3]);
        (own >= 0.0 && q.iter().all(|c| distance(*c) < 0.0)) || (own <= 0.0 && q.iter().all(|c| distance(*c) > 0.0))
    };
    !(0..3).any(separates)
}

/// Which blocks a triangle counts for.
struct Reach<'a> {
    grid: &'a Grid,
    margin_m: f64,
    side_m: f64,
    last: u32,
}

impl<'a> Reach<'a> {
    fn new(grid: &'a Grid, margin_m: f64) -> Self {
        let last = ((1u32 << grid.depth) - 1) / BLOCK_LEAVES;
        Self { grid, margin_m, side_m: grid.node_side_m(grid.depth) * f64::from(BLOCK_LEAVES), last }
    }

    /// Calls `each` with the index of every block whose margin the triangle's bounding box touches.
    fn each_block(&self, triangle: &Triangle, blocks: &[Block], mut each: impl FnMut(usize)) {
        let p = corners_in(triangle, self.grid);
        let [x, y] = [0, 1].map(|axis| {
            let [low, high] = span(&p, axis);
            range([low - self.margin_m, high + self.margin_m], self.side_m, self.last)
        });
        for row in y[0]..=y[1] {
            let start = blocks.partition_point(|block| (block.y, block.x) < (row, x[0]));
            let in_row = blocks[start..].iter().take_while(|block| block.y == row && block.x <= x[1]);
            (start..start + in_row.count()).for_each(&mut each);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(corners: [[f32; 3]; 3]) -> Triangle {
        Triangle { corners, uv: [[0.0; 2]; 3], material: 0, object: 0 }
    }

    fn scene(triangles: Vec<Triangle>) -> Scene {
        Scene { triangles, ..Scene::default() }
    }

    fn grid(depth: u8) -> Grid {
        Grid { corner: [0.0; 3], depth, cell_m: 1.0 }
    }

    fn id(x: u32, y: u32) -> TileId {
        TileId::new(5, x, y).unwrap()
    }

    #[test]
    fn a_small_triangle_is_in_one_leaf_and_shades_the_next_block() {
        let scene = scene(vec![
            triangle([[500.0, 10.0, 0.0], [505.0, 10.0, 0.0], [500.0, 15.0, 5.0]]),
            triangle([[600.0, 10.0, 0.0], [605.0, 10.0, 0.0], [600.0, 15.0, 5.0]]),
            triangle([[900.0, 10.0, 0.0], [905.0, 10.0, 0.0], [900.0, 15.0, 5.0]]),
        ]);
        let partition = Partition::new(&scene, &grid(5), 64.0);
        let leaves: Vec<_> = partition.blocks.iter().map(|block| partition.leaves(block)).collect();
        assert_eq!(leaves, [[id(7, 0)], [id(9, 0)], [id(14, 0)]]);
        let triangles: Vec<_> = partition.blocks.iter().map(|block| partition.triangles(block)).collect();
        assert_eq!(triangles, [&[0][..], &[0, 1], &[2]]);
        let wider = Partition::new(&scene, &grid(5), 100.0);
        assert_eq!(wider.triangles(&wider.blocks[0]), [0, 1]);
    }

    #[test]
    fn a_slanting_triangle_leaves_out_the_leaves_beside_it() {
        let sliver = triangle([[1.0, 1.0, 0.0], [2040.0, 2045.0, 0.0], [2045.0, 2040.0, 0.0]]);
        let partition = Partition::new(&scene(vec![sliver]), &grid(5), 0.0);
        let leaves: Vec<_> = partition.blocks.iter().flat_map(|block| partition.leaves(block)).collect();
        assert!((0..32).all(|i| leaves.contains(&id(i, i))));
        assert!(!leaves.contains(&id(0, 31)));
        assert!(leaves.len() < 100, "{}", leaves.len());
    }

    #[test]
    fn what_lies_on_an_edge_is_in_both_leaves() {
        let wall = triangle([[64.0, 10.0, 0.0], [64.0, 20.0, 0.0], [64.0, 15.0, 9.0]]);
        let partition = Partition::new(&scene(vec![wall]), &grid(5), 0.0);
        assert_eq!(partition.leaves(&partition.blocks[0]), [id(0, 0), id(1, 0)]);
    }

    #[test]
    fn every_sample_of_every_triangle_lies_in_a_listed_leaf() {
        let mut seed = 7u32;
        let mut random = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as f32 / (1 << 24) as f32 * 2047.0
        };
        let triangles: Vec<_> =
            (0..200).map(|_| triangle(std::array::from_fn(|_| [random(), random(), 0.0]))).collect();
        let scene = scene(triangles);
        let partition = Partition::new(&scene, &grid(5), 64.0);
        for (index, triangle) in scene.triangles.iter().enumerate() {
            for (u, v) in [(0.2, 0.3), (0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 0.5), (0.1, 0.8)] {
                let [a, b, c] = triangle.corners;
                let [x, y] = [0, 1].map(|k| ((a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k])) / 64.0) as u32);
                let block = partition
                    .blocks
                    .iter()
                    .find(|block| (block.x, block.y) == (x / BLOCK_LEAVES, y / BLOCK_LEAVES))
                    .unwrap();
                assert!(partition.leaves(block).contains(&id(x, y)));
                assert!(partition.triangles(block).binary_search(&(index as u32)).is_ok());
            }
        }
        assert!(partition.blocks.is_sorted_by_key(|block| (block.y, block.x)));
    }
}
