//! The walk of a packet over the blocks and cells of a node. The scalar code is `walk_node` of [`walk`](crate::cpu::walk).
//!
//! A ray's place is the edges at which it leaves its block or cell, and the number of that. Numbers of blocks have a free bit above
//! x and one above y, which are set outside of the node.

use super::column::{ColumnCrossing, hit_columns};
use super::hits::{Hits, Segments};
use super::lanes::{
    F, FastExtremes, I, Lanes, M, U, Vec2s, always, first_lane, float_u, floor_of, gather_page, has, lanes_of, once,
    splat, splat_i, splat_u, to_u,
};
use super::node_rays::{NodeRays, NodeWords};
use crate::cpu::ray::SceneRef;
use crate::cpu::walk;
use crate::layout::{
    BLOCK_CELLS, DrawNode, NODE_BLOCKS, QUAD_TOP_BITS, QUAD_TOP_MAX, QUARTER_MAX, SUMMARY_BYTE_SHIFT, WALK_PLANE,
};
use crate::pack::{FLAGS_SHIFT, HEIGHT_BITS, HEIGHT_MASK};
use fearless_simd::prelude::*;
use insula_protocol::NODE_CELLS;
use insula_protocol::blockmap::flag;

/// Words of a row of blocks, in numbers of blocks.
const BLOCK_ROW: i32 = 2 * NODE_BLOCKS as i32;
/// Bits of the numbers of blocks that are set outside of the node.
const OUTSIDE: i32 = NODE_BLOCKS as i32 | (NODE_BLOCKS as i32 * BLOCK_ROW);
/// Bits of the numbers of cells that are equal in a block, and differ from those of the blocks around it.
const BLOCK_BITS: i32 = ((NODE_BLOCKS - 1) * BLOCK_CELLS * (NODE_CELLS + 1)) as i32;
/// Bits of the numbers of cells that name the row of quads in a block.
const QUAD_ROW_BITS: [u32; 2] = [2 * NODE_CELLS as u32, 4 * NODE_CELLS as u32];

/// The next block of each ray.
struct BlockSteps<S: Simd> {
    t_end: F<S>,
    edge: Vec2s<S>,
    number: I<S>,
    t: F<S>,
    done: M<S>,
}

/// The block that each ray is in, and its next cell.
struct CellSteps<S: Simd> {
    /// Rays that are in a block.
    active: M<S>,
    t_end: F<S>,
    edge: Vec2s<S>,
    number: I<S>,
    t: F<S>,
    /// Highest point of the lowest quad, and height of one unit of a quad's six bits.
    lowest: F<S>,
    unit: F<S>,
    rows: [U<S>; 4],
}

/// Gathers the surfaces of a node that the rays in `group` hit between two distances.
#[inline(always)]
pub(super) fn walk_node<S: Simd>(
    simd: S,
    scene: &SceneRef<'_>,
    segments: &Segments<S>,
    (node, index): (&DrawNode, u32),
    group: M<S>,
    [t_in, t_out]: [F<S>; 2],
    hits: &mut Hits<S>,
) {
    let Some(words) = NodeWords::of(scene, node) else {
        for lane in lanes_of::<S>(group) {
            let mut ray = segments.lane(scene, lane);
            walk::walk_node(&mut ray, index, t_in[lane], t_out[lane]);
            hits.set_lane(lane, &ray.hit);
        }
        return;
    };
    let rays = NodeRays::new(simd, segments, (node, index), words);
    let Some((mut blocks, mut lanes)) = rays.begin_node(group, t_in, t_out) else { return };
    let mut cells = CellSteps::nowhere(simd);
    loop {
        loop {
            let wanting = lanes & !cells.active;
            // Rays that have left the node.
            lanes &= !(wanting & blocks.done);
            let wanting = wanting & !blocks.done;
            if wanting.all_false() {
                break;
            }
            rays.step_blocks(wanting, &mut blocks, &mut cells);
        }
        if lanes.all_false() {
            return;
        }
        let mut seeking = cells.active & lanes;
        let zero = splat(simd, 0.0);
        let mut found = ColumnCrossing {
            lanes: M::<S>::splat(simd, false),
            number: splat_u(simd, 0),
            ta: zero,
            te: zero,
            word: splat_u(simd, 0),
        };
        while seeking.any_true() {
            seeking = rays.step_cells(seeking, &mut cells, &mut found);
        }
        if found.lanes.any_true() {
            simd.vectorize(once!(|| hit_columns(scene, segments, &rays, &found, hits)));
            lanes &= !hits.is_hit;
            cells.active &= lanes;
        }
    }
}

impl<S: Simd> NodeRays<'_, S> {
    /// The rays that are between the node's lowest and highest point, and their first block.
    #[inline(always)]
    fn begin_node(&self, group: M<S>, t_in: F<S>, t_out: F<S>) -> Option<(BlockSteps<S>, M<S>)> {
        let (simd, node) = (self.simd, self.node);
        let a = (splat(simd, node.z_lo - 1.0) - self.o.z) / self.d.z;
        let b = (splat(simd, node.z_hi + 1.0) - self.o.z) / self.d.z;
        let (begin, end) = (t_in.fast_max(a.fast_min(b)), t_out.fast_min(a.fast_max(b)));
        let above = self.z_at(begin).fast_min(self.z_at(end)).simd_gt(self.highest(begin, end));
        let lanes = group & begin.simd_le(end) & !above;
        if lanes.all_false() {
            return None;
        }
        let (zero, last) = (splat(simd, 0.0), splat(simd, (NODE_BLOCKS - 1) as f32));
        let first = always!(|o: F<S>, d: F<S>| floor_of::<S>((o + d * begin) * (1.0 / BLOCK_CELLS as f32), zero, last));
        let (x, y) = (first(self.o.x, self.d.x), first(self.o.y, self.d.y));
        let edge = always!(|block: F<S>, ahead: F<S>| (block + ahead) * BLOCK_CELLS as f32);
        let blocks = BlockSteps {
            t_end: end,
            edge: Vec2s::<S> { x: edge(x, self.ahead.x), y: edge(y, self.ahead.y) },
            number: (y * BLOCK_ROW as f32 + x).to_int(),
            t: begin,
            done: M::<S>::splat(simd, false),
        };
        Some((blocks, lanes))
    }

    /// Highest point, with a margin of one code, of the quarters that the rays cross between two places.
    #[inline(always)]
    fn highest(&self, begin: F<S>, end: F<S>) -> F<S> {
        let (simd, node) = (self.simd, self.node);
        let half = splat(simd, NODE_CELLS as f32 / 2.0);
        let zeros = splat_u(simd, 0);
        let quarter =
            always!(|t: F<S>| [(self.o.x + self.d.x * t).simd_ge(half), (self.o.y + self.d.y * t).simd_ge(half)]);
        let ([ax, ay], [bx, by]) = (quarter(begin), quarter(end));
        // A byte for each quarter.
        let packed = (0..4).fold(0, always!(|word: u32, i: usize| word | (node.quarter_below(i) << (8 * i))));
        let below_of = always!(|x: M<S>, y: M<S>| {
            let shift = x.select(splat_u(simd, 8), zeros) + y.select(splat_u(simd, 16), zeros);
            (splat_u(simd, packed) >> shift) & 0xff
        });
        // From a quarter to the opposite one the ray crosses a third.
        let opposite = (ax ^ bx) & (ay ^ by);
        let below = opposite.select(zeros, below_of(ax, ay).min(below_of(bx, by)));
        splat(simd, node.z_hi + 1.0) - float_u::<S>(below) * (node.z_hi - node.z_lo) * (1.0 / QUARTER_MAX as f32)
    }

    /// Moves the rays in `wanting` on by a block. Those that it may stop are in its first cell then.
    #[inline(always)]
    fn step_blocks(&self, wanting: M<S>, blocks: &mut BlockSteps<S>, cells: &mut CellSteps<S>) {
        let simd = self.simd;
        let zero = splat(simd, 0.0);
        let (edge, number, t) = (blocks.edge, blocks.number, blocks.t);
        let (x_first, exit) = self.exit_at(edge);
        let t_end = exit.fast_min(blocks.t_end).fast_max(t);
        let rows = block_rows(simd, &self.words, to_u::<S>(number), wanting);
        let [a, b, c, d] = rows;
        let byte = always!(|word: U<S>| word >> SUMMARY_BYTE_SHIFT);
        let (a, b, c, d) = (byte(a), byte(b), byte(c), byte(d));
        let (lowest, highest) = (float_u::<S>(a | (b << 8)), float_u::<S>(c | (d << 8)));
        let (z_in, z_out) = (self.z_at(t), self.z_at(t_end));
        let meets = wanting & z_in.fast_min(z_out).simd_le(highest + 1.0) & z_in.fast_max(z_out).simd_ge(lowest - 1.0);
        let (step_x, step_y) = (wanting & x_first, wanting & !x_first);
        let size = BLOCK_CELLS as f32;
        blocks.edge.x = edge.x + step_x.select(self.step.x * size, zero);
        blocks.edge.y = edge.y + step_y.select(self.step.y * size, zero);
        let next_row = self.next_row >> (NODE_CELLS as u32 / BLOCK_ROW as u32).ilog2();
        let next = number + x_first.select(self.next_x, next_row);
        let outside = (next & OUTSIDE).simd_ne(splat_i(simd, 0));
        blocks.number = wanting.select(next, number);
        blocks.done |= wanting & (exit.simd_ge(blocks.t_end) | outside);
        blocks.t = wanting.select(t_end, t);
        if meets.all_false() {
            return;
        }
        let cell = always!(|o: F<S>, d: F<S>, edge: F<S>, ahead: F<S>| {
            let low = edge - ahead * size;
            floor_of::<S>(o + d * t, low, low + (size - 1.0))
        });
        let x = cell(self.o.x, self.d.x, edge.x, self.ahead.x);
        let y = cell(self.o.y, self.d.y, edge.y, self.ahead.y);
        cells.active |= meets;
        cells.number = meets.select((y * NODE_CELLS as f32 + x).to_int(), cells.number);
        cells.edge.x = meets.select(x + self.ahead.x, cells.edge.x);
        cells.edge.y = meets.select(y + self.ahead.y, cells.edge.y);
        cells.t = meets.select(t, cells.t);
        cells.t_end = meets.select(t_end, cells.t_end);
        cells.lowest = meets.select(lowest - 1.0 + 2.0, cells.lowest);
        cells.unit = meets.select((highest - lowest) * (1.0 / QUAD_TOP_MAX as f32), cells.unit);
        for row in 0..4 {
            cells.rows[row] = meets.select(rows[row], cells.rows[row]);
        }
    }

    /// Moves the rays in `seeking` on by a cell. Returns those that have found nothing yet and are still in their block.
    #[inline(always)]
    fn step_cells(&self, seeking: M<S>, cells: &mut CellSteps<S>, found: &mut ColumnCrossing<S>) -> M<S> {
        let simd = self.simd;
        let zero = splat(simd, 0.0);
        let (edge, number, t_in) = (cells.edge, cells.number, cells.t);
        let (x_first, exit) = self.exit_at(edge);
        let t_out = exit.fast_min(cells.t_end).fast_max(t_in);
        let next = number + x_first.select(self.next_x, self.next_row);
        let stays = ((next ^ number) & BLOCK_BITS).simd_eq(splat_i(simd, 0)) & exit.simd_lt(cells.t_end);
        let (step_x, step_y) = (seeking & x_first, seeking & !x_first);
        cells.edge.x = edge.x + step_x.select(self.step.x, zero);
        cells.edge.y = edge.y + step_y.select(self.step.y, zero);
        cells.number = seeking.select(next, number);
        cells.t = seeking.select(t_out, t_in);
        cells.active &= stays | !seeking;
        let number = to_u::<S>(number);
        let quad_top = cells.quad_top(simd, number);
        let (z_in, z_out) = (self.z_at(t_in), self.z_at(t_out));
        let (lower, upper) = (z_in.fast_min(z_out), z_in.fast_max(z_out));
        let below_quad = seeking & lower.simd_le(quad_top);
        let mut seeking = seeking & stays;
        if below_quad.any_true() {
            let word = gather_page(simd, self.words.planes[WALK_PLANE], number);
            let stops = may_hit(simd, word, lower, upper, quad_top) & below_quad;
            found.lanes |= stops;
            found.number = stops.select(number, found.number);
            found.ta = stops.select(t_in, found.ta);
            found.te = stops.select(t_out, found.te);
            found.word = stops.select(word, found.word);
            seeking &= !stops;
        }
        seeking
    }
}

impl<S: Simd> CellSteps<S> {
    #[inline(always)]
    fn nowhere(simd: S) -> Self {
        let zero = splat(simd, 0.0);
        let active = M::<S>::splat(simd, false);
        let rows = [splat_u(simd, 0); 4];
        let edge = Vec2s::<S> { x: zero, y: zero };
        Self { active, t_end: zero, edge, number: splat_i(simd, 0), t: zero, lowest: zero, unit: zero, rows }
    }

    /// Highest points of the cells' quads.
    #[inline(always)]
    fn quad_top(&self, simd: S, number: U<S>) -> F<S> {
        let (odd, upper) = (has(simd, number, QUAD_ROW_BITS[0]), has(simd, number, QUAD_ROW_BITS[1]));
        let [a, b, c, d] = self.rows;
        let row = upper.select(odd.select(d, c), odd.select(b, a));
        // Half of x, times the bits of a quad.
        let place = (number & 6) * (QUAD_TOP_BITS / 2);
        self.lowest + float_u::<S>((row >> place) & QUAD_TOP_MAX) * self.unit
    }
}

/// The four words of the blocks with these numbers.
#[inline(always)]
fn block_rows<S: Simd>(simd: S, words: &NodeWords<'_>, number: U<S>, lanes: M<S>) -> [U<S>; 4] {
    let blocks = words.blocks;
    let first = number[first_lane::<S>(lanes)];
    let side = NODE_BLOCKS as u32;
    if (lanes & number.simd_ne(splat_u(simd, first))).all_false() {
        let place = (first % side) + (first / BLOCK_ROW as u32) * side;
        let [a, b, c, d] = blocks[place as usize % blocks.len()];
        return [splat_u(simd, a), splat_u(simd, b), splat_u(simd, c), splat_u(simd, d)];
    }
    let place = (number & (side - 1)) + ((number >> BLOCK_ROW.ilog2()) << side.ilog2());
    simd.quadruples(always!(|lane: usize| blocks[place[lane] as usize % blocks.len()]))
}

/// Whether the rays may be in a solid somewhere in the cell, by the column's word.
#[inline(always)]
fn may_hit<S: Simd>(simd: S, word: U<S>, lower: F<S>, upper: F<S>, quad_top: F<S>) -> M<S> {
    let bit = always!(|flag: u8| has(simd, word, u32::from(flag) << FLAGS_SHIFT));
    let (high, low) = (float_u::<S>(word & HEIGHT_MASK), float_u::<S>((word >> HEIGHT_BITS) & HEIGHT_MASK));
    let with_gap = lower.simd_le(low) | upper.simd_ge(high);
    let top = bit(flag::INCLINED).select(quad_top, high);
    let without = lower.simd_le(top) & upper.simd_ge(low);
    bit(flag::OCCUPIED) & bit(flag::GAP).select(with_gap, without)
}
