//! The walk of a packet over the grid's squares. The scalar code is [`walk_grid`](crate::cpu::walk::walk_grid).

use super::hits::{Hits, Segments};
use super::lanes::{
    F, FastExtremes, I, IVec2s, Lanes, M, U, Vec2s, always, first_lane, float, floor_clamped, has, map4, nonzero, once,
    splat, splat_i, splat_u, to_i, to_u,
};
use super::mesh::walk_meshes;
use super::node_walk::walk_node;
use crate::cpu::ray::{MAX_STEPS, SceneRef};
use crate::grid::Z_TOP;
use crate::layout::{
    FrameUniform, GRID_LEVEL_MASK, GRID_LEVEL_SHIFT, GRID_LEVELS, GRID_MIXED, GRID_NODE_BIT, GRID_NODE_MASK,
    GRID_SHARE_MASK, GRID_SHARE_SHIFT,
};
use fearless_simd::prelude::*;

/// As the scalar walk's, of each ray.
struct GridWalks<S: Simd> {
    simd: S,
    o: Vec2s<S>,
    d: Vec2s<S>,
    inv: Vec2s<S>,
    z: F<S>,
    dz: F<S>,
    ahead_x: M<S>,
    ahead_y: M<S>,
    t_end: F<S>,
    squares: i32,
    square: IVec2s<S>,
    level: I<S>,
    t: F<S>,
    /// Rays that have left the grid.
    done: M<S>,
}

/// The nodes that rays are about to enter.
struct NodeCrossings<S: Simd> {
    node: U<S>,
    t_in: F<S>,
    t_out: F<S>,
}

/// Gathers the surfaces that the segments in the lanes of `active` hit. The grid must have levels.
#[inline(always)]
pub(super) fn walk_grid<S: Simd>(
    simd: S,
    scene: &SceneRef<'_>,
    segments: &Segments<S>,
    active: M<S>,
    hits: &mut Hits<S>,
) {
    let (mut walk, inside) = GridWalks::begin_walk(simd, scene.frame, segments);
    let zero = splat(simd, 0.0);
    let mut crossings = NodeCrossings { node: splat_u(simd, 0), t_in: zero, t_out: zero };
    let mut seeking = active & inside;
    // Rays that are about to enter a node, and wait for those behind them.
    let mut pending = M::<S>::splat(simd, false);
    let mut steps = 0;
    loop {
        while seeking.any_true() && steps < MAX_STEPS {
            steps += 1;
            let found = walk.step(scene, segments, seeking, &mut crossings);
            pending |= found;
            seeking &= !found & !walk.done;
        }
        if pending.all_false() {
            return;
        }
        // The node that the hindmost ray enters, for all that enter it.
        let t = pending.select(crossings.t_in, splat(simd, f32::INFINITY));
        let hindmost = t.simd_le(splat(simd, t.reduce_min())) & pending;
        let index = crossings.node[first_lane::<S>(hindmost)];
        let group = pending & crossings.node.simd_eq(splat_u(simd, index));
        match scene.nodes.get(index as usize) {
            None => {}
            Some(node) if node.mesh != 0 => {
                simd.vectorize(once!(|| walk_meshes(simd, scene, segments, (node, index), group, hits)))
            }
            Some(node) => simd.vectorize(once!(|| walk_node(
                simd,
                scene,
                segments,
                (node, index),
                group,
                [crossings.t_in, crossings.t_out],
                hits
            ))),
        }
        pending &= !group;
        seeking = group & !walk.done & !hits.is_hit;
    }
}

impl<S: Simd> GridWalks<S> {
    /// And the rays that meet the grid.
    #[inline(always)]
    fn begin_walk(simd: S, frame: &FrameUniform, segments: &Segments<S>) -> (Self, M<S>) {
        let (origin, dir) = (segments.origin, segments.dir);
        let side = splat(simd, frame.side_m);
        let o = Vec2s::<S> { x: origin.x / side + frame.eye[0], y: origin.y / side + frame.eye[1] };
        let z = origin.z * frame.z_scale + frame.z_eye;
        let d = Vec2s::<S> { x: nonzero(simd, dir.x / side), y: nonzero(simd, dir.y / side) };
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let inv = Vec2s::<S> { x: one / d.x, y: one / d.y };
        let dz = nonzero(simd, dir.z * frame.z_scale);
        let (ahead_x, ahead_y) = (d.x.simd_gt(zero), d.y.simd_gt(zero));
        let squares = 1i32 << (frame.levels - 1);
        let [low_x, low_y] = [(-frame.eye_cell[0]) as f32, (-frame.eye_cell[1]) as f32];
        let span = always!(|low: f32, ahead: M<S>, o: F<S>, inv: F<S>| {
            let (first, last) = (splat(simd, low), splat(simd, low + squares as f32));
            [(ahead.select(first, last) - o) * inv, (ahead.select(last, first) - o) * inv]
        });
        let ([near_x, far_x], [near_y, far_y]) = (span(low_x, ahead_x, o.x, inv.x), span(low_y, ahead_y, o.y, inv.y));
        let (za, zb) = ((splat(simd, -1.0) - z) / dz, (splat(simd, Z_TOP + 1.0) - z) / dz);
        let t = near_x.fast_max(near_y).fast_max(za.fast_min(zb)).fast_max(zero);
        let t_end = far_x.fast_min(far_y).fast_min(za.fast_max(zb)).fast_min(splat(simd, segments.reach_m));
        let square_of = always!(|o: F<S>, d: F<S>, low: f32, eye_cell: i32| {
            let (first, last) = (splat(simd, low), splat(simd, low + (squares - 1) as f32));
            floor_clamped::<S>(o + d * t, first, last) + eye_cell
        });
        let square = IVec2s {
            x: square_of(o.x, d.x, low_x, frame.eye_cell[0]),
            y: square_of(o.y, d.y, low_y, frame.eye_cell[1]),
        };
        let level = level_at(simd, frame, segments.eye_m + t);
        let done = M::<S>::splat(simd, false);
        (Self { simd, o, d, inv, z, dz, ahead_x, ahead_y, t_end, squares, square, level, t, done }, t.simd_lt(t_end))
    }

    /// Moves the rays in `seeking` on by an entry of the grid. Returns those that are about to enter a node.
    #[inline(always)]
    fn step(
        &mut self,
        scene: &SceneRef<'_>,
        segments: &Segments<S>,
        seeking: M<S>,
        crossings: &mut NodeCrossings<S>,
    ) -> M<S> {
        let (simd, frame) = (self.simd, scene.frame);
        let (one, zeros) = (splat_i(simd, 1), splat_i(simd, 0));
        let ([entry, heights], level) = self.look_up(scene, seeking);
        let is_node = has(simd, entry, GRID_NODE_BIT);
        let k = is_node.select(to_i::<S>((entry >> GRID_LEVEL_SHIFT) & GRID_LEVEL_MASK), level);
        let side = one << k;
        let low_bits = side - one;
        let corner = IVec2s::<S> { x: self.square.x & !low_bits, y: self.square.y & !low_bits };
        let edge_x = corner.x + self.ahead_x.select(side, zeros);
        let edge_y = corner.y + self.ahead_y.select(side, zeros);
        let te_x = (float::<S>(edge_x - frame.eye_cell[0]) - self.o.x) * self.inv.x;
        let te_y = (float::<S>(edge_y - frame.eye_cell[1]) - self.o.y) * self.inv.y;
        let exit = te_x.fast_min(te_y).fast_min(self.t_end).fast_max(self.t);
        let (z_in, z_out) = (self.z + self.dz * self.t, self.z + self.dz * exit);
        let (top, bottom) = (float::<S>(to_i::<S>(heights >> 16)), float::<S>(to_i::<S>(heights & 0xffff)));
        let meets = z_in.fast_min(z_out).simd_le(top + 1.0) & (z_in.fast_max(z_out) + 1.0).simd_ge(bottom);
        let descends = meets & entry.simd_eq(splat_u(simd, GRID_MIXED)) & k.simd_gt(zeros);
        let found = seeking & meets & is_node & !descends;
        crossings.node = found.select(seen_node::<S>(simd, segments.threshold, entry), crossings.node);
        crossings.t_in = found.select(self.t, crossings.t_in);
        crossings.t_out = found.select(exit, crossings.t_out);
        let moves = seeking & !descends;
        self.level = (seeking & descends).select(k - one, self.level);
        if moves.all_false() {
            return found;
        }
        let next = self.next_square([edge_x, edge_y], te_x.simd_le(te_y), exit, (corner, low_bits), frame.eye_cell);
        let outside = next.x.min(next.y).simd_lt(zeros) | next.x.max(next.y).simd_ge(splat_i(simd, self.squares));
        // The largest square that holds the next place and not this one: larger ones were found to be mixed.
        let apart = high_bit::<S>(simd, (self.square.x ^ next.x) | (self.square.y ^ next.y));
        let next_level = level_at(simd, frame, segments.eye_m + exit);
        let next_level = apart.simd_lt(zeros).select(next_level, next_level.min(apart));
        self.level = moves.select(next_level, self.level);
        self.square.x = moves.select(next.x, self.square.x);
        self.square.y = moves.select(next.y, self.square.y);
        self.t = moves.select(exit, self.t);
        self.done |= moves & (exit.simd_ge(self.t_end) | outside);
        found
    }

    /// The square behind the edge that the rays reach first.
    #[inline(always)]
    fn next_square(
        &self,
        edge: [I<S>; 2],
        x_first: M<S>,
        exit: F<S>,
        (corner, low_bits): (IVec2s<S>, I<S>),
        eye_cell: [i32; 2],
    ) -> IVec2s<S> {
        let simd = self.simd;
        let (one, zeros) = (splat_i(simd, 1), splat_i(simd, 0));
        let place = always!(|o: F<S>, d: F<S>, corner: I<S>, eye_cell: i32| {
            let low = float::<S>(corner - eye_cell);
            floor_clamped::<S>(o + d * exit, low, low + float::<S>(low_bits)) + eye_cell
        });
        let beyond = always!(|edge: I<S>, ahead: M<S>| edge - ahead.select(zeros, one));
        IVec2s {
            x: x_first.select(beyond(edge[0], self.ahead_x), place(self.o.x, self.d.x, corner.x, eye_cell[0])),
            y: x_first.select(place(self.o.y, self.d.y, corner.y, eye_cell[1]), beyond(edge[1], self.ahead_y)),
        }
    }

    /// The entries for the rays' squares and levels, and the levels that they are of.
    #[inline(always)]
    fn look_up(&self, scene: &SceneRef<'_>, seeking: M<S>) -> ([U<S>; 2], I<S>) {
        let (simd, frame) = (self.simd, scene.frame);
        let last = frame.levels as i32 - 1;
        let mut k = self.level;
        let mut at = splat_u(simd, u32::MAX);
        let mut missing = seeking;
        loop {
            let (low_x, low_y, log2_side, base) = windows_at(simd, frame, k, missing);
            let (x, y) = ((self.square.x >> k) - low_x, (self.square.y >> k) - low_y);
            let is_inside = ((x | y) >> log2_side).simd_eq(splat_i(simd, 0));
            let found = missing & is_inside;
            at = found.select(to_u::<S>(base + (y << log2_side) + x), at);
            missing &= !is_inside;
            // No window holds the square of the ray.
            let coarsest = missing & k.simd_ge(splat_i(simd, GRID_LEVELS as i32 - 1));
            k = coarsest.select(splat_i(simd, last), k);
            missing &= !coarsest;
            if missing.all_false() {
                break;
            }
            k = missing.select(k + 1, k);
        }
        (grid_words(simd, scene, at, seeking), k)
    }
}

/// Entries of the grid at `at`; 0 outside of it.
#[inline(always)]
fn grid_words<S: Simd>(simd: S, scene: &SceneRef<'_>, at: U<S>, lanes: M<S>) -> [U<S>; 2] {
    let entry = |at: u32| scene.grid.get(at as usize).copied().unwrap_or_default();
    let first = at[first_lane::<S>(lanes)];
    if (lanes & at.simd_ne(splat_u(simd, first))).all_false() {
        let [node, heights] = entry(first);
        return [splat_u(simd, node), splat_u(simd, heights)];
    }
    let last = splat_u(simd, (scene.grid.len().min(1 << 31) as u32).saturating_sub(1));
    let inside = at.min(last);
    let (zeros, found) = (splat_u(simd, 0), at.simd_le(last));
    let [node, heights] = simd.pairs(always!(|lane: usize| entry(inside[lane])));
    [found.select(node, zeros), found.select(heights, zeros)]
}

/// Windows of the levels `k`: west and south end, log2 of the side, first entry.
#[inline(always)]
fn windows_at<S: Simd>(simd: S, frame: &FrameUniform, k: I<S>, lanes: M<S>) -> (I<S>, I<S>, I<S>, I<S>) {
    let common = k[first_lane::<S>(lanes)];
    let window = always!(|k: i32| frame.windows[(k as usize).min(GRID_LEVELS - 1)]);
    if (lanes & k.simd_ne(splat_i(simd, common))).all_false() {
        let [base, log2_side, low_x, low_y] = map4(window(common), always!(|v: i32| splat_i(simd, v)));
        return (low_x, low_y, log2_side, base);
    }
    let windows = simd.quadruples(always!(|lane: usize| bytemuck::cast(window(k[lane]))));
    let [base, log2_side, low_x, low_y] = map4(windows, to_i::<S>);
    (low_x, low_y, log2_side, base)
}

/// Number of the highest bit that is set; below 0 if none is.
#[inline(always)]
fn high_bit<S: Simd>(simd: S, v: I<S>) -> I<S> {
    // Numbers of squares have fewer bits than a mantissa, so that conversion does not round them up.
    let exponent = to_i::<S>(float::<S>(v).bitcast::<U<S>>() >> 23) - 127;
    v.simd_eq(splat_i(simd, 0)).select(splat_i(simd, -1), exponent)
}

/// The node that the rays see in a square.
#[inline(always)]
fn seen_node<S: Simd>(simd: S, threshold: U<S>, entry: U<S>) -> U<S> {
    let share = (entry >> GRID_SHARE_SHIFT) & GRID_SHARE_MASK;
    let (one, zeros) = (splat_u(simd, 1), splat_u(simd, 0));
    (entry & GRID_NODE_MASK) + (threshold >> 6).simd_lt(share).select(one, zeros)
}

/// The level whose nodes are good enough at distance `t`.
#[inline(always)]
fn level_at<S: Simd>(simd: S, frame: &FrameUniform, t: F<S>) -> I<S> {
    let bits: U<S> = (t * frame.level_scale).fast_max(splat(simd, 1.0)).bitcast();
    (to_i::<S>(bits >> 23) - 127).min(splat_i(simd, frame.levels as i32 - 1))
}
