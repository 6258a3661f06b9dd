//! Hits of a ray on a leaf that is drawn as a mesh. GPU twin: `mesh.wgsl`.
//!
//! A ray visits boxes in boxes, the nearer half first, and tests the triangles of those that it meets.

use super::{
    fast_math::nonzero,
    mesh_surface::{sample_texture, surface_light},
    ray::Ray,
    shade::linear_of,
    words::halves,
};
use crate::{
    layout::MESH_FLAG,
    mesh::{REFERENCE_COUNT_SHIFT, REFERENCE_MASK, TRAVERSAL_STACK},
};
use glam::Vec3;
use insula_protocol::blockmap::flag;

/// Slack of barycentric coordinates, so that no ray slips between two triangles.
pub(crate) const EDGE_SLACK: f32 = 2e-5;
/// Slack of boxes, in steps of the grid.
pub(crate) const BOX_SLACK: f32 = 0.5;
/// Of triangles that are nearer to each other than this many metres, the first one in the atlas is seen, so that
/// triangles in one plane do not flicker.
pub(crate) const TIE_M: f32 = 1e-4;
/// How far above a mesh its ray towards the sun begins, in metres.
pub(crate) const MESH_LIFT_M: f32 = 0.02;
/// The part of that height that grows with the distance, per metre.
pub(crate) const MESH_LIFT_SHARE: f32 = 1e-4;
/// Least cosine between ray and normal that a texture's level is chosen for.
pub(crate) const MIN_COSINE: f32 = 0.15;

/// The ray in steps of the mesh's grid, from where it enters the mesh's box; `t` stays in metres.
struct MeshRay {
    o: Vec3,
    d: Vec3,
    inv: Vec3,
    /// From the segment's origin to the box, in metres.
    enter_m: f32,
}

/// The nearest triangle so far.
struct MeshHit {
    t: f32,
    /// Its address in the atlas, in vec4s; 0 if there is none.
    triangle: u32,
    u: f32,
    v: f32,
}

/// A half of the tree that is still to be visited, and where the ray enters it.
#[derive(Clone, Copy, Default)]
struct PendingHalf {
    reference: u32,
    t: f32,
}

/// Gathers the first triangle that the ray's segment hits in the mesh of node `index`.
pub(super) fn walk_mesh(ray: &mut Ray<'_>, index: u32) {
    let Some(node) = ray.scene.nodes.get(index as usize) else { return };
    ray.counts.nodes += 1;
    let head = node.mesh - 1;
    let [x, y, z, step_m] = ray.read_vec4(head).map(f32::from_bits);
    let info = ray.read_vec4(head + 1);
    let whole = ray.read_vec4(head + 2);
    let zero = Vec3::new(node.corner[0], node.corner[1], node.mesh_z_m) + Vec3::new(x, y, z);
    let o = (ray.segment.origin - zero) / step_m;
    let d = (ray.segment.dir / step_m).map(nonzero);
    let mut mesh_ray = MeshRay { o, d, inv: 1.0 / d, enter_m: 0.0 };
    let [enter_m, exit_m] = box_span(&mesh_ray, whole);
    if enter_m > exit_m || enter_m > ray.segment.reach_m {
        return;
    }
    // Numbers are smallest where the box begins, so rounding errors are too.
    mesh_ray.o += d * enter_m;
    mesh_ray.enter_m = enter_m;
    let reach_m = ray.segment.reach_m.min(exit_m + 1.0) - enter_m;
    let mut mesh_hit = MeshHit { t: reach_m, triangle: 0, u: 0.0, v: 0.0 };
    nearest_triangle(ray, &mesh_ray, info[0], &mut mesh_hit);
    if mesh_hit.triangle == 0 {
        return;
    }
    if ray.segment.to_sun {
        ray.hit.transmittance = 0.0;
        return;
    }
    let t = mesh_ray.enter_m + mesh_hit.t;
    hit_triangle(ray, index, step_m, info, &MeshHit { t, ..mesh_hit });
}

/// The interval of the ray inside a box, in metres. Empty if the first value is larger.
fn box_span(mesh_ray: &MeshRay, words: [u32; 4]) -> [f32; 2] {
    let (x, y, z) = (halves(words[0]), halves(words[1]), halves(words[2]));
    let low = (Vec3::new(x.x, y.x, z.x) - BOX_SLACK - mesh_ray.o) * mesh_ray.inv;
    let high = (Vec3::new(x.y, y.y, z.y) + BOX_SLACK - mesh_ray.o) * mesh_ray.inv;
    [low.min(high).max_element().max(0.0), low.max(high).min_element()]
}

/// Sets `mesh_hit` to the nearest triangle, or towards the sun to any triangle.
fn nearest_triangle(ray: &mut Ray<'_>, mesh_ray: &MeshRay, root: u32, mesh_hit: &mut MeshHit) {
    let mut stack = [PendingHalf::default(); TRAVERSAL_STACK];
    let mut height = 0;
    let mut reference = root;
    loop {
        let (count, at) = (reference >> REFERENCE_COUNT_SHIFT, reference & REFERENCE_MASK);
        if count > 0 {
            for k in 0..count {
                test_triangle(ray, mesh_ray, at + 2 * k, mesh_hit);
            }
            if ray.segment.to_sun && mesh_hit.triangle != 0 {
                return;
            }
        } else {
            let (a, b) = (ray.read_vec4(at), ray.read_vec4(at + 1));
            let (span_a, span_b) = (box_span(mesh_ray, a), box_span(mesh_ray, b));
            let meets_a = span_a[0] <= span_a[1] && span_a[0] <= mesh_hit.t;
            let meets_b = span_b[0] <= span_b[1] && span_b[0] <= mesh_hit.t;
            let a_first = meets_a && (!meets_b || span_a[0] <= span_b[0]);
            if meets_a && meets_b && height < TRAVERSAL_STACK {
                let (reference, t) = if a_first { (b[3], span_b[0]) } else { (a[3], span_a[0]) };
                stack[height] = PendingHalf { reference, t };
                height += 1;
            }
            if meets_a || meets_b {
                reference = if a_first { a[3] } else { b[3] };
                continue;
            }
        }
        loop {
            if height == 0 {
                return;
            }
            height -= 1;
            if stack[height].t <= mesh_hit.t {
                break;
            }
        }
        reference = stack[height].reference;
    }
}

/// A triangle's corners, in steps of the mesh's grid.
fn unpack_corners(words: [u32; 4], last: u32) -> [Vec3; 3] {
    let [a, b, c, d] = words.map(halves);
    [Vec3::new(a.x, a.y, b.x), Vec3::new(b.y, c.x, c.y), Vec3::new(d.x, d.y, (last & 0xffff) as f32)]
}

/// Möller and Trumbore 1997, from both sides. Comparisons with a NaN are false.
fn test_triangle(ray: &mut Ray<'_>, mesh_ray: &MeshRay, at: u32, mesh_hit: &mut MeshHit) {
    ray.counts.cells += 1;
    let words = ray.read_vec4(at);
    let last = ray.read_vec4(at + 1)[0];
    let [a, b, c] = unpack_corners(words, last);
    let (e1, e2, start) = (b - a, c - a, mesh_ray.o - a);
    let p = mesh_ray.d.cross(e2);
    let scale = 1.0 / e1.dot(p);
    let u = start.dot(p) * scale;
    let q = start.cross(e1);
    let v = mesh_ray.d.dot(q) * scale;
    let t = e2.dot(q) * scale;
    let inside = u >= -EDGE_SLACK && v >= -EDGE_SLACK && u + v <= 1.0 + EDGE_SLACK;
    let nearer = t < mesh_hit.t - TIE_M || t < mesh_hit.t + TIE_M && at < mesh_hit.triangle;
    if inside && t >= 0.0 && nearer {
        *mesh_hit = MeshHit { t, triangle: at, u, v };
    }
}

/// Gathers the triangle that was hit, with `t` from the segment's origin. Nothing is visible behind it.
fn hit_triangle(ray: &mut Ray<'_>, index: u32, step_m: f32, info: [u32; 4], mesh_hit: &MeshHit) {
    let Some(node) = ray.scene.nodes.get(index as usize) else { return };
    let (frame, segment, t) = (ray.scene.frame, ray.segment, mesh_hit.t);
    let words = ray.read_vec4(mesh_hit.triangle);
    let carried = ray.read_vec4(mesh_hit.triangle + 1);
    let [a, b, c] = unpack_corners(words, carried[0]);
    let across = (b - a).cross(c - a);
    let facing = if across.dot(segment.dir) < 0.0 { across } else { -across };
    let normal = facing.normalize_or(-segment.dir);
    let p = segment.origin + segment.dir * t;
    let (u, v) = (mesh_hit.u.clamp(0.0, 1.0), mesh_hit.v.clamp(0.0, 1.0));
    let albedo = if info[1] == 0 {
        let [a, b, c] = [carried[1], carried[2], carried[3]].map(linear_of);
        a + (b - a) * u + (c - a) * v
    } else {
        let size = halves(info[1]);
        let [a, b, c] = [carried[1], carried[2], carried[3]].map(|word| halves(word) / 65535.0 * size);
        let (e1, e2) = (b - a, c - a);
        let texels_per_m = (e1.perp_dot(e2).abs() / (across.length() * step_m * step_m).max(1e-12)).sqrt();
        let pixel = 2.0 * Vec3::from(frame.up).length() / (frame.height_px * frame.samples.max(1)) as f32;
        let cosine = normal.dot(segment.dir).abs().max(MIN_COSINE).sqrt();
        let level = (t * pixel * texels_per_m / cosine).max(1.0).log2();
        sample_texture(ray, info, (a + e1 * u + e2 * v) / size, level)
    };
    let light = surface_light(ray, node, p, normal);
    let hit = &mut ray.hit;
    let share = hit.transmittance;
    hit.albedo += albedo * share;
    hit.ao += light.sky * share;
    hit.normal += normal * share;
    hit.mean_m += t * share;
    hit.transmittance = 0.0;
    if share > 0.5 {
        let reflective = if light.is_reflective { u32::from(flag::REFLECTIVE) } else { 0 };
        (hit.flags, hit.level) = (MESH_FLAG | reflective, node.level);
        (hit.distance_m, hit.node) = (t, index);
        hit.shadow_origin = p + normal * (MESH_LIFT_M + MESH_LIFT_SHARE * t);
    }
}
