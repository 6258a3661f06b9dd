//! How the rays of a packet enter a node. The scalar code is [`enter_node`](crate::cpu::node::enter_node).

use super::hits::Segments;
use super::lanes::{F, FastExtremes, I, M, Vec2s, Vec3s, always, nonzero, splat, splat_i};
use super::pages::planes_at;
use crate::cpu::node::planes_of;
use crate::cpu::ray::{NodeRay, SceneRef};
use crate::layout::{DrawNode, NODE_BLOCKS, PAGE_WORDS, PLANES, SUMMARY_WORDS};
use fearless_simd::prelude::*;
use glam::{Vec2, Vec3};
use insula_protocol::NODE_CELLS;

/// Blocks of a node, with four words for each.
const BLOCKS: usize = NODE_BLOCKS * NODE_BLOCKS;

/// The words of a node.
#[derive(Clone, Copy)]
pub(super) struct NodeWords<'a> {
    pub(super) planes: [&'a [u32; PAGE_WORDS]; PLANES],
    pub(super) blocks: &'a [[u32; 4]; BLOCKS],
}

/// The rays inside of a node, all of the same: x and y in cells, z in height codes; `t` stays in metres.
#[derive(Clone, Copy)]
pub(super) struct NodeRays<'a, S: Simd> {
    pub(super) simd: S,
    pub(super) node: &'a DrawNode,
    pub(super) index: u32,
    pub(super) words: NodeWords<'a>,
    pub(super) o: Vec3s<S>,
    pub(super) d: Vec3s<S>,
    pub(super) inv: Vec2s<S>,
    /// 1 along the axes on which the ray's coordinate grows, else 0.
    pub(super) ahead: Vec2s<S>,
    /// The same as steps, 1 or -1.
    pub(super) step: Vec2s<S>,
    /// What a step along x adds to the number of a block or a cell, and one along y to that of a cell.
    pub(super) next_x: I<S>,
    pub(super) next_row: I<S>,
}

impl<'a> NodeWords<'a> {
    /// `None` if the arrays of the scene end within the node's words.
    #[inline(always)]
    pub(super) fn of(scene: &SceneRef<'a>, node: &DrawNode) -> Option<Self> {
        let planes = planes_at(scene.atlas, node)?;
        let blocks: &[u32; SUMMARY_WORDS] = scene.summaries.get(node.slot() * SUMMARY_WORDS..)?.first_chunk()?;
        Some(Self { planes, blocks: bytemuck::cast_ref(blocks) })
    }
}

impl<'a, S: Simd> NodeRays<'a, S> {
    #[inline(always)]
    pub(super) fn new(
        simd: S,
        segments: &Segments<S>,
        (node, index): (&'a DrawNode, u32),
        words: NodeWords<'a>,
    ) -> Self {
        let scale = Vec3s::splat(simd, Vec3::new(1.0 / node.cell_m, 1.0 / node.cell_m, 1.0 / node.z_step_m));
        let o = (segments.origin - Vec3s::splat(simd, node.corner.into())) * scale;
        let d = (segments.dir * scale).map(always!(|v: F<S>| nonzero(simd, v)));
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let (ahead_x, ahead_y) = (d.x.simd_gt(zero), d.y.simd_gt(zero));
        let row = NODE_CELLS as i32;
        Self {
            simd,
            node,
            index,
            words,
            o,
            d,
            inv: Vec2s::<S> { x: one / d.x, y: one / d.y },
            ahead: Vec2s::<S> { x: ahead_x.select(one, zero), y: ahead_y.select(one, zero) },
            step: Vec2s::<S> { x: ahead_x.select(one, -one), y: ahead_y.select(one, -one) },
            next_x: ahead_x.select(splat_i(simd, 1), splat_i(simd, -1)),
            next_row: ahead_y.select(splat_i(simd, row), splat_i(simd, -row)),
        }
    }

    /// Heights of the rays, in codes.
    #[inline(always)]
    pub(super) fn z_at(&self, t: F<S>) -> F<S> {
        self.o.z + self.d.z * t
    }

    /// Whether the rays reach the edge across x before that across y; and where they reach the first one.
    #[inline(always)]
    pub(super) fn exit_at(&self, edge: Vec2s<S>) -> (M<S>, F<S>) {
        let (x, y) = ((edge.x - self.o.x) * self.inv.x, (edge.y - self.o.y) * self.inv.y);
        (x.simd_le(y), x.fast_min(y))
    }

    /// The ray of a lane in the node, for the scalar code.
    #[inline(always)]
    pub(super) fn lane(&self, lane: usize) -> NodeRay {
        NodeRay {
            index: self.index,
            o: self.o.lane(lane),
            d: self.d.lane(lane),
            inv: Vec2::new(self.inv.x[lane], self.inv.y[lane]),
            planes: planes_of(self.node),
            z_shift: self.node.z_shift(),
            summary: 0,
            cell_m: self.node.cell_m,
            level: self.node.level,
        }
    }
}
