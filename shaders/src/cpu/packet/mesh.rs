//! Hits of the rays of a packet on a leaf that is drawn as a mesh. The scalar code is [`mesh`](crate::cpu::mesh).
//!
//! The packet visits a box if any of its rays meets it, the half first that the first of them enters first.

use super::hits::{Hits, MeshHits, Segments, read_vec4};
use super::lanes::{F, FastExtremes, M, Vec3s, always, lanes_of, nonzero, once, splat, splat_u};
use super::mesh_surface::{MeshFacts, hit_triangles};
use super::objects::ObjectWords;
use super::pages::planes_at;
use crate::cpu::landmark::triangle_stride;
use crate::cpu::mesh::{
    MeshHit, MeshRays, TIE_M, TIE_SHARE, TriangleHits, hit_triangle, unpack_corners, walk_mesh, wins_tie,
};
use crate::cpu::ray::SceneRef;
use crate::layout::{DrawNode, Shading};
use crate::mesh::{REFERENCE_COUNT_SHIFT, REFERENCE_MASK, TRAVERSAL_STACK};
use fearless_simd::prelude::*;
use glam::Vec3;

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
    let o = (segments.origin - Vec3s::splat(simd, zero)) / step_m;
    let d = (segments.dir / step_m).map(always!(|v: F<S>| nonzero(simd, v)));
    let facts = (triangle_stride(info), whole[3]);
    // The box's interval does not depend on the axis.
    let [enter_m, exit_m] = MeshRays::new(simd, (o, d), 0, facts).box_span(whole);
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
            let rays = MeshRays::new(simd, (o, d), axis, facts);
            let root = (info[0], lanes);
            match axis {
                2 => nearest_triangles::<S, 2>(scene, segments, &rays, root, &mut nearest),
                1 => nearest_triangles::<S, 1>(scene, segments, &rays, root, &mut nearest),
                _ => nearest_triangles::<S, 0>(scene, segments, &rays, root, &mut nearest),
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
    let is_common = triangle_stride(info) <= 2 && scene.frame.shading < Shading::Wire as u32;
    let planes = if is_common { planes_at(scene.atlas, node) } else { None };
    let Some(planes) = planes else {
        return hit_singly(scene, segments, (index, step_m, info), found, (&nearest, &objects), hits);
    };
    if found.any_true() {
        let facts = MeshFacts { node, index, planes, step_m, info };
        simd.vectorize(once!(|| hit_triangles(simd, scene, segments, &facts, found, (&nearest, &objects), hits)));
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

/// Sets `nearest` for the rays in `lanes`.
#[inline(always)]
fn nearest_triangles<S: Simd, const AXIS: usize>(
    scene: &SceneRef<'_>,
    segments: &Segments<S>,
    rays: &MeshRays<S>,
    (root, mut lanes): (u32, M<S>),
    nearest: &mut MeshHits<S>,
) {
    let simd = rays.simd;
    let nothing = SharedHalf::<S> { reference: 0, lanes, t: splat(simd, 0.0) };
    let mut stack = [nothing; TRAVERSAL_STACK];
    let (mut height, mut reference) = (0, root);
    // Rays towards the sun that have hit something.
    let mut ended = M::<S>::splat(simd, false);
    loop {
        let (count, at) = (reference >> REFERENCE_COUNT_SHIFT, reference & REFERENCE_MASK);
        if count > 0 {
            for k in 0..count {
                test_triangle::<S, AXIS>(scene, segments, rays, (at + rays.stride * k, lanes), nearest);
            }
            if segments.to_sun {
                ended |= lanes & nearest.triangle.simd_ne(splat_u(simd, 0));
            }
        } else {
            let (a, b) = (read_vec4(scene, at), read_vec4(scene, at + 1));
            let [enter_a, exit_a] = rays.box_span(a);
            let [enter_b, exit_b] = rays.box_span(b);
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

/// Sets `nearest` to a triangle, for the rays in `lanes` that meet it before.
#[inline(always)]
fn test_triangle<S: Simd, const AXIS: usize>(
    scene: &SceneRef<'_>,
    segments: &Segments<S>,
    rays: &MeshRays<S>,
    (at, lanes): (u32, M<S>),
    nearest: &mut MeshHits<S>,
) {
    let simd = rays.simd;
    let corners = unpack_corners(read_vec4(scene, at), read_vec4(scene, at + 1)[0]);
    let Some(met) = rays.meet_triangle::<AXIS>(corners, lanes) else { return };
    let TriangleHits { lanes, t, u, v, is_front } = met;
    let tie = t * TIE_SHARE + TIE_M;
    let valid = lanes & t.simd_ge(splat(simd, 0.0)) & t.simd_lt(nearest.t + tie);
    let mut taken = valid & t.simd_lt(nearest.t - tie);
    for lane in lanes_of::<S>(valid & !taken) {
        let mut ray = segments.lane(scene, lane);
        let before = nearest.lane(lane);
        let found = MeshHit { t: t[lane], triangle: at, is_front: is_front.test(lane), ..before };
        taken.set(lane, wins_tie(&mut ray, &found, &before));
    }
    nearest.t = taken.select(t, nearest.t);
    nearest.triangle = taken.select(splat_u(simd, at), nearest.triangle);
    nearest.u = taken.select(u, nearest.u);
    nearest.v = taken.select(v, nearest.v);
    nearest.is_front = taken.select(is_front, nearest.is_front);
}
