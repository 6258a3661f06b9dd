//! The walk of a packet over the blocks and cells of a node. The scalar code is `walk_node` of [`walk`](crate::cpu::walk).

use super::{
    column::{ColumnCrossing, hit_columns},
    hits::{Hits, Segments},
    lanes::{
        F, I, IVec2s, M, MAX_LANES, U, always, first_lane, float, float_u, floor_clamped, gather_where, has, splat,
        splat_i, splat_u, to_u,
    },
    node_rays::NodeRays,
};
use crate::{
    cpu::ray::SceneRef,
    layout::{
        BLOCK_CELLS, BLOCK_SHIFT, DrawNode, NODE_BLOCKS, QUAD_TOP_BITS, QUAD_TOP_MAX, QUARTER_MAX, SUMMARY_BYTE_SHIFT,
        WALK_PLANE,
    },
    pack::{FLAGS_SHIFT, HEIGHT_BITS, HEIGHT_MASK},
};
use fearless_simd::prelude::*;
use insula_protocol::{NODE_CELLS, blockmap::flag};

/// The next block of each ray.
struct BlockSteps<S: Simd> {
    t_end: F<S>,
    block: IVec2s<S>,
    t: F<S>,
    done: M<S>,
}

/// The block that each ray is in, and its next cell.
struct CellSteps<S: Simd> {
    /// Rays that are in a block.
    active: M<S>,
    t_end: F<S>,
    block: IVec2s<S>,
    cell: IVec2s<S>,
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
    let rays = NodeRays::new(simd, segments, node, index);
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
            rays.step_blocks(scene, wanting, &mut blocks, &mut cells);
        }
        if lanes.all_false() {
            return;
        }
        let mut seeking = cells.active & lanes;
        let zero = splat(simd, 0.0);
        let none = splat_i(simd, 0);
        let mut found = ColumnCrossing {
            lanes: M::<S>::splat(simd, false),
            cell: IVec2s::<S> { x: none, y: none },
            ta: zero,
            te: zero,
            word: splat_u(simd, 0),
        };
        while seeking.any_true() {
            seeking = rays.step_cells(scene, seeking, &mut cells, &mut found);
        }
        if found.lanes.any_true() {
            simd.vectorize(
                #[inline(always)]
                || hit_columns(scene, segments, &rays, &found, hits),
            );
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
        let (begin, end) = (t_in.max(a.min(b)), t_out.min(a.max(b)));
        let above = self.z_at(begin).min(self.z_at(end)).simd_gt(self.highest(begin, end));
        let lanes = group & begin.simd_le(end) & !above;
        if lanes.all_false() {
            return None;
        }
        let (zero, last) = (splat(simd, 0.0), splat(simd, (NODE_BLOCKS - 1) as f32));
        let first = always(
            #[inline(always)]
            |o: F<S>, d: F<S>| floor_clamped::<S>((o + d * begin) * (1.0 / BLOCK_CELLS as f32), zero, last),
        );
        let block = IVec2s::<S> { x: first(self.o.x, self.d.x), y: first(self.o.y, self.d.y) };
        Some((BlockSteps { t_end: end, block, t: begin, done: M::<S>::splat(simd, false) }, lanes))
    }

    /// Highest point, with a margin of one code, of the quarters that the rays cross between two places.
    #[inline(always)]
    fn highest(&self, begin: F<S>, end: F<S>) -> F<S> {
        let (simd, node) = (self.simd, self.node);
        let half = splat(simd, NODE_CELLS as f32 / 2.0);
        let quarter = always(
            #[inline(always)]
            |t: F<S>| [(self.o.x + self.d.x * t).simd_ge(half), (self.o.y + self.d.y * t).simd_ge(half)],
        );
        let ([ax, ay], [bx, by]) = (quarter(begin), quarter(end));
        let quarter_below = always(
            #[inline(always)]
            |i: usize| splat(simd, node.quarter_below(i) as f32),
        );
        let below = [quarter_below(0), quarter_below(1), quarter_below(2), quarter_below(3)];
        let below_of = always(
            #[inline(always)]
            |x: M<S>, y: M<S>| y.select(x.select(below[3], below[2]), x.select(below[1], below[0])),
        );
        // From a quarter to the opposite one the ray crosses a third.
        let opposite = (ax ^ bx) & (ay ^ by);
        let below = opposite.select(splat(simd, 0.0), below_of(ax, ay).min(below_of(bx, by)));
        splat(simd, node.z_hi + 1.0) - below * (node.z_hi - node.z_lo) * (1.0 / QUARTER_MAX as f32)
    }

    /// Moves the rays in `wanting` on by a block. Those that it may stop are in its first cell then.
    #[inline(always)]
    fn step_blocks(&self, scene: &SceneRef<'_>, wanting: M<S>, blocks: &mut BlockSteps<S>, cells: &mut CellSteps<S>) {
        let simd = self.simd;
        let block = blocks.block;
        let edge = always(
            #[inline(always)]
            |block: I<S>, ahead: F<S>, o: F<S>| (float::<S>(block) + ahead) * BLOCK_CELLS as f32 - o,
        );
        let te_x = edge(block.x, self.ahead.x, self.o.x) * self.inv.x;
        let te_y = edge(block.y, self.ahead.y, self.o.y) * self.inv.y;
        let exit = te_x.min(te_y);
        let (t, t_end) = (blocks.t, exit.min(blocks.t_end).max(blocks.t));
        let number = to_u::<S>(block.y * NODE_BLOCKS as i32 + block.x);
        let rows = block_rows(simd, scene, number * 4 + self.summary, wanting);
        let [a, b, c, d] = rows;
        let byte = always(
            #[inline(always)]
            |word: U<S>| word >> SUMMARY_BYTE_SHIFT,
        );
        let (a, b, c, d) = (byte(a), byte(b), byte(c), byte(d));
        let (lowest, highest) = (float_u::<S>(a | (b << 8)), float_u::<S>(c | (d << 8)));
        let (lower_t, upper_t) = (self.rises.select(t, t_end), self.rises.select(t_end, t));
        let meets = wanting & self.z_at(lower_t).simd_le(highest + 1.0) & self.z_at(upper_t).simd_ge(lowest - 1.0);
        let next = self.neighbour(block, te_x.simd_le(te_y));
        let outside = ((next.x | next.y) & !(NODE_BLOCKS as i32 - 1)).simd_ne(splat_i(simd, 0));
        blocks.block.x = wanting.select(next.x, block.x);
        blocks.block.y = wanting.select(next.y, block.y);
        blocks.done |= wanting & (exit.simd_ge(blocks.t_end) | outside);
        blocks.t = wanting.select(t_end, t);
        let corner = IVec2s::<S> { x: block.x * BLOCK_CELLS as i32, y: block.y * BLOCK_CELLS as i32 };
        let cell = always(
            #[inline(always)]
            |o: F<S>, d: F<S>, corner: I<S>| {
                let low = float::<S>(corner);
                floor_clamped::<S>(o + d * t, low, low + (BLOCK_CELLS - 1) as f32)
            },
        );
        cells.active |= meets;
        cells.block.x = meets.select(block.x, cells.block.x);
        cells.block.y = meets.select(block.y, cells.block.y);
        cells.cell.x = meets.select(cell(self.o.x, self.d.x, corner.x), cells.cell.x);
        cells.cell.y = meets.select(cell(self.o.y, self.d.y, corner.y), cells.cell.y);
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
    fn step_cells(
        &self,
        scene: &SceneRef<'_>,
        seeking: M<S>,
        cells: &mut CellSteps<S>,
        found: &mut ColumnCrossing<S>,
    ) -> M<S> {
        let simd = self.simd;
        let (cell, t_in) = (cells.cell, cells.t);
        let te_x = (float::<S>(cell.x) + self.ahead.x - self.o.x) * self.inv.x;
        let te_y = (float::<S>(cell.y) + self.ahead.y - self.o.y) * self.inv.y;
        let exit = te_x.min(te_y);
        let t_out = exit.min(cells.t_end).max(t_in);
        let next = self.neighbour(cell, te_x.simd_le(te_y));
        let leaves = ((next.x >> BLOCK_SHIFT).simd_ne(cells.block.x)) | (next.y >> BLOCK_SHIFT).simd_ne(cells.block.y);
        let ends = seeking & (exit.simd_ge(cells.t_end) | leaves);
        cells.cell.x = seeking.select(next.x, cell.x);
        cells.cell.y = seeking.select(next.y, cell.y);
        cells.t = seeking.select(t_out, t_in);
        cells.active &= !ends;
        let quad_top = cells.quad_top(simd, cell);
        let (z_in, z_out) = (self.z_at(t_in), self.z_at(t_out));
        let (lower, upper) = (self.rises.select(z_in, z_out), self.rises.select(z_out, z_in));
        let below_quad = seeking & lower.simd_le(quad_top);
        let mut stops = M::<S>::splat(simd, false);
        if below_quad.any_true() {
            let number = to_u::<S>(cell.y * NODE_CELLS as i32 + cell.x);
            let word = gather_where(simd, scene.atlas, number + self.planes[WALK_PLANE], below_quad);
            stops = may_hit(simd, word, lower, upper, quad_top) & below_quad;
            found.lanes |= stops;
            found.cell.x = stops.select(cell.x, found.cell.x);
            found.cell.y = stops.select(cell.y, found.cell.y);
            found.ta = stops.select(t_in, found.ta);
            found.te = stops.select(t_out, found.te);
            found.word = stops.select(word, found.word);
        }
        seeking & !stops & !ends
    }

    /// The block or cell behind the edge that the rays reach first.
    #[inline(always)]
    fn neighbour(&self, at: IVec2s<S>, x_first: M<S>) -> IVec2s<S> {
        IVec2s::<S> { x: x_first.select(at.x + self.step.x, at.x), y: x_first.select(at.y, at.y + self.step.y) }
    }
}

impl<S: Simd> CellSteps<S> {
    #[inline(always)]
    fn nowhere(simd: S) -> Self {
        let (zero, none) = (splat(simd, 0.0), splat_i(simd, 0));
        let nowhere = IVec2s::<S> { x: none, y: none };
        let active = M::<S>::splat(simd, false);
        let rows = [splat_u(simd, 0); 4];
        Self { active, t_end: zero, block: nowhere, cell: nowhere, t: zero, lowest: zero, unit: zero, rows }
    }

    /// Highest points of the cells' quads.
    #[inline(always)]
    fn quad_top(&self, simd: S, cell: IVec2s<S>) -> F<S> {
        let (odd, upper) = (has(simd, to_u::<S>(cell.y), 2), has(simd, to_u::<S>(cell.y), 4));
        let [a, b, c, d] = self.rows;
        let row = upper.select(odd.select(d, c), odd.select(b, a));
        let place = ((to_u::<S>(cell.x) >> 1) & 3) * QUAD_TOP_BITS;
        self.lowest + float_u::<S>((row >> place) & QUAD_TOP_MAX) * self.unit
    }
}

/// The four words of blocks, whose first words are at `at`.
#[inline(always)]
fn block_rows<S: Simd>(simd: S, scene: &SceneRef<'_>, at: U<S>, lanes: M<S>) -> [U<S>; 4] {
    const EVERYTHING: [u32; 4] = [0xff << SUMMARY_BYTE_SHIFT, 0xff << SUMMARY_BYTE_SHIFT, 0, 0];
    let read = always(
        #[inline(always)]
        |at: u32| {
            scene
                .summaries
                .get(at as usize..)
                .and_then(
                    #[inline(always)]
                    |words| words.first_chunk(),
                )
                .copied()
                .unwrap_or(EVERYTHING)
        },
    );
    let first = at[first_lane::<S>(lanes)];
    if (lanes & at.simd_ne(splat_u(simd, first))).all_false() {
        let [a, b, c, d] = read(first);
        return [splat_u(simd, a), splat_u(simd, b), splat_u(simd, c), splat_u(simd, d)];
    }
    let mut blocks = [[0; 4]; MAX_LANES];
    for (lane, block) in blocks.iter_mut().enumerate().take(F::<S>::LEN) {
        *block = read(at[lane]);
    }
    let row = always(
        #[inline(always)]
        |i: usize| {
            U::<S>::from_fn(
                simd,
                #[inline(always)]
                |lane| blocks[lane][i],
            )
        },
    );
    [row(0), row(1), row(2), row(3)]
}

/// Whether the rays may be in a solid somewhere in the cell, by the column's word.
#[inline(always)]
fn may_hit<S: Simd>(simd: S, word: U<S>, lower: F<S>, upper: F<S>, quad_top: F<S>) -> M<S> {
    let bit = always(
        #[inline(always)]
        |flag: u8| has(simd, word, u32::from(flag) << FLAGS_SHIFT),
    );
    let (high, low) = (float_u::<S>(word & HEIGHT_MASK), float_u::<S>((word >> HEIGHT_BITS) & HEIGHT_MASK));
    let with_gap = lower.simd_le(low) | upper.simd_ge(high);
    let top = bit(flag::INCLINED).select(quad_top, high);
    let without = lower.simd_le(top) & upper.simd_ge(low);
    bit(flag::OCCUPIED) & bit(flag::GAP).select(with_gap, without)
}
