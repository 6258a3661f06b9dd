//! Hits of a ray on a leaf that is drawn as a mesh. GPU twin: `mesh.wgsl`.
//!
//! A ray visits boxes in boxes, the nearer half first, and tests the triangles of those that it meets.

use super::fast_math::nonzero;
use super::landmark::{TrianglePoint, landmark_at, triangle_stride};
use super::mesh_surface::{INSIDE_AO, SurfaceLight, is_inside, sample_texture, surface_light};
use super::objects::{is_hidden, object_colour, object_of_triangle};
use super::ray::{Ray, RayHit};
use super::shade::linear_of;
use super::words::halves;
use crate::lanes::{F, LaneFloats, LaneMask, Lanes, M, OneLane, Vec3s, always};
use crate::layout::{FrameUniform, MESH_FLAG, Shading};
use crate::mesh::{REFERENCE_COUNT_SHIFT, REFERENCE_MASK, TRAVERSAL_STACK};
use glam::Vec3;
use insula_protocol::blockmap::flag;

/// Slack of edges, as a share of the two products whose difference says on which side the ray passes: more than rounding
/// can change it, whether or not a device fuses a product with the difference.
pub(crate) const EDGE_SLACK: f32 = 2.4e-7;
/// Slack of boxes, in steps of the grid.
pub(crate) const BOX_SLACK: f32 = 0.5;
/// Of triangles that are nearer to each other than this many metres, one that faces the ray is seen: no wall shows through
/// the edge of the roof on it. If they also lie in one plane, the first one in the atlas is seen, so that they do not flicker.
pub(crate) const TIE_M: f32 = 1e-4;
/// The part of that distance that grows with the distance from the ray's origin, per metre.
pub(crate) const TIE_SHARE: f32 = 5e-7;
/// Squared sine of the largest angle between triangles that count as in one plane.
pub(crate) const PLANE_SINE_SQUARED: f32 = 1e-6;
/// How far above a mesh its ray towards the sun begins, in metres.
pub(crate) const MESH_LIFT_M: f32 = 0.02;
/// The part of that height that grows with the distance, per metre.
pub(crate) const MESH_LIFT_SHARE: f32 = 1e-4;
/// Least cosine between ray and normal that a texture's level is chosen for.
pub(crate) const MIN_COSINE: f32 = 0.15;
/// Colours of [`Shading::Wire`].
pub(crate) const WIRE_SURFACE: Vec3 = Vec3::new(0.72, 0.74, 0.76);
pub(crate) const WIRE_LINE: Vec3 = Vec3::new(0.01, 0.02, 0.06);

/// Rays in steps of a mesh's grid, all with the same longest axis; `t` stays in metres.
pub(super) struct MeshRays<S: Lanes> {
    pub(super) simd: S,
    o: Vec3s<S>,
    inv: Vec3s<S>,
    /// First word of the palette, 0 without one.
    palette: u32,
    /// Vec4s of a triangle.
    pub(super) stride: u32,
    /// Factors of the coordinate on the longest axis in the two others, which turn points from the origin on into a picture in which the
    /// ray is a point, and its factor in `t`.
    shear: [F<S>; 3],
    /// Sign of the second coordinate of that picture.
    side: F<S>,
}

/// Where rays meet a triangle.
pub(super) struct TriangleHits<S: Lanes> {
    /// The rays that do.
    pub(super) lanes: M<S>,
    pub(super) t: F<S>,
    /// Shares of the second and third corner.
    pub(super) u: F<S>,
    pub(super) v: F<S>,
    pub(super) is_front: M<S>,
}

/// The nearest triangle so far.
pub(super) struct MeshHit {
    pub(super) t: f32,
    /// Its address in the atlas, in vec4s; 0 if there is none.
    pub(super) triangle: u32,
    pub(super) u: f32,
    pub(super) v: f32,
    pub(super) is_front: bool,
    /// Address of its object's word in the palette, or 0.
    pub(super) object: u32,
}

/// A half of the tree that is still to be visited, and where the ray enters it.
#[derive(Clone, Copy, Default)]
struct PendingHalf {
    reference: u32,
    t: f32,
}

/// Gathers the first triangle that the ray's segment hits in the mesh of node `index`, if it is nearer than what was hit before.
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
    let length = d.abs();
    let axis = match () {
        () if length.z >= length.x.max(length.y) => 2,
        () if length.y >= length.x => 1,
        () => 0,
    };
    let mesh_ray = MeshRays::new(OneLane, (o.into(), d.into()), axis, (triangle_stride(info), whole[3]));
    let [enter_m, exit_m] = mesh_ray.box_span(whole);
    let reach_m = ray.segment.reach_m.min(ray.hit.distance_m);
    if enter_m > exit_m || enter_m > reach_m {
        return;
    }
    let reach_m = reach_m.min(exit_m + 1.0);
    let mut mesh_hit = MeshHit { t: reach_m, triangle: 0, u: 0.0, v: 0.0, is_front: true, object: 0 };
    match axis {
        2 => nearest_triangle::<2>(ray, &mesh_ray, info[0], &mut mesh_hit),
        1 => nearest_triangle::<1>(ray, &mesh_ray, info[0], &mut mesh_hit),
        _ => nearest_triangle::<0>(ray, &mesh_ray, info[0], &mut mesh_hit),
    }
    if mesh_hit.triangle == 0 {
        return;
    }
    if ray.segment.to_sun {
        ray.hit.is_hit = true;
        return;
    }
    hit_triangle(ray, index, step_m, info, &mesh_hit);
}

impl<S: Lanes> MeshRays<S> {
    /// Shears along the longest axis of `d`, so that coordinates do not grow (Woop, Benthin and Wald 2013). Last are the vec4s of a triangle,
    /// and the first word of the palette.
    #[inline(always)]
    pub(super) fn new(simd: S, (o, d): (Vec3s<S>, Vec3s<S>), axis: usize, (stride, palette): (u32, u32)) -> Self {
        let one = simd.splat(1.0);
        let inv = Vec3s::new(one / d.x, one / d.y, one / d.z);
        let sign = always!(|v: F<S>| v.below(0.0).select(-one, one));
        // The cross product of the two other axes points along the ray.
        let (a, b, side, along) = match axis {
            2 => (d.x, d.y, sign(d.z), inv.z),
            1 => (d.x, d.z, -sign(d.y), inv.y),
            _ => (d.y, d.z, sign(d.x), inv.x),
        };
        Self { simd, o, inv, palette, stride, shear: [a * along, side * b * along, along], side }
    }

    /// A point's two coordinates across the rays, and the one along the longest axis.
    #[inline(always)]
    fn shear<const AXIS: usize>(&self, p: Vec3) -> [F<S>; 3] {
        let p = Vec3s::splat(self.simd, p) - self.o;
        let (a, b, along) = match AXIS {
            2 => (p.x, p.y, p.z),
            1 => (p.x, p.z, p.y),
            _ => (p.y, p.z, p.x),
        };
        [a - self.shear[0] * along, self.side * b - self.shear[1] * along, along]
    }

    /// The intervals of the rays inside a box, in metres. Empty if the first value is larger.
    #[inline(always)]
    pub(super) fn box_span(&self, words: [u32; 4]) -> [F<S>; 2] {
        let span = always!(|word: u32, o: F<S>, inv: F<S>| {
            let ends = halves(word);
            let low = (self.simd.splat(ends.x - BOX_SLACK) - o) * inv;
            let high = (self.simd.splat(ends.y + BOX_SLACK) - o) * inv;
            [low.min_of(high), low.max_of(high)]
        });
        let x = span(words[0], self.o.x, self.inv.x);
        let y = span(words[1], self.o.y, self.inv.y);
        let z = span(words[2], self.o.z, self.inv.z);
        [x[0].max_of(y[0]).max_of(z[0]).at_least(0.0), x[1].min_of(y[1]).min_of(z[1])]
    }

    /// Watertight, from both sides (Woop, Benthin and Wald 2013, "Watertight ray/triangle intersection"): both triangles at an
    /// edge compute the same two products of its ends, so a ray that passes one of them within rounding meets the other.
    /// Comparisons with a NaN are false.
    #[inline(always)]
    pub(super) fn meet_triangle<const AXIS: usize>(
        &self,
        [a, b, c]: [Vec3; 3],
        lanes: M<S>,
    ) -> Option<TriangleHits<S>> {
        let (a, b, c) = (self.shear::<AXIS>(a), self.shear::<AXIS>(b), self.shear::<AXIS>(c));
        let products = [b[0] * c[1], c[0] * a[1], a[0] * b[1]];
        let others = [b[1] * c[0], c[1] * a[0], a[1] * b[0]];
        let sides = [products[0] - others[0], products[1] - others[1], products[2] - others[2]];
        let low = sides[0].min_of(sides[1]).min_of(sides[2]);
        let high = sides[0].max_of(sides[1]).max_of(sides[2]);
        // Most rays pass the edges by far more than rounding can change.
        let size = always!(|p: [F<S>; 3]| p[0].abs().max_of(p[1].abs()));
        let largest = size(a).max_of(size(b)).max_of(size(c));
        let most = largest * largest * (2.0 * EDGE_SLACK);
        let (above, below) = (most.is_less(high), low.is_less(-most));
        let mut lanes = lanes & !(above & below);
        if !lanes.any() {
            return None;
        }
        let (is_back, mut is_front) = (low.at_or_above(0.0) & above, high.at_or_below(0.0) & below);
        let near_edge = lanes & !is_back & !is_front;
        if near_edge.any() {
            let [back, front] = self.sides_near_edges(products, others, sides);
            // Both: the ray sees the triangle edge-on, and meets its neighbours.
            lanes = lanes & !(near_edge & !(back ^ front));
            is_front = is_front | (near_edge & front);
        }
        let sign = is_front.select(self.simd.splat(-1.0), self.simd.splat(1.0));
        let weight = always!(|side: F<S>| (sign * side).at_least(0.0));
        let (wa, wb, wc) = (weight(sides[0]), weight(sides[1]), weight(sides[2]));
        let scale = self.simd.splat(1.0) / (wa + wb + wc);
        let (u, v) = (wb * scale, wc * scale);
        let t = (wa * scale * a[2] + u * b[2] + v * c[2]) * self.shear[2];
        Some(TriangleHits { lanes, t, u, v, is_front })
    }

    /// Whether rays see a triangle's back, and its front, or pass it within rounding.
    #[inline(always)]
    fn sides_near_edges(&self, products: [F<S>; 3], others: [F<S>; 3], sides: [F<S>; 3]) -> [M<S>; 2] {
        let [mut back, mut front] = [self.simd.splat_m(true); 2];
        for i in 0..3 {
            let slack = (products[i].abs() + others[i].abs()) * EDGE_SLACK;
            back = back & (sides[i] + slack).at_or_above(0.0);
            front = front & (sides[i] - slack).at_or_below(0.0);
        }
        [back, front]
    }
}

/// Sets `mesh_hit` to the nearest triangle, or towards the sun to any triangle. `AXIS` is the ray's longest.
fn nearest_triangle<const AXIS: usize>(
    ray: &mut Ray<'_>,
    mesh_ray: &MeshRays<OneLane>,
    root: u32,
    mesh_hit: &mut MeshHit,
) {
    let mut stack = [PendingHalf::default(); TRAVERSAL_STACK];
    let mut height = 0;
    let mut reference = root;
    loop {
        let (count, at) = (reference >> REFERENCE_COUNT_SHIFT, reference & REFERENCE_MASK);
        if count > 0 {
            for k in 0..count {
                test_triangle::<AXIS>(ray, mesh_ray, at + mesh_ray.stride * k, mesh_hit);
            }
            if ray.segment.to_sun && mesh_hit.triangle != 0 {
                return;
            }
        } else {
            let (a, b) = (ray.read_vec4(at), ray.read_vec4(at + 1));
            let (span_a, span_b) = (mesh_ray.box_span(a), mesh_ray.box_span(b));
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
pub(super) fn unpack_corners(words: [u32; 4], last: u32) -> [Vec3; 3] {
    let [a, b, c, d] = words.map(halves);
    [Vec3::new(a.x, a.y, b.x), Vec3::new(b.y, c.x, c.y), Vec3::new(d.x, d.y, (last & 0xffff) as f32)]
}

fn read_corners(ray: &mut Ray<'_>, at: u32) -> [Vec3; 3] {
    let words = ray.read_vec4(at);
    let last = ray.read_vec4(at + 1)[0];
    unpack_corners(words, last)
}

/// Sets `mesh_hit` to a triangle if the ray meets it before.
fn test_triangle<const AXIS: usize>(ray: &mut Ray<'_>, mesh_ray: &MeshRays<OneLane>, at: u32, mesh_hit: &mut MeshHit) {
    ray.counts.cells += 1;
    let Some(met) = mesh_ray.meet_triangle::<AXIS>(read_corners(ray, at), true) else { return };
    let TriangleHits { lanes: true, t, u, v, is_front } = met else { return };
    let tie = TIE_M + TIE_SHARE * t;
    if !(t >= 0.0 && t < mesh_hit.t + tie) {
        return;
    }
    let object = object_of_triangle(ray, at, mesh_ray.palette);
    if is_hidden(ray, object) {
        return;
    }
    let found = MeshHit { t, triangle: at, u, v, is_front, object };
    if t < mesh_hit.t - tie || wins_tie(ray, &found, mesh_hit) {
        *mesh_hit = found;
    }
}

/// Which of two triangles at nearly the same place is seen.
pub(super) fn wins_tie(ray: &mut Ray<'_>, found: &MeshHit, before: &MeshHit) -> bool {
    if found.is_front != before.is_front {
        return found.is_front;
    }
    let [a, b] = [normal_of(ray, found.triangle), normal_of(ray, before.triangle)];
    let in_one_plane = a.cross(b).length_squared() <= PLANE_SINE_SQUARED * a.length_squared() * b.length_squared();
    if in_one_plane { found.triangle < before.triangle } else { found.t < before.t }
}

/// A triangle's normal, as long as twice its area.
fn normal_of(ray: &mut Ray<'_>, at: u32) -> Vec3 {
    let [a, b, c] = read_corners(ray, at);
    (b - a).cross(c - a)
}

/// Gathers the triangle that was hit, with `t` from the segment's origin. Nothing is visible behind it.
pub(super) fn hit_triangle(ray: &mut Ray<'_>, index: u32, step_m: f32, info: [u32; 4], mesh_hit: &MeshHit) {
    let Some(node) = ray.scene.nodes.get(index as usize) else { return };
    let (segment, t) = (ray.segment, mesh_hit.t);
    let words = ray.read_vec4(mesh_hit.triangle);
    let carried = ray.read_vec4(mesh_hit.triangle + 1);
    let [a, b, c] = unpack_corners(words, carried[0]);
    let across = (b - a).cross(c - a);
    let facing = if across.dot(segment.dir) < 0.0 { across } else { -across };
    let flat = facing.normalize_or(-segment.dir);
    let p = segment.origin + segment.dir * t;
    let (u, v) = (mesh_hit.u, mesh_hit.v);
    let albedo = if info[1] == 0 {
        let [a, b, c] = [carried[1], carried[2], carried[3]].map(linear_of);
        a + (b - a) * u + (c - a) * v
    } else {
        let corners = [carried[1], carried[2], carried[3]];
        texture_colour(ray, (info, step_m), corners, across, TextureHit { t, u, v, flat })
    };
    let turned = if across.dot(segment.dir) < 0.0 { 1.0 } else { -1.0 };
    let landmark = landmark_at(ray, node, info, TrianglePoint { triangle: mesh_hit.triangle, u, v, turned });
    let light = match landmark.and_then(|landmark| landmark.sky) {
        Some(sky) => SurfaceLight { sky, is_reflective: false },
        None if mesh_hit.is_front || !is_inside(ray, node, p, flat) => surface_light(ray, node, p, flat),
        None => SurfaceLight { sky: INSIDE_AO, is_reflective: false },
    };
    let normal = landmark.map_or(flat, |landmark| landmark.normal_towards(segment.dir));
    let colour = match shown_triangle(ray.scene.frame, segment.dir, [a, b, c], mesh_hit, step_m) {
        Some(colour) => colour,
        None => object_colour(ray, mesh_hit.object, albedo),
    };
    // A colour of an object replaces its stone.
    let stone = landmark.filter(|_| colour == albedo).map_or(0, |landmark| landmark.stone);
    let reflective = if light.is_reflective { u32::from(flag::REFLECTIVE) } else { 0 };
    ray.hit = RayHit {
        is_hit: true,
        albedo: colour,
        ao: light.sky,
        normal,
        flags: MESH_FLAG | reflective,
        level: node.level,
        distance_m: t,
        node: index,
        object: mesh_hit.object,
        shadow_origin: p + flat * (MESH_LIFT_M + MESH_LIFT_SHARE * t),
        stone,
        stone_point: landmark.map_or(Vec3::ZERO, |landmark| p - landmark.origin),
    };
}

/// Colour of a triangle in [`Shading::Wire`] and [`Shading::Triangles`]; `None` in other shadings. `corners` are in steps of the
/// mesh's grid.
#[cold]
fn shown_triangle(
    frame: &FrameUniform,
    dir: Vec3,
    corners: [Vec3; 3],
    mesh_hit: &MeshHit,
    step_m: f32,
) -> Option<Vec3> {
    if frame.shading == Shading::Triangles as u32 {
        return Some(triangle_tint(corners));
    }
    if frame.shading != Shading::Wire as u32 {
        return None;
    }
    let [a, b, c] = corners;
    let p = (b - a) * mesh_hit.u + (c - a) * mesh_hit.v;
    // How far the ray passes a line.
    let away = |from: Vec3, along: Vec3| {
        let across = dir.cross(along);
        (p - from).dot(across).abs() / across.length().max(1e-12)
    };
    let nearest = away(Vec3::ZERO, b - a).min(away(Vec3::ZERO, c - a)).min(away(b - a, c - b));
    let pixel_m = mesh_hit.t * 2.0 * Vec3::from(frame.up).length() / frame.height_px as f32;
    let line = (1.0 - nearest * step_m / pixel_m).max(0.0);
    Some(WIRE_SURFACE + (WIRE_LINE - WIRE_SURFACE) * line)
}

/// A colour that follows from the place of a triangle in its mesh.
fn triangle_tint(corners: [Vec3; 3]) -> Vec3 {
    let sum = corners[0] + corners[1] * 3.0 + corners[2] * 7.0;
    let mixed = (sum.x as u32).wrapping_mul(73_856_093)
        ^ (sum.y as u32).wrapping_mul(19_349_663)
        ^ (sum.z as u32).wrapping_mul(83_492_791);
    let mixed = mixed ^ mixed >> 13;
    let channel = |shift: u32| (mixed >> shift & 255) as f32 / 255.0;
    Vec3::new(channel(0), channel(8), channel(16)) * 0.8 + 0.1
}

/// Where a ray hits a triangle with a texture.
#[derive(Clone, Copy)]
pub(super) struct TextureHit {
    pub(super) t: f32,
    /// Shares of the second and third corner.
    pub(super) u: f32,
    pub(super) v: f32,
    /// The triangle's unit normal.
    pub(super) flat: Vec3,
}

/// Colour of a texture in a triangle whose corners lie at `carried` and whose normal, as long as twice its area, is `across`.
pub(super) fn texture_colour(
    ray: &mut Ray<'_>,
    (info, step_m): ([u32; 4], f32),
    carried: [u32; 3],
    across: Vec3,
    hit: TextureHit,
) -> Vec3 {
    let frame = ray.scene.frame;
    let size = halves(info[1]);
    let [a, b, c] = carried.map(|word| halves(word) / 65535.0 * size);
    let (e1, e2) = (b - a, c - a);
    let texels_per_m = (e1.perp_dot(e2).abs() / (across.length() * step_m * step_m).max(1e-12)).sqrt();
    let pixel = 2.0 * Vec3::from(frame.up).length() / (frame.height_px * frame.samples.max(1)) as f32;
    let cosine = hit.flat.dot(ray.segment.dir).abs().max(MIN_COSINE).sqrt();
    let level = (hit.t * pixel * texels_per_m / cosine).max(1.0).log2();
    sample_texture(ray, info, (a + e1 * hit.u + e2 * hit.v) / size, level)
}
