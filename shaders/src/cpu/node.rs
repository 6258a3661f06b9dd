//! How a ray enters a node. GPU twin: `node.wgsl`.

use super::fast_math::{fast_max, fast_min, nonzero, nonzero2};
use super::ray::{NodeRay, Ray, SceneRef};
use super::words::halves;
use crate::layout::{DrawNode, PAGE_WORDS, QUARTER_MAX, SUMMARY_WORDS, WALK_PLANE};
use crate::mesh::LEAF_OFFSET_STEPS;
use glam::{IVec2, Vec2, Vec3, Vec3Swizzles};
use insula_protocol::NODE_CELLS;

/// Sets `ray.node`, and returns the interval of the ray between the node's lowest and highest point. Empty if the first
/// value is larger.
#[inline]
pub(super) fn enter_node(ray: &mut Ray<'_>, index: u32, t_in: f32, t_out: f32) -> [f32; 2] {
    let Some(node) = ray.scene.nodes.get(index as usize) else { return [1.0, 0.0] };
    let scale = Vec3::new(1.0 / node.cell_m, 1.0 / node.cell_m, 1.0 / node.z_step_m);
    let o = (ray.segment.origin - Vec3::from(node.corner)) * scale;
    let d_xy = nonzero2(ray.segment.dir.xy() * scale.xy());
    let dz = nonzero(ray.segment.dir.z * scale.z);
    let a = (node.z_lo - 1.0 - o.z) / dz;
    let b = (node.z_hi + 1.0 - o.z) / dz;
    ray.node = NodeRay {
        index,
        o,
        d: d_xy.extend(dz),
        inv: 1.0 / d_xy,
        planes: planes_of(node),
        z_shift: node.z_shift(),
        summary: node.slot() * SUMMARY_WORDS,
        cell_m: node.cell_m,
        level: node.level,
    };
    let (begin, end) = (fast_max(t_in, fast_min(a, b)), fast_min(t_out, fast_max(a, b)));
    let highest = highest_on(node, o.xy() + d_xy * begin, o.xy() + d_xy * end);
    if fast_min(ray.node.z_at(begin), ray.node.z_at(end)) > highest { [1.0, 0.0] } else { [begin, end] }
}

/// First words of a node's planes.
pub(super) fn planes_of(node: &DrawNode) -> [usize; 4] {
    let place = |plane| node.page(plane) as usize * PAGE_WORDS;
    [place(0), place(1), place(2), place(3)]
}

/// Highest point, with a margin of one code, of the quarters of a node that a ray crosses between two places in it.
#[inline]
fn highest_on(node: &DrawNode, a: Vec2, b: Vec2) -> f32 {
    let half = NODE_CELLS as f32 / 2.0;
    let quarter = |p: Vec2| usize::from(p.x >= half) + 2 * usize::from(p.y >= half);
    let (a, b) = (quarter(a), quarter(b));
    // From a quarter to the opposite one the ray crosses a third.
    let below = if a ^ b == 3 { 0 } else { node.quarter_below(a).min(node.quarter_below(b)) };
    node.z_hi + 1.0 - below as f32 * (node.z_hi - node.z_lo) * (1.0 / QUARTER_MAX as f32)
}

/// The word of the column at a place, which is relative to the node's corner; 0 outside of the atlas.
pub(super) fn column_word(scene: &SceneRef<'_>, node: &DrawNode, place: Vec3) -> u32 {
    let at = place.xy() / node.cell_m + halves(node.leaf_offset) / LEAF_OFFSET_STEPS;
    let cell = at.floor().as_ivec2().clamp(IVec2::ZERO, IVec2::splat(NODE_CELLS as i32 - 1));
    let i = cell.y as usize * NODE_CELLS + cell.x as usize;
    scene.atlas.get(planes_of(node)[WALK_PLANE] + i).copied().unwrap_or(0)
}
