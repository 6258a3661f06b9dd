//! Hits of the rays of a packet on a leaf that is drawn as a mesh. The scalar code is [`mesh`](crate::cpu::mesh).
//!
//! The packet visits a box if any of its rays meets it, the half first that the first of them enters first.

use super::hits::{Hits, MeshHits, Segments, read_vec4};
use super::lanes::{F, FastExtremes, M, Vec3s, always, lanes_of, nonzero, splat, splat_u};
use super::mesh_surface::{MeshFacts, hit_triangles};
use super::objects::ObjectWords;
use super::pages::planes_at;
use crate::cpu::landmark::triangle_stride;
use crate::cpu::mesh::{
    BOX_SLACK, EDGE_SLACK, MeshHit, TIE_M, TIE_SHARE, hit_triangle, unpack_corners, walk_mesh, wins_tie,
};
use crate::cpu::ray::SceneRef;
use crate::cpu::words::halves;
use crate::layout::{DrawNode, Shading};
use crate::mesh::{REFERENCE_COUNT_SHIFT, REFERENCE_MASK, TRAVERSAL_STACK};
use fearless_simd::prelude::*;
use glam::Vec3;

/// The rays in steps of the mesh's grid, all with the same longest axis.
struct MeshRays<S: Simd> {
    simd: S,
    o: Vec3s<S>,
    inv: Vec3s<S>,
    shear: [F<S>; 3],
    side: F<S>,
    stride: u32,
}

/// A half of the tree that is still to be visited by the rays that meet it, and where they enter it.
#[derive(Clone, Copy)]
struct SharedHalf<S: Simd> {
    reference: u32,
    lanes: M<S>,
    t: F<S>,
}

/// Gathers the first triangles that the rays in `group` hit in the mesh of a node, where they are nearer than what was hit before.
#[inline(always)]
pub(super) fn walk_meshes<S: Simd>(
    simd: S,
    scene: &SceneRef<'_>,
    segments: &Segments<S>,
    (node, index): (&DrawNode, u32),
    group: M<S>,
    hits: &mut Hits<S>,
) {
    let head = node.mesh - 1;
    let [x, y, z, step_m]: [f32; 4] = bytemuck::cast(read_vec4(scene, head));
    let info = read_vec4(scene, head + 1);
    let whole = read_vec4(scene, head + 2);
    let zero = Vec3::new(node.corner[0], node.corner[1], node.mesh_z_m) + Vec3::new(x, y, z);
    let o = segments.origin.sub(Vec3s::splat(simd, zero)).map(
        #[inline(always)]
        |v| v / step_m,
    );
    let d = segments.dir.map(
        #[inline(always)]
        |v| nonzero(simd, v / step_m),
    );
    let inv = d.map(
        #[inline(always)]
        |v| splat(simd, 1.0) / v,
    );
    let [enter_m, exit_m] = box_span(simd, o, inv, whole);
    let reach = splat(simd, segments.reach_m).fast_min(hits.distance_m);
    let meets = group & enter_m.simd_le(exit_m) & enter_m.simd_le(reach);
    if meets.all_false() {
        return;
    }
    let none = splat(simd, 0.0);
    let mut nearest = MeshHits {
        t: reach.fast_min(exit_m + 1.0),
        triangle: splat_u(simd, 0),
        u: none,
        v: none,
        is_front: M::<S>::splat(simd, true),
    };
    let (x, y, z) = (d.x.abs(), d.y.abs(), d.z.abs());
    let up = z.simd_ge(x.fast_max(y));
    let north = !up & y.simd_ge(x);
    for axis in 0..3 {
        let lanes = meets & [!up & !north, north, up][axis];
        if lanes.any_true() {
            let rays = MeshRays::new(simd, (o, d, inv), axis, triangle_stride(info));
            let root = (info[0], lanes);
            match axis {
                2 => rays.nearest_triangles::<2>(scene, segments, root, &mut nearest),
                1 => rays.nearest_triangles::<1>(scene, segments, root, &mut nearest),
                _ => rays.nearest_triangles::<0>(scene, segments, root, &mut nearest),
            }
        }
    }
    let found = meets & nearest.triangle.simd_ne(splat_u(simd, 0));
    let objects = ObjectWords::of_triangles(simd, scene, whole[3], found, nearest.triangle);
    let hidden = found & objects.hidden(simd);
    walk_singly(scene, segments, index, hidden, hits);
    let found = found & !hidden;
    if segments.to_sun {
        hits.is_hit |= found;
        return;
    }
    let planes = planes_at(scene.atlas, node).filter(
        #[inline(always)]
        |_| triangle_stride(info) <= 2 && scene.frame.shading < Shading::Wire as u32,
    );
    let Some(planes) = planes else {
        return hit_singly(scene, segments, (index, step_m, info), found, (&nearest, &objects), hits);
    };
    if found.any_true() {
        let facts = MeshFacts { node, index, planes, step_m, info };
        simd.vectorize(
            #[inline(always)]
            || hit_triangles(simd, scene, segments, &facts, found, (&nearest, &objects), hits),
        );
    }
}

/// Surfaces of landmarks, shadings that show triangles, and where the atlas ends within a node's pages: ray by ray.
#[inline(always)]
fn hit_singly<S: Simd>(
    scene: &SceneRef<'_>,
    segments: &Segments<S>,
    (index, step_m, info): (u32, f32, [u32; 4]),
    found: M<S>,
    (nearest, objects): (&MeshHits<S>, &ObjectWords<S>),
    hits: &mut Hits<S>,
) {
    for lane in lanes_of::<S>(found) {
        let mut ray = segments.lane(scene, lane);
        let hit = MeshHit { object: objects.address[lane], ..nearest.lane(lane) };
        hit_triangle(&mut ray, index, step_m, info, &hit);
        hits.set_lane(lane, &ray.hit);
    }
}

/// All of the walk ray by ray, for those that have met a hidden object.
#[inline(always)]
fn walk_singly<S: Simd>(scene: &SceneRef<'_>, segments: &Segments<S>, index: u32, group: M<S>, hits: &mut Hits<S>) {
    for lane in lanes_of::<S>(group) {
        let mut ray = segments.lane(scene, lane);
        ray.segment.reach_m = ray.segment.reach_m.min(hits.distance_m[lane]);
        walk_mesh(&mut ray, index);
        hits.set_lane(lane, &ray.hit);
    }
}

/// The intervals of the rays inside of a box, in metres. Empty if the first value is larger.
#[inline(always)]
fn box_span<S: Simd>(simd: S, o: Vec3s<S>, inv: Vec3s<S>, words: [u32; 4]) -> [F<S>; 2] {
    let span = always(
        #[inline(always)]
        |word: u32, o: F<S>, inv: F<S>| {
            let ends = halves(word);
            let (a, b) = ((splat(simd, ends.x - BOX_SLACK) - o) * inv, (splat(simd, ends.y + BOX_SLACK) - o) * inv);
            (a.fast_min(b), a.fast_max(b))
        },
    );
    let (x, y, z) = (span(words[0], o.x, inv.x), span(words[1], o.y, inv.y), span(words[2], o.z, inv.z));
    [x.0.fast_max(y.0).fast_max(z.0).fast_max(splat(simd, 0.0)), x.1.fast_min(y.1).fast_min(z.1)]
}

impl<S: Simd> MeshRays<S> {
    #[inline(always)]
    fn new(simd: S, (o, d, inv): (Vec3s<S>, Vec3s<S>, Vec3s<S>), axis: usize, stride: u32) -> Self {
        let one = splat(simd, 1.0);
        let (a, b, side, along) = match axis {
            2 => (d.x, d.y, one.copysign(d.z), inv.z),
            1 => (d.x, d.z, -one.copysign(d.y), inv.y),
            _ => (d.y, d.z, one.copysign(d.x), inv.x),
        };
        Self { simd, o, inv, shear: [a * along, side * b * along, along], side, stride }
    }

    #[inline(always)]
    fn shear<const AXIS: usize>(&self, p: Vec3) -> [F<S>; 3] {
        let p = Vec3s::splat(self.simd, p).sub(self.o);
        let (a, b, along) = match AXIS {
            2 => (p.x, p.y, p.z),
            1 => (p.x, p.z, p.y),
            _ => (p.y, p.z, p.x),
        };
        [a - self.shear[0] * along, self.side * b - self.shear[1] * along, along]
    }

    /// Sets `nearest` for the rays in `lanes`.
    #[inline(always)]
    fn nearest_triangles<const AXIS: usize>(
        &self,
        scene: &SceneRef<'_>,
        segments: &Segments<S>,
        (root, mut lanes): (u32, M<S>),
        nearest: &mut MeshHits<S>,
    ) {
        let simd = self.simd;
        let nothing = SharedHalf::<S> { reference: 0, lanes, t: splat(simd, 0.0) };
        let mut stack = [nothing; TRAVERSAL_STACK];
        let (mut height, mut reference) = (0, root);
        // Rays towards the sun that have hit something.
        let mut ended = M::<S>::splat(simd, false);
        loop {
            let (count, at) = (reference >> REFERENCE_COUNT_SHIFT, reference & REFERENCE_MASK);
            if count > 0 {
                for k in 0..count {
                    self.test_triangle::<AXIS>(scene, segments, at + self.stride * k, lanes, nearest);
                }
                if segments.to_sun {
                    ended |= lanes & nearest.triangle.simd_ne(splat_u(simd, 0));
                }
            } else {
                let (a, b) = (read_vec4(scene, at), read_vec4(scene, at + 1));
                let [enter_a, exit_a] = box_span(simd, self.o, self.inv, a);
                let [enter_b, exit_b] = box_span(simd, self.o, self.inv, b);
                let meets_a = lanes & enter_a.simd_le(exit_a) & enter_a.simd_le(nearest.t);
                let meets_b = lanes & enter_b.simd_le(exit_b) & enter_b.simd_le(nearest.t);
                let (any_a, any_b) = (meets_a.any_true(), meets_b.any_true());
                let both = meets_a & meets_b;
                let a_first = any_a && (!any_b || (both & enter_b.simd_lt(enter_a)).all_false());
                let half_a = SharedHalf { reference: a[3], lanes: meets_a, t: enter_a };
                let half_b = SharedHalf { reference: b[3], lanes: meets_b, t: enter_b };
                if any_a && any_b && height < TRAVERSAL_STACK {
                    stack[height] = if a_first { half_b } else { half_a };
                    height += 1;
                }
                if any_a || any_b {
                    let next = if a_first { half_a } else { half_b };
                    (reference, lanes) = (next.reference, next.lanes);
                    continue;
                }
            }
            loop {
                if height == 0 {
                    return;
                }
                height -= 1;
                let next: SharedHalf<S> = stack[height];
                lanes = next.lanes & next.t.simd_le(nearest.t) & !ended;
                reference = next.reference;
                if lanes.any_true() {
                    break;
                }
            }
        }
    }

    /// Watertight, as the scalar function, of a triangle for all rays in `lanes`.
    #[inline(always)]
    fn test_triangle<const AXIS: usize>(
        &self,
        scene: &SceneRef<'_>,
        segments: &Segments<S>,
        at: u32,
        lanes: M<S>,
        nearest: &mut MeshHits<S>,
    ) {
        let simd = self.simd;
        let zero = splat(simd, 0.0);
        let [pa, pb, pc] = unpack_corners(read_vec4(scene, at), read_vec4(scene, at + 1)[0]);
        let (a, b, c) = (self.shear::<AXIS>(pa), self.shear::<AXIS>(pb), self.shear::<AXIS>(pc));
        let products = [b[0] * c[1], c[0] * a[1], a[0] * b[1]];
        let others = [b[1] * c[0], c[1] * a[0], a[1] * b[0]];
        let sides = [products[0] - others[0], products[1] - others[1], products[2] - others[2]];
        let (low, high) =
            (sides[0].fast_min(sides[1]).fast_min(sides[2]), sides[0].fast_max(sides[1]).fast_max(sides[2]));
        let size = always(
            #[inline(always)]
            |p: [F<S>; 3]| p[0].abs().fast_max(p[1].abs()),
        );
        let largest = size(a).fast_max(size(b)).fast_max(size(c));
        let most = largest * largest * (2.0 * EDGE_SLACK);
        let lanes = lanes & !(low.simd_lt(-most) & high.simd_gt(most));
        if lanes.all_false() {
            return;
        }
        let (back, front) = (low.simd_ge(zero) & high.simd_gt(most), high.simd_le(zero) & low.simd_lt(-most));
        let near_edge = lanes & !back & !front;
        let (mut lanes, mut is_front) = (lanes, front);
        if near_edge.any_true() {
            let (is_back, faces) = beyond_slack(simd, products, others, sides);
            lanes &= !(near_edge & !(is_back ^ faces));
            is_front |= near_edge & faces;
        }
        let sign = is_front.select(splat(simd, -1.0), splat(simd, 1.0));
        let weights =
            [(sign * sides[0]).fast_max(zero), (sign * sides[1]).fast_max(zero), (sign * sides[2]).fast_max(zero)];
        let scale = splat(simd, 1.0) / (weights[0] + weights[1] + weights[2]);
        let (wa, wb, wc) = (weights[0] * scale, weights[1] * scale, weights[2] * scale);
        let t = (wa * a[2] + wb * b[2] + wc * c[2]) * self.shear[2];
        let tie = t * TIE_SHARE + TIE_M;
        let valid = lanes & t.simd_ge(zero) & t.simd_lt(nearest.t + tie);
        let mut taken = valid & t.simd_lt(nearest.t - tie);
        for lane in lanes_of::<S>(valid & !taken) {
            let mut ray = segments.lane(scene, lane);
            let before = nearest.lane(lane);
            let found = MeshHit { t: t[lane], triangle: at, is_front: is_front.test(lane), ..before };
            taken.set(lane, wins_tie(&mut ray, &found, &before));
        }
        nearest.t = taken.select(t, nearest.t);
        nearest.triangle = taken.select(splat_u(simd, at), nearest.triangle);
        nearest.u = taken.select(wb, nearest.u);
        nearest.v = taken.select(wc, nearest.v);
        nearest.is_front = taken.select(is_front, nearest.is_front);
    }
}

/// Whether rays within rounding of a triangle's edges see its back, and whether they see its front.
#[inline(always)]
fn beyond_slack<S: Simd>(simd: S, products: [F<S>; 3], others: [F<S>; 3], sides: [F<S>; 3]) -> (M<S>, M<S>) {
    let zero = splat(simd, 0.0);
    let (mut back, mut front) = (M::<S>::splat(simd, true), M::<S>::splat(simd, true));
    for i in 0..3 {
        let slack = (products[i].abs() + others[i].abs()) * EDGE_SLACK;
        back &= (sides[i] + slack).simd_ge(zero);
        front &= (sides[i] - slack).simd_le(zero);
    }
    (back, front)
}
