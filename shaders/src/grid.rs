//! The grid in which rays find the nodes of a draw list: for each level, squares around the camera.
//!
//! A square of a level is empty, or a node fills it (its own node, or its part of a coarser one), or it is mixed: then
//! the next finer level has its entries. So a ray may begin anywhere at the level that its distance asks for, and
//! the cost of a step does not depend on the depth of the city's tree. The finer levels reach only as far as the draw
//! list has mixed squares, and no further than [`MAX_ENTRIES`] allow: squares beyond are drawn by a coarser node, if the list has
//! one. Draw lists of a view do not reach that far. Those of a camera that has just jumped may, and hostile cities do.
//!
//! A node may lie in the square of a coarser one. The finer one is drawn there, the coarser one in the rest of its
//! square.
//!
//! A square that cross-fades has two nodes and a share. Each ray sees one of the two, chosen by the ray's threshold. So
//! there are no holes, and no node is seen through another.

use crate::layout::{
    DrawNode, FADE_RAYS, FrameUniform, GRID_LEVEL_SHIFT, GRID_LEVELS, GRID_MIXED, GRID_NODE_BIT, GRID_NODES,
    GRID_SHARE_SHIFT,
};
use glam::DVec3;
use insula_protocol::TileId;

/// Position of the city's root square relative to the camera, and the view's tolerance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridFrame {
    /// South-west corner of the root square relative to the camera, in metres.
    pub root_corner: DVec3,
    /// Side of the root square in metres.
    pub root_side_m: f64,
    /// Distance in metres from which nodes of the root's level are good enough. Only a hint of where rays look first.
    pub root_distance_m: f64,
}

/// The squares of all levels.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NodeGrid {
    /// The grid's part of a [`FrameUniform`].
    pub head: GridHeader,
    /// Per square what it holds, and its lowest and highest point ([`GRID_NODE_BIT`]).
    pub entries: Vec<[u32; 2]>,
}

/// The grid's part of a [`FrameUniform`], whose fields have the same names.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GridHeader {
    /// Camera within its finest square, in squares.
    pub eye: [f32; 2],
    /// The finest square that the camera is in.
    pub eye_cell: [i32; 2],
    /// Side of a finest square in metres.
    pub side_m: f32,
    /// Levels, finest first. The last one has one square. 0 without nodes.
    pub levels: u32,
    /// Camera's height in steps of height.
    pub z_eye: f32,
    /// Steps of height per metre.
    pub z_scale: f32,
    /// 1 / the distance in metres from which nodes of the finest level are good enough.
    pub level_scale: f32,
    /// Per level: first entry, log2 of the window's side, the window's west and south end.
    pub windows: [[i32; 4]; GRID_LEVELS],
}

impl GridHeader {
    /// Writes it into a frame's uniform.
    pub fn write(&self, frame: &mut FrameUniform) {
        (frame.eye, frame.eye_cell, frame.side_m) = (self.eye, self.eye_cell, self.side_m);
        (frame.levels, frame.z_eye, frame.z_scale) = (self.levels, self.z_eye, self.z_scale);
        (frame.level_scale, frame.windows) = (self.level_scale, self.windows);
    }
}

/// Most entries of a grid: 32 MiB. A window may have 512 squares on a side at every level, or 1024 at three of them.
pub const MAX_ENTRIES: usize = 1 << 22;
/// Largest height of an entry, in steps.
pub const Z_TOP: f32 = 65535.0;
/// Index that means no node, or no child.
const NONE: u32 = u32::MAX;

/// A node of the quadtree from which the grid is built.
#[derive(Debug, Clone, Copy)]
struct QuadtreeNode {
    node: u32,
    child: [u32; 4],
}

/// A square: its level, finest 0, and its position.
#[derive(Debug, Clone, Copy)]
struct GridSquare {
    k: u32,
    x: i32,
    y: i32,
}

impl GridSquare {
    fn child(self, quadrant: usize) -> Self {
        let (dx, dy) = ((quadrant & 1) as i32, (quadrant >> 1) as i32);
        Self { k: self.k - 1, x: self.x * 2 + dx, y: self.y * 2 + dy }
    }
}

/// Builds grids, with memory that is reused from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct GridBuilder {
    quads: Vec<QuadtreeNode>,
    shares: Vec<u8>,
    grid: NodeGrid,
    z: Vec<[u32; 2]>,
}

impl GridBuilder {
    /// The grid of a draw list: `ids` and `nodes` are in the same order, nodes relative to the camera. Nodes beyond
    /// [`GRID_NODES`] are left out.
    pub fn build(&mut self, frame: &GridFrame, ids: &[TileId], nodes: &[DrawNode]) -> &NodeGrid {
        self.build_fading(frame, ids, &[], nodes)
    }

    /// The same with squares that cross-fade: `shares[i]` of [`FADE_RAYS`] rays see node `i + 1`, which has the same
    /// square, instead of node `i`. 0 is a square that does not.
    pub fn build_fading(&mut self, frame: &GridFrame, ids: &[TileId], shares: &[u8], nodes: &[DrawNode]) -> &NodeGrid {
        let ids = &ids[..ids.len().min(nodes.len()).min(GRID_NODES)];
        self.grid.entries.clear();
        self.grid.head = GridHeader::default();
        self.shares.clear();
        self.shares
            .extend(shares.iter().take(ids.len().saturating_sub(1)).map(|rays| (*rays).min(FADE_RAYS as u8 - 1)));
        self.shares.resize(ids.len(), 0);
        let Some(finest) = ids.iter().map(|id| id.level()).max().filter(|level| usize::from(*level) < GRID_LEVELS)
        else {
            return &self.grid;
        };
        self.grid.head = header(frame, finest);
        self.quantise_heights(nodes);
        self.build_quadtree(ids);
        self.size_windows();
        let root = GridSquare { k: u32::from(finest), x: 0, y: 0 };
        self.emit(root, 0, NONE);
        &self.grid
    }

    /// Rounds all heights outwards to whole steps.
    fn quantise_heights(&mut self, nodes: &[DrawNode]) {
        let metres = |node: &DrawNode| {
            [node.z_lo, node.z_hi].map(|code| f64::from(node.corner[2]) + f64::from(code) * f64::from(node.z_step_m))
        };
        let (low, high) = nodes
            .iter()
            .map(metres)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), [a, b]| (low.min(a), high.max(b)));
        let scale = f64::from(Z_TOP) / (high - low).max(1e-3);
        (self.grid.head.z_eye, self.grid.head.z_scale) = ((-low * scale) as f32, scale as f32);
        self.z.clear();
        self.z.extend(nodes.iter().map(metres).map(|[a, b]| {
            let (a, b) = (((a - low) * scale).floor(), ((b - low) * scale).ceil());
            [a.clamp(0.0, f64::from(Z_TOP)) as u32, b.clamp(0.0, f64::from(Z_TOP)) as u32]
        }));
        for i in (0..self.shares.len()).filter(|i| self.shares[*i] > 0) {
            let (z, other) = (self.z[i], self.z[i + 1]);
            self.z[i] = [z[0].min(other[0]), z[1].max(other[1])];
        }
    }

    /// Builds the quadtree of the draw list, the root first.
    fn build_quadtree(&mut self, ids: &[TileId]) {
        const BARE: QuadtreeNode = QuadtreeNode { node: NONE, child: [NONE; 4] };
        self.quads.clear();
        self.quads.push(BARE);
        for (node, id) in ids.iter().enumerate() {
            if node > 0 && self.shares[node - 1] > 0 {
                continue;
            }
            let mut at = 0;
            for quadrant in (1..=id.level()).filter_map(|level| id.ancestor(level)).map(TileId::quadrant) {
                if self.quads[at].child[quadrant] == NONE {
                    self.quads[at].child[quadrant] = self.quads.len() as u32;
                    self.quads.push(BARE);
                }
                at = self.quads[at].child[quadrant] as usize;
            }
            self.quads[at].node = node as u32;
        }
    }

    /// Makes every level's window large enough for the squares of its mixed parents, and takes the memory.
    fn size_windows(&mut self) {
        let head = &mut self.grid.head;
        let root = GridSquare { k: head.levels - 1, x: 0, y: 0 };
        let mut need = [0i32; GRID_LEVELS];
        let centre = |k: u32, axis: usize| {
            let last = (1i32 << (root.k - k)) - 1;
            (head.eye_cell[axis] >> k).clamp(0, last)
        };
        let mut stack = vec![(root, 0u32)];
        while let Some((square, at)) = stack.pop() {
            let quad = self.quads[at as usize];
            if quad.child == [NONE; 4] {
                continue;
            }
            for quadrant in 0..4 {
                let child = square.child(quadrant);
                let away = (child.x - centre(child.k, 0)).abs().max((child.y - centre(child.k, 1)).abs());
                let need = &mut need[child.k as usize];
                *need = (*need).max(away + 1);
                if quad.child[quadrant] != NONE {
                    stack.push((child, quad.child[quadrant]));
                }
            }
        }
        let wanted = |k: u32| (2 * need[k as usize] as u32).max(1).next_power_of_two().trailing_zeros().min(root.k - k);
        let sides = bounded_sides((0..=root.k).map(wanted).collect());
        let mut base = 0i32;
        let mut windows = [[0; 4]; GRID_LEVELS];
        for (k, log2) in (0..).zip(sides) {
            let whole = root.k - k;
            let low = |axis: usize| if log2 == whole { 0 } else { centre(k, axis) - (1 << log2) / 2 };
            windows[k as usize] = [base, log2 as i32, low(0), low(1)];
            base += 1 << (2 * log2);
        }
        head.windows = windows;
        self.grid.entries.resize(base as usize, [0; 2]);
    }

    /// Writes a square and all finer ones in it. Returns its lowest and highest point, the first larger if it is empty.
    fn emit(&mut self, square: GridSquare, at: u32, inherited: u32) -> [u32; 2] {
        let quad = if at == NONE { QuadtreeNode { node: NONE, child: [NONE; 4] } } else { self.quads[at as usize] };
        let node = if quad.node == NONE { inherited } else { quad.node };
        if quad.child == [NONE; 4] || !self.reaches_children(square) {
            if node == NONE {
                return [u32::MAX, 0];
            }
            let z = self.z[node as usize];
            let share = u32::from(self.shares[node as usize]) << GRID_SHARE_SHIFT;
            self.fill(square, [GRID_NODE_BIT | square.k << GRID_LEVEL_SHIFT | share | node, z[0] | z[1] << 16]);
            return z;
        }
        let mut z = [u32::MAX, 0];
        for quadrant in 0..4 {
            let [low, high] = self.emit(square.child(quadrant), quad.child[quadrant], node);
            z = [z[0].min(low), z[1].max(high)];
        }
        let [low, high] = [z[0].min(0xffff), z[1]];
        self.fill_level(square, square.k, [GRID_MIXED, low | high << 16]);
        z
    }

    /// Whether the window of the next finer level has all of a square.
    fn reaches_children(&self, square: GridSquare) -> bool {
        [square.child(0), square.child(3)].into_iter().all(|child| {
            let [_, log2, low_x, low_y] = self.grid.head.windows[child.k as usize];
            let side = 1 << log2;
            (0..side).contains(&(child.x - low_x)) && (0..side).contains(&(child.y - low_y))
        })
    }

    /// Writes `square` at its own level and at all finer ones.
    fn fill(&mut self, square: GridSquare, entry: [u32; 2]) {
        for k in (0..=square.k).rev() {
            self.fill_level(square, k, entry);
        }
    }

    /// Writes the part of `square` that lies in the window of level `k`.
    fn fill_level(&mut self, square: GridSquare, k: u32, entry: [u32; 2]) {
        let [base, log2, low_x, low_y] = self.grid.head.windows[k as usize];
        let (finer, side) = (square.k - k, 1i64 << log2);
        let range = |place: i32, low: i32| {
            let from = (i64::from(place) << finer) - i64::from(low);
            from.clamp(0, side) as usize..(from + (1 << finer)).clamp(0, side) as usize
        };
        let columns = range(square.x, low_x);
        for y in range(square.y, low_y) {
            let row = base as usize + (y << log2);
            self.grid.entries[row + columns.start..row + columns.end].fill(entry);
        }
    }
}

/// Halves the largest windows until all have [`MAX_ENTRIES`] together. Takes and returns logarithms of sides.
fn bounded_sides(mut sides: Vec<u32>) -> Vec<u32> {
    while sides.iter().map(|log2| 1u64 << (2 * log2)).sum::<u64>() > MAX_ENTRIES as u64 {
        let largest = sides.iter_mut().max();
        largest.into_iter().for_each(|log2| *log2 -= 1);
    }
    sides
}

fn header(frame: &GridFrame, finest: u8) -> GridHeader {
    let squares = f64::from(1u32 << finest);
    let side_m = frame.root_side_m / squares;
    // Far outside, the city is a point: the square need not be exact, only finite.
    let eye = [-frame.root_corner.x / side_m, -frame.root_corner.y / side_m].map(|v| v.clamp(-1e6, 1e6));
    GridHeader {
        eye: eye.map(|v| (v - v.floor()) as f32),
        eye_cell: eye.map(|v| v.floor() as i32),
        side_m: side_m as f32,
        levels: u32::from(finest) + 1,
        level_scale: (squares / frame.root_distance_m.max(1e-6)) as f32,
        ..GridHeader::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn node(low: f32, high: f32) -> DrawNode {
        DrawNode { z_step_m: 1.0, z_lo: low, z_hi: high, ..DrawNode::zeroed() }
    }

    fn id(level: u8, x: u32, y: u32) -> TileId {
        TileId::new(level, x, y).unwrap()
    }

    fn grid(eye: [f64; 2], ids: &[TileId]) -> NodeGrid {
        let nodes: Vec<DrawNode> = (0..ids.len()).map(|i| node(i as f32, 10.0 + i as f32)).collect();
        let root_corner = DVec3::new(-eye[0], -eye[1], 0.0);
        let frame = GridFrame { root_corner, root_side_m: 64.0, root_distance_m: 100.0 };
        GridBuilder::default().build(&frame, ids, &nodes).clone()
    }

    /// A city of 20 levels with a fine node beside the camera and one at the other end.
    #[test]
    fn far_fine_nodes_do_not_make_the_grid_large() {
        let last = (1 << 20) - 1;
        let ids = [id(20, 0, 0), id(20, last, last), id(1, 1, 0)];
        let nodes: Vec<DrawNode> = (0..ids.len()).map(|i| node(i as f32, 10.0 + i as f32)).collect();
        let frame = GridFrame { root_corner: DVec3::ZERO, root_side_m: 64.0 * 2f64.powi(20), root_distance_m: 1e8 };
        let grid = GridBuilder::default().build(&frame, &ids, &nodes).clone();
        assert!(grid.entries.len() <= MAX_ENTRIES, "{}", grid.entries.len());
        let near = entry(&grid, 0, 0, 0).unwrap();
        assert_eq!((near[0] & GRID_NODE_BIT, near[0] & (GRID_NODES as u32 - 1)), (GRID_NODE_BIT, 0));
        let coarse = entry(&grid, 19, last as i32, 0).unwrap();
        assert_eq!((coarse[0] & GRID_NODE_BIT, coarse[0] & (GRID_NODES as u32 - 1)), (GRID_NODE_BIT, 2));
    }

    #[test]
    fn windows_shrink_to_the_limit() {
        assert_eq!(bounded_sides(vec![3, 10, 10]), [3, 10, 10]);
        let sides = bounded_sides(vec![20; 21]);
        assert!(sides.iter().all(|log2| *log2 >= 8), "{sides:?}");
    }

    /// The entry of level `k` at a finest square; `None` outside the window.
    fn entry(grid: &NodeGrid, k: u32, x: i32, y: i32) -> Option<[u32; 2]> {
        let [base, log2, low_x, low_y] = grid.head.windows[k as usize];
        let (x, y) = ((x >> k) - low_x, (y >> k) - low_y);
        let inside = (0..1 << log2).contains(&x) && (0..1 << log2).contains(&y);
        inside.then(|| grid.entries[(base + (y << log2) + x) as usize])
    }

    /// The result of a walk that begins at level `k`: the node, and the level of the square that it fills.
    fn found(grid: &NodeGrid, mut k: u32, x: i32, y: i32) -> Option<(u32, u32)> {
        while entry(grid, k, x, y).is_none() {
            k += 1;
        }
        loop {
            let [word, _] = entry(grid, k, x, y).expect("mixed squares have all four quarters in the next window");
            match word {
                0 => return None,
                GRID_MIXED => k -= 1,
                _ => return Some((word & (GRID_NODES as u32 - 1), word >> GRID_LEVEL_SHIFT & 31)),
            }
        }
    }

    #[test]
    fn search_from_any_level_finds_the_same_node() {
        // A quarter is refined once, one of its quarters again; one child does not exist.
        let ids =
            [id(1, 1, 0), id(1, 0, 1), id(2, 0, 0), id(2, 1, 0), id(3, 2, 2), id(3, 3, 2), id(3, 3, 3), id(1, 1, 1)];
        for eye in [[1.0, 1.0], [63.0, 3.0], [-500.0, 900.0], [32.0, 32.0]] {
            let grid = grid(eye, &ids);
            assert_eq!(grid.head.levels, 4);
            for k in 0..4 {
                for (x, y) in (0..64).map(|i| (i % 8, i / 8)) {
                    let meant = ids.iter().position(|id| {
                        let up = 3 - id.level();
                        (x as u32 >> up, y as u32 >> up) == (id.x(), id.y())
                    });
                    let found = found(&grid, k, x, y);
                    assert_eq!(found.map(|f| f.0), meant.map(|i| i as u32), "from level {k} at {x}, {y}");
                    if let (Some((_, ext)), Some(i)) = (found, meant) {
                        assert_eq!(ext, u32::from(3 - ids[i].level()));
                    }
                }
            }
        }
    }

    #[test]
    fn finer_node_is_drawn_instead_of_its_part_of_a_coarser_one() {
        let ids = [id(0, 0, 0), id(2, 3, 3)];
        for eye in [[1.0, 1.0], [63.0, 63.0]] {
            let grid = grid(eye, &ids);
            for k in 0..3 {
                assert_eq!(found(&grid, k, 3, 3), Some((1, 0)));
                assert_eq!(found(&grid, k, 2, 3), Some((0, 0)), "the quarter next to it");
                assert_eq!(found(&grid, k, 0, 0), Some((0, 1)), "as large a part as there is");
            }
        }
    }

    #[test]
    fn cross_fading_square_has_a_share_and_the_heights_of_both_nodes() {
        let ids = [id(1, 0, 0), id(1, 0, 0), id(1, 1, 0)];
        let nodes = [node(5.0, 10.0), node(0.0, 8.0), node(2.0, 30.0)];
        let frame = GridFrame { root_corner: DVec3::ZERO, root_side_m: 64.0, root_distance_m: 100.0 };
        let mut builder = GridBuilder::default();
        for (rays, meant) in [(0, 0), (1, 1), (63, 63), (200, 63)] {
            let grid = builder.build_fading(&frame, &ids, &[rays], &nodes);
            let [word, z] = entry(grid, 0, 0, 0).unwrap();
            let high_m = if rays > 0 { 10 } else { 8 };
            assert_eq!((word >> GRID_SHARE_SHIFT & 63, z), (meant, (high_m * 65535u32).div_ceil(30) << 16));
            // Without a share, the second node of a square is drawn instead of the first.
            assert_eq!(found(grid, 0, 0, 0).map(|f| f.0), Some(u32::from(rays == 0)));
            assert_eq!(found(grid, 0, 1, 0), Some((2, 0)));
        }
        // The last node has none to cross-fade from.
        let grid = builder.build_fading(&frame, &ids, &[0, 0, 9], &nodes);
        assert_eq!(entry(grid, 0, 1, 0).unwrap()[0] >> GRID_SHARE_SHIFT & 63, 0);
    }

    #[test]
    fn heights_are_rounded_outwards_and_bound_finer_squares() {
        let ids = [id(1, 0, 0), id(1, 1, 0), id(1, 1, 1)];
        let grid = grid([10.0, 10.0], &ids);
        // All nodes together are 12 m high.
        let steps = |metres: i32| f64::from(metres) * f64::from(Z_TOP) / 12.0;
        for (i, at) in [(0, [0, 0]), (1, [1, 0]), (2, [1, 1])] {
            let z = entry(&grid, 0, at[0], at[1]).unwrap()[1];
            let [low, high] = [z & 0xffff, z >> 16].map(f64::from);
            assert!(low <= steps(i) && low > steps(i) - 1.0, "{low} {}", steps(i));
            assert!(high >= steps(10 + i) && high < steps(10 + i) + 1.0, "{high} {}", steps(10 + i));
        }
        let root = entry(&grid, 1, 0, 0).unwrap();
        assert_eq!(root, [GRID_MIXED, 0xffff << 16]);
    }

    #[test]
    fn finer_windows_end_where_squares_are_not_mixed() {
        // One node of the finest level at the camera, ever coarser ones around it.
        let mut ids = vec![];
        for level in 1..=8u8 {
            ids.extend([id(level, 1, 0), id(level, 0, 1), id(level, 1, 1)]);
        }
        ids.push(id(8, 0, 0));
        let grid = grid([0.1, 0.1], &ids);
        assert!(grid.entries.len() < 9 * 16, "{}", grid.entries.len());
        assert_eq!(found(&grid, 0, 255, 255), Some((2, 7)));
        assert_eq!(
            GridBuilder::default()
                .build(&GridFrame { root_corner: DVec3::ZERO, root_side_m: 1.0, root_distance_m: 1.0 }, &[], &[])
                .head
                .levels,
            0
        );
    }
}
