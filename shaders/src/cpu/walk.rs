//! The walk of a ray segment: over the grid's squares, into their nodes, over blocks and cells (Amanatides and Woo
//! 1987). GPU twin: `walk.wgsl`.
//!
//! The CPU nests the loops: [`walk_grid`], `walk_node`, `walk_block`, `walk_column`. The GPU runs the same steps
//! (`begin_walk`, `next_square`, `begin_node`, `next_block`, `next_cell`, `may_hit`, `meets`, `hit_solid`) in loops
//! that resume where they stopped (`walk.wgsl` says why).
//!
//! Integer squares, blocks and cells are the walk's only position; every crossing is computed from the segment's
//! origin, so that errors do not add up.

use super::column::{ColumnVisit, may_hit};
use super::fast_math::{ahead_of, fast_max, fast_min, floor2, nonzero, nonzero2};
use super::mesh::walk_mesh;
use super::node::enter_node;
use super::ray::{MAX_STEPS, NodeRay, Ray};
use super::solid::hit_solid;
use crate::grid::Z_TOP;
use crate::layout::{
    BLOCK_CELLS, BLOCK_SHIFT, FrameUniform, GRID_LEVEL_MASK, GRID_LEVEL_SHIFT, GRID_MIXED, GRID_NODE_BIT,
    GRID_NODE_MASK, GRID_SHARE_MASK, GRID_SHARE_SHIFT, NODE_BLOCKS, QUAD_TOP_BITS, QUAD_TOP_MAX, SUMMARY_BYTE_SHIFT,
};
use glam::{IVec2, Vec2, Vec3Swizzles};

/// The segment in the grid, x and y in finest squares, z in steps of the grid's heights, `t` in metres; and the next
/// square.
struct GridWalk {
    o: Vec2,
    d: Vec2,
    inv: Vec2,
    z: f32,
    dz: f32,
    /// 1 along the axes on which the ray's coordinate grows, else 0.
    forward: IVec2,
    t_end: f32,
    /// Along the grid's side.
    squares: i32,
    square: IVec2,
    /// The level to look the square up at.
    level: u32,
    /// Where the ray enters the square.
    t: f32,
    /// Entries of the grid that were read.
    steps: u32,
    /// Whether the walk has ended.
    done: bool,
}

/// A square that a node fills, and where the ray crosses it.
struct NodeCrossing {
    node: u32,
    t_in: f32,
    t_out: f32,
}

/// The next block of the node that `ray.node` is in.
struct NodeWalk {
    ahead: Vec2,
    /// The same as a step, 1 or -1.
    step: IVec2,
    rises: bool,
    t_end: f32,
    block: IVec2,
    t: f32,
    done: bool,
}

/// A block whose heights the ray meets, and the next cell in it.
struct BlockWalk {
    ahead: Vec2,
    /// The same as a step, 1 or -1.
    step: IVec2,
    rises: bool,
    t_end: f32,
    block: IVec2,
    tops: QuadTops,
    cell: IVec2,
    t: f32,
    done: bool,
}

/// A cell whose quad's top the ray is not above.
struct CellCrossing {
    cell: IVec2,
    t_in: f32,
    t_out: f32,
    quad_top: f32,
}

/// Highest points of a block's quads of 2 x 2 cells, in height codes.
#[derive(Debug, Clone, Copy, Default)]
struct QuadTops {
    /// Highest point of the block, with a margin of one code for rounding.
    lowest: f32,
    highest: f32,
    /// Height of one unit of a quad's six bits.
    unit: f32,
    rows: [u32; 4],
}

/// An entry of the grid, and the level that it is of.
struct GridEntry {
    words: [u32; 2],
    level: u32,
}

/// Gathers the surface that the ray's segment hits: that in the grid, or a nearer one of what is added to the city.
pub(super) fn walk_scene(ray: &mut Ray<'_>) {
    let scene = ray.scene;
    if scene.frame.levels != 0 {
        walk_grid(ray);
    }
    for (index, _) in scene.additions() {
        if ray.segment.to_sun && ray.hit.is_hit {
            return;
        }
        walk_mesh(ray, index);
    }
}

/// Gathers the surfaces that the ray's segment hits. The grid must have levels.
pub(super) fn walk_grid(ray: &mut Ray<'_>) {
    let Some(mut walk) = GridWalk::begin_walk(ray) else { return };
    while let Some(NodeCrossing { node, t_in, t_out }) = walk.next_square(ray) {
        match ray.scene.nodes.get(node as usize) {
            None => {}
            Some(found) if found.mesh != 0 => walk_mesh(ray, node),
            Some(_) => walk_node(ray, node, t_in, t_out),
        }
        if ray.hit.is_hit {
            return;
        }
    }
}

/// Never inlined, as [`walk_column`] is not.
#[inline(never)]
pub(super) fn walk_node(ray: &mut Ray<'_>, node: u32, t_in: f32, t_out: f32) {
    let Some(mut walk) = NodeWalk::begin_node(ray, node, t_in, t_out) else { return };
    while let Some(block) = walk.next_block(ray) {
        walk_block(ray, block);
        if ray.hit.is_hit {
            return;
        }
    }
}

fn walk_block(ray: &mut Ray<'_>, mut walk: BlockWalk) {
    // A copy, so that it stays in registers while `ray` is written.
    let node = ray.node;
    while let Some(CellCrossing { cell, t_in, t_out, quad_top }) = walk.next_cell(&node) {
        ray.counts.cells += 1;
        if let Some(word) = may_hit(ray, cell, t_in, t_out, quad_top) {
            walk_column(ray, cell, t_in, t_out, word);
            if ray.hit.is_hit {
                return;
            }
        }
    }
}

/// Never inlined: most cells have no column that the ray may hit, and the walk over them should stay in registers.
#[inline(never)]
pub(super) fn walk_column(ray: &mut Ray<'_>, cell: IVec2, t_in: f32, t_out: f32, word: u32) {
    let mut column = ColumnVisit::read(ray, cell, t_in, t_out, word);
    while let Some(found) = column.meets(ray) {
        hit_solid(ray, &column, &found);
        if ray.hit.is_hit {
            return;
        }
    }
}

impl GridWalk {
    /// `None` if the segment misses the grid.
    fn begin_walk(ray: &Ray<'_>) -> Option<Self> {
        let (frame, segment) = (ray.scene.frame, &ray.segment);
        let o = Vec2::from(frame.eye) + segment.origin.xy() / frame.side_m;
        let (eye_cell, z) = (IVec2::from(frame.eye_cell), frame.z_eye + segment.origin.z * frame.z_scale);
        let d = nonzero2(segment.dir.xy() / frame.side_m);
        let inv = 1.0 / d;
        let dz = nonzero(segment.dir.z * frame.z_scale);
        let ahead = ahead_of(d);
        let squares = 1i32 << (frame.levels - 1);
        let low = (-eye_cell).as_vec2();
        let near = (low + (1.0 - ahead) * squares as f32 - o) * inv;
        let far = (low + ahead * squares as f32 - o) * inv;
        let (za, zb) = ((-1.0 - z) / dz, (Z_TOP + 1.0 - z) / dz);
        let t = fast_max(fast_max(fast_max(near.x, near.y), fast_min(za, zb)), 0.0);
        let t_end = fast_min(fast_min(fast_min(far.x, far.y), fast_max(za, zb)), segment.reach_m);
        let square = (floor2(o + d * t) + eye_cell).clamp(IVec2::ZERO, IVec2::splat(squares - 1));
        let level = level_at(frame, segment.eye_m + t);
        let forward = ahead.as_ivec2();
        let walk = Self { o, d, inv, z, dz, forward, t_end, squares, square, level, t, steps: 0, done: false };
        (t < t_end).then_some(walk)
    }

    /// The next square that a node fills.
    fn next_square(&mut self, ray: &mut Ray<'_>) -> Option<NodeCrossing> {
        let frame = ray.scene.frame;
        let (eye_cell, forward) = (IVec2::from(frame.eye_cell), self.forward);
        while !self.done {
            let entry = look_up(ray, self.square, self.level);
            self.steps += 1;
            let is_node = entry.words[0] & GRID_NODE_BIT != 0;
            let k = if is_node { entry.words[0] >> GRID_LEVEL_SHIFT & GRID_LEVEL_MASK } else { entry.level };
            let corner = self.square >> k << k;
            let edge = corner + (forward << k);
            let te = ((edge - eye_cell).as_vec2() - self.o) * self.inv;
            let exit = fast_max(fast_min(fast_min(te.x, te.y), self.t_end), self.t);
            let (z_in, z_out) = (self.z + self.dz * self.t, self.z + self.dz * exit);
            let below = fast_min(z_in, z_out) <= (entry.words[1] >> 16) as f32 + 1.0;
            let meets_heights = below && fast_max(z_in, z_out) + 1.0 >= (entry.words[1] & 0xffff) as f32;
            if meets_heights && entry.words[0] == GRID_MIXED && k > 0 {
                self.level = k - 1;
                self.done = self.steps >= MAX_STEPS;
                continue;
            }
            let mut next = floor2(self.o + self.d * exit) + eye_cell;
            next = next.clamp(corner, corner + ((1 << k) - 1));
            if te.x <= te.y {
                next.x = edge.x - 1 + forward.x;
            } else {
                next.y = edge.y - 1 + forward.y;
            }
            let inside = next.min_element() >= 0 && next.max_element() < self.squares;
            self.done = exit >= self.t_end || !inside || self.steps >= MAX_STEPS;
            // The largest square that holds the next place and not this one: larger ones were found to be mixed.
            let apart = 31u32.wrapping_sub(((self.square.x ^ next.x) | (self.square.y ^ next.y)).leading_zeros());
            self.level = level_at(frame, ray.segment.eye_m + exit).min(apart);
            self.square = next;
            let t_in = std::mem::replace(&mut self.t, exit);
            if meets_heights && is_node {
                return Some(NodeCrossing { node: seen_node(ray, entry.words[0]), t_in, t_out: exit });
            }
        }
        None
    }
}

impl NodeWalk {
    /// `None` if the ray passes above or below the node.
    fn begin_node(ray: &mut Ray<'_>, index: u32, t_in: f32, t_out: f32) -> Option<Self> {
        let [t, t_end] = enter_node(ray, index, t_in, t_out);
        if t > t_end {
            return None;
        }
        ray.counts.nodes += 1;
        let node = &ray.node;
        let first = floor2((node.o.xy() + node.d.xy() * t) / BLOCK_CELLS as f32);
        let block = first.clamp(IVec2::ZERO, IVec2::splat(NODE_BLOCKS as i32 - 1));
        let ahead = ahead_of(node.d.xy());
        let step = ahead.as_ivec2() * 2 - 1;
        Some(Self { ahead, step, rises: node.d.z > 0.0, t_end, block, t, done: false })
    }

    /// The next block that the ray does not pass above or below.
    fn next_block(&mut self, ray: &mut Ray<'_>) -> Option<BlockWalk> {
        while !self.done {
            let (node, block, t) = (ray.node, self.block, self.t);
            let te = ((block.as_vec2() + self.ahead) * BLOCK_CELLS as f32 - node.o.xy()) * node.inv;
            let exit = fast_min(te.x, te.y);
            let t_end = fast_max(fast_min(exit, self.t_end), t);
            ray.counts.fetches += 1;
            let at = node.summary + (block.y as usize * NODE_BLOCKS + block.x as usize) * 4;
            let tops = quad_tops(ray.scene.summaries.get(at..).and_then(|words| words.first_chunk()));
            let (lower_t, upper_t) = if self.rises { (t, t_end) } else { (t_end, t) };
            let meets_heights = node.z_at(lower_t) <= tops.highest && node.z_at(upper_t) >= tops.lowest;
            self.block = block + step_to_neighbour(self.step, te);
            let inside = self.block.min_element() >= 0 && self.block.max_element() < NODE_BLOCKS as i32;
            self.done = exit >= self.t_end || !inside;
            self.t = t_end;
            if meets_heights {
                let low = block * BLOCK_CELLS as i32;
                let cell = floor2(node.o.xy() + node.d.xy() * t).clamp(low, low + (BLOCK_CELLS as i32 - 1));
                let (ahead, step, rises) = (self.ahead, self.step, self.rises);
                return Some(BlockWalk { ahead, step, rises, t_end, block, tops, cell, t, done: false });
            }
        }
        None
    }
}

impl BlockWalk {
    /// The next cell whose quad the ray does not pass above.
    #[inline]
    fn next_cell(&mut self, node: &NodeRay) -> Option<CellCrossing> {
        while !self.done {
            let (cell, t_in) = (self.cell, self.t);
            let te = (cell.as_vec2() + self.ahead - node.o.xy()) * node.inv;
            let exit = fast_min(te.x, te.y);
            let t_out = fast_max(fast_min(exit, self.t_end), t_in);
            self.cell = cell + step_to_neighbour(self.step, te);
            self.done = exit >= self.t_end || self.cell >> BLOCK_SHIFT != self.block;
            self.t = t_out;
            let quad_top = quad_top(&self.tops, cell);
            if node.z_at(if self.rises { t_in } else { t_out }) <= quad_top {
                return Some(CellCrossing { cell, t_in, t_out, quad_top });
            }
        }
        None
    }
}

/// To the neighbour whose boundary the ray reaches first.
#[inline]
fn step_to_neighbour(step: IVec2, te: Vec2) -> IVec2 {
    if te.x <= te.y { IVec2::new(step.x, 0) } else { IVec2::new(0, step.y) }
}

#[inline]
fn quad_tops(words: Option<&[u32; 4]>) -> QuadTops {
    let rows = *words.unwrap_or(&[0xff << SUMMARY_BYTE_SHIFT, 0xff << SUMMARY_BYTE_SHIFT, 0, 0]);
    let [a, b, c, d] = rows.map(|word| word >> SUMMARY_BYTE_SHIFT);
    let (lowest, highest) = ((a | b << 8) as f32, (c | d << 8) as f32);
    let unit = (highest - lowest) * (1.0 / QUAD_TOP_MAX as f32);
    QuadTops { lowest: lowest - 1.0, highest: highest + 1.0, unit, rows }
}

/// Highest point of the cell's quad, with the same margin.
#[inline]
fn quad_top(tops: &QuadTops, cell: IVec2) -> f32 {
    let units = tops.rows[cell.y as usize >> 1 & 3] >> ((cell.x as u32 >> 1 & 3) * QUAD_TOP_BITS) & QUAD_TOP_MAX;
    tops.lowest + 2.0 + units as f32 * tops.unit
}

/// The node that the ray sees in a square: the one that the entry names, or the next one, from which the square
/// cross-fades.
fn seen_node(ray: &Ray<'_>, entry: u32) -> u32 {
    (entry & GRID_NODE_MASK) + u32::from(ray.threshold >> 6 < entry >> GRID_SHARE_SHIFT & GRID_SHARE_MASK)
}

/// The level whose nodes are good enough at distance `t`: its exponent is the logarithm, rounded down.
#[inline]
fn level_at(frame: &FrameUniform, t: f32) -> u32 {
    ((fast_max(t * frame.level_scale, 1.0).to_bits() >> 23) - 127).min(frame.levels - 1)
}

/// The entry for a finest square at `level`, or at the first coarser level whose window holds it.
#[inline]
fn look_up(ray: &mut Ray<'_>, square: IVec2, level: u32) -> GridEntry {
    ray.counts.steps += 1;
    let windows = &ray.scene.frame.windows;
    for (k, [base, log2_side, low_x, low_y]) in windows.iter().enumerate().skip(level as usize) {
        let place = (square >> k as i32) - IVec2::new(*low_x, *low_y);
        if (place >> *log2_side) == IVec2::ZERO {
            let at = base + (place.y << log2_side) + place.x;
            return GridEntry { words: ray.scene.grid.get(at as usize).copied().unwrap_or_default(), level: k as u32 };
        }
    }
    GridEntry { words: [0; 2], level: ray.scene.frame.levels - 1 }
}
