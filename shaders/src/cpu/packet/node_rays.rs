//! How the rays of a packet enter a node. The scalar code is [`enter_node`](crate::cpu::node::enter_node).

use super::{
    hits::Segments,
    lanes::{F, IVec2s, M, Vec2s, Vec3s, nonzero, splat, splat_i},
};
use crate::{
    cpu::node::planes_of,
    layout::{DrawNode, SUMMARY_WORDS},
};
use fearless_simd::prelude::*;
use glam::Vec3;

/// The rays inside of a node, all of the same: x and y in cells, z in height codes; `t` stays in metres.
#[derive(Clone, Copy)]
pub(super) struct NodeRays<'a, S: Simd> {
    pub(super) simd: S,
    pub(super) node: &'a DrawNode,
    pub(super) index: u32,
    pub(super) planes: [u32; 4],
    pub(super) summary: u32,
    pub(super) o: Vec3s<S>,
    pub(super) d: Vec3s<S>,
    pub(super) inv: Vec2s<S>,
    /// 1 along the axes on which the ray's coordinate grows, else 0.
    pub(super) ahead: Vec2s<S>,
    /// The same as steps, 1 or -1.
    pub(super) step: IVec2s<S>,
    pub(super) rises: M<S>,
}

impl<'a, S: Simd> NodeRays<'a, S> {
    #[inline(always)]
    pub(super) fn new(simd: S, segments: &Segments<S>, node: &'a DrawNode, index: u32) -> Self {
        let scale = Vec3s::splat(simd, Vec3::new(1.0 / node.cell_m, 1.0 / node.cell_m, 1.0 / node.z_step_m));
        let o = segments.origin.sub(Vec3s::splat(simd, node.corner.into())).mul(scale);
        let d = segments.dir.mul(scale).map(
            #[inline(always)]
            |v| nonzero(simd, v),
        );
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let (ahead_x, ahead_y) = (d.x.simd_gt(zero), d.y.simd_gt(zero));
        let (forward, back) = (splat_i(simd, 1), splat_i(simd, -1));
        Self {
            simd,
            node,
            index,
            planes: planes_of(node).map(|first| first as u32),
            summary: (node.slot() * SUMMARY_WORDS) as u32,
            o,
            d,
            inv: Vec2s::<S> { x: one / d.x, y: one / d.y },
            ahead: Vec2s::<S> { x: ahead_x.select(one, zero), y: ahead_y.select(one, zero) },
            step: IVec2s::<S> { x: ahead_x.select(forward, back), y: ahead_y.select(forward, back) },
            rises: d.z.simd_gt(zero),
        }
    }

    /// Heights of the rays, in codes.
    #[inline(always)]
    pub(super) fn z_at(&self, t: F<S>) -> F<S> {
        self.o.z + self.d.z * t
    }
}
