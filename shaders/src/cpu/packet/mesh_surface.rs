//! The surface of a mesh that the rays of a packet hit. The scalar code is `hit_triangle` of [`mesh`](crate::cpu::mesh), and
//! [`mesh_surface`](crate::cpu::mesh_surface).

use super::hits::{Hits, MeshHits, Segments, read_vec4};
use super::lanes::{
    F, FastExtremes, Lanes, M, U, Vec2s, Vec3s, always, float_u, floor_of, gather_page, gather_where, has, lanes_of,
    splat, splat_u, whole,
};
use super::objects::ObjectWords;
use crate::cpu::mesh::{MESH_LIFT_M, MESH_LIFT_SHARE, TextureHit, texture_colour};
use crate::cpu::mesh_surface::{INSIDE_AO, ROOF_NORMAL_Z, ROOF_WEIGHT_ON_WALL, UNKNOWN_AO};
use crate::cpu::ray::SceneRef;
use crate::cpu::words::{codes_per_row, halves};
use crate::layout::{ADDED_LEVEL, DrawNode, MESH_FLAG, PAGE_WORDS, PLANES, ROOF_PLANE, STRIP_PLANE, WALK_PLANE};
use crate::mesh::LEAF_OFFSET_STEPS;
use crate::pack::{AO_SHIFT, FLAGS_SHIFT, HEIGHT_BITS, HEIGHT_MASK};
use crate::srgb::linear_colours;
use fearless_simd::prelude::*;
use insula_protocol::NODE_CELLS;
use insula_protocol::blockmap::flag;
use insula_protocol::texel::{AO_MAX, OPAQUE};

/// The columns that a mesh replaces.
struct CoveredColumns<'a, S: Simd> {
    simd: S,
    atlas: &'a [u32],
    planes: [&'a [u32; PAGE_WORDS]; PLANES],
    /// Height codes of a strip's row, and the inverse, which is as exact: both are powers of two.
    codes: f32,
    rows_per_code: f32,
}

/// What all triangles of a mesh share.
pub(super) struct MeshFacts<'a> {
    /// The mesh's node, its number, and its planes.
    pub(super) node: &'a DrawNode,
    pub(super) index: u32,
    pub(super) planes: [&'a [u32; PAGE_WORDS]; PLANES],
    /// Metres of a step of its grid.
    pub(super) step_m: f32,
    pub(super) info: [u32; 4],
}

/// Triangles as in the atlas: corners, and what they carry.
struct Triangles<S: Simd> {
    corners: [Vec3s<S>; 3],
    carried: [U<S>; 3],
}

/// Gathers the triangles that the rays in `found` hit.
#[inline(always)]
pub(super) fn hit_triangles<S: Simd>(
    simd: S,
    scene: &SceneRef<'_>,
    segments: &Segments<S>,
    facts: &MeshFacts<'_>,
    found: M<S>,
    (nearest, objects): (&MeshHits<S>, &ObjectWords<S>),
    hits: &mut Hits<S>,
) {
    let MeshFacts { node, index, planes, step_m, info } = *facts;
    let (zero, t) = (splat(simd, 0.0), nearest.t);
    let triangles = Triangles::read(simd, scene, nearest.triangle, found);
    let [a, b, c] = triangles.corners;
    let across = cross(b - a, c - a);
    let away = across.dot(segments.dir).simd_ge(zero);
    let normal = Vec3s::select(away, -across, across).normalize_or(simd, -segments.dir);
    let p = segments.origin + segments.dir.scale(t);
    let mut albedo = triangles.colours(simd, found, nearest);
    if info[1] != 0 {
        for lane in lanes_of::<S>(found) {
            let [a, b, c] = triangles.carried;
            let carried = [a[lane], b[lane], c[lane]];
            let hit = TextureHit { t: t[lane], u: nearest.u[lane], v: nearest.v[lane], flat: normal.lane(lane) };
            let mut ray = segments.lane(scene, lane);
            albedo.set_lane(lane, texture_colour(&mut ray, (info, step_m), carried, across.lane(lane), hit));
        }
    }
    let codes = codes_per_row(node.z_shift());
    let columns = CoveredColumns { simd, atlas: scene.atlas, planes, codes, rows_per_code: 1.0 / codes };
    let (mut sky, reflective) = columns.surface_light(node, found, p, normal);
    let behind = found & !nearest.is_front;
    let mut inside = M::<S>::splat(simd, false);
    if behind.any_true() {
        inside = columns.is_inside(node, behind, p, normal);
        sky = inside.select(splat(simd, INSIDE_AO), sky);
    }
    let flags =
        (reflective & !inside).select(splat_u(simd, MESH_FLAG | u32::from(flag::REFLECTIVE)), splat_u(simd, MESH_FLAG));
    hits.is_hit |= found;
    hits.colour = found.select(splat_u(simd, 0), hits.colour);
    hits.albedo = Vec3s::select(found, objects.colours(simd, albedo), hits.albedo);
    hits.object = found.select(objects.address, hits.object);
    hits.ao = found.select(sky, hits.ao);
    hits.normal = Vec3s::select(found, normal, hits.normal);
    hits.flags = found.select(flags, hits.flags);
    hits.distance_m = found.select(t, hits.distance_m);
    hits.node = found.select(splat_u(simd, index), hits.node);
    hits.stone = found.select(splat_u(simd, 0), hits.stone);
    if scene.frame.shadow_m > 0.0 {
        let origin = p + normal.scale(t * MESH_LIFT_SHARE + MESH_LIFT_M);
        hits.shadow_origin = Vec3s::select(found, origin, hits.shadow_origin);
    }
}

#[inline(always)]
fn cross<S: Simd>(a: Vec3s<S>, b: Vec3s<S>) -> Vec3s<S> {
    Vec3s::<S> { x: a.y * b.z - b.y * a.z, y: a.z * b.x - b.z * a.x, z: a.x * b.y - b.x * a.y }
}

impl<S: Simd> Triangles<S> {
    #[inline(always)]
    fn read(simd: S, scene: &SceneRef<'_>, triangle: U<S>, lanes: M<S>) -> Self {
        let triangle = lanes.select(triangle, splat_u(simd, 0));
        let part = always!(|i: u32| { simd.quadruples(always!(|lane: usize| read_vec4(scene, triangle[lane] + i)),) });
        let ([a, b, c, d], [e, f, g, h]) = (part(0), part(1));
        let words = [a, b, c, d, e];
        let low = always!(|i: usize| float_u::<S>(words[i] & 0xffff));
        let high = always!(|i: usize| float_u::<S>(words[i] >> 16));
        let corners = [
            Vec3s::<S> { x: low(0), y: high(0), z: low(1) },
            Vec3s::<S> { x: high(1), y: low(2), z: high(2) },
            Vec3s::<S> { x: low(3), y: high(3), z: low(4) },
        ];
        Self { corners, carried: [f, g, h] }
    }

    /// Linear RGB between the corners' colours.
    #[inline(always)]
    fn colours(&self, simd: S, lanes: M<S>, nearest: &MeshHits<S>) -> Vec3s<S> {
        let [a, b, c] = self.carried;
        if (lanes & (a.simd_ne(b) | a.simd_ne(c))).all_false() {
            return linear_colours(simd, a);
        }
        let (a, b, c) = (linear_colours(simd, a), linear_colours(simd, b), linear_colours(simd, c));
        a + (b - a).scale(nearest.u) + (c - a).scale(nearest.v)
    }
}

impl<S: Simd> CoveredColumns<'_, S> {
    /// Shares of the sky at `p`, and whether the surface is reflective.
    #[inline(always)]
    fn surface_light(&self, node: &DrawNode, lanes: M<S>, p: Vec3s<S>, normal: Vec3s<S>) -> (F<S>, M<S>) {
        let simd = self.simd;
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let depth = 0.5 * node.cell_m;
        let offset = halves(node.leaf_offset) / LEAF_OFFSET_STEPS;
        let place = always!(|p: F<S>, normal: F<S>, corner: f32, offset: f32| {
            (p - corner - normal * depth) / node.cell_m + offset - 0.5
        });
        let at = Vec2s::<S> {
            x: place(p.x, normal.x, node.corner[0], offset.x),
            y: place(p.y, normal.y, node.corner[1], offset.y),
        };
        let z = (p.z - node.corner[2] - normal.z * depth) / node.z_step_m;
        let corner = Vec2s::<S> { x: at.x.floor(), y: at.y.floor() };
        let part = Vec2s::<S> { x: at.x - corner.x, y: at.y - corner.y };
        let (mut sum, mut weights) = (zero, zero);
        for k in 0..4 {
            let (east, north) = ((k & 1) as f32, (k >> 1) as f32);
            let number = self.number(corner.x + east, corner.y + north);
            let (sky, share) = self.sky(lanes, number, z, normal.z);
            let along = if east > 0.0 { part.x } else { one - part.x };
            let up = if north > 0.0 { part.y } else { one - part.y };
            let weight = (along * up + 1e-4) * share;
            sum += sky * weight;
            weights += weight;
        }
        let walk = self.read_plane(WALK_PLANE, self.number((at.x + 0.5).floor(), (at.y + 0.5).floor()));
        let reflective = has(simd, walk, u32::from(flag::REFLECTIVE) << FLAGS_SHIFT);
        let unknown = if node.level == ADDED_LEVEL { normal.z * 0.5 + 0.5 } else { splat(simd, UNKNOWN_AO) };
        (weights.simd_gt(zero).select(sum / weights, unknown), reflective)
    }

    /// Numbers of the columns nearest to some places.
    #[inline(always)]
    fn number(&self, x: F<S>, y: F<S>) -> U<S> {
        let (zero, last) = (splat(self.simd, 0.0), splat(self.simd, (NODE_CELLS - 1) as f32));
        let (x, y) = (floor_of::<S>(x, zero, last), floor_of::<S>(y, zero, last));
        whole::<S>(y * NODE_CELLS as f32 + x)
    }

    #[inline(always)]
    fn read_plane(&self, plane: usize, number: U<S>) -> U<S> {
        gather_page(self.simd, self.planes[plane], number)
    }

    #[inline(always)]
    fn read(&self, lanes: M<S>, at: U<S>) -> U<S> {
        gather_where(self.simd, self.atlas, at, lanes)
    }

    /// Highest and lowest points of columns with these words.
    #[inline(always)]
    fn bounds(&self, word: U<S>) -> (F<S>, F<S>) {
        (float_u::<S>(word & HEIGHT_MASK), float_u::<S>((word >> HEIGHT_BITS) & HEIGHT_MASK))
    }

    /// Shares of the sky that columns see at heights `z`, and the weights of those, as the scalar `column_sky`.
    #[inline(always)]
    fn sky(&self, lanes: M<S>, number: U<S>, z: F<S>, upwards: F<S>) -> (F<S>, F<S>) {
        let (simd, codes) = (self.simd, self.codes);
        let (zero, one, zeros) = (splat(simd, 0.0), splat(simd, 1.0), splat_u(simd, 0));
        let walk = self.read_plane(WALK_PLANE, number);
        let bit = always!(|flag: u8| has(simd, walk, u32::from(flag) << FLAGS_SHIFT));
        let (exposed, gap) = (bit(flag::EXPOSED), bit(flag::GAP));
        let two = splat_u(simd, 2);
        let head = bit(flag::CLIPPED).select(two, zeros) + gap.select(two, zeros);
        let strip = self.read_plane(STRIP_PLANE, number);
        let texels = exposed.select(strip + head, zeros);
        let bounds = if (lanes & gap).any_true() { gap.select(self.read(lanes & gap, texels - 1), walk) } else { walk };
        let (z_max, z_min) = self.bounds(bounds);
        let far = z.simd_gt(z_max + 1.5 * codes) | z.simd_lt(z_min - 1.5 * codes);
        let known = lanes & bit(flag::OCCUPIED) & !far;
        let near_top = z.simd_gt(z_max - 1.5 * codes);
        let is_roof = upwards.simd_gt(splat(simd, ROOF_NORMAL_Z));
        let by_roof = !exposed | (is_roof & near_top);
        let from_roof = known & by_roof & near_top;
        let ao = always!(|texel: U<S>| float_u::<S>(texel >> AO_SHIFT) / f32::from(AO_MAX));
        let roof = ao(self.read_plane(ROOF_PLANE, number));
        let mut sky = from_roof.select(is_roof.select(roof, roof * 0.5), zero);
        let mut weight = from_roof.select(is_roof.select(one, splat(simd, ROOF_WEIGHT_ON_WALL)), zero);
        let from_wall = known & !by_roof;
        if from_wall.any_true() {
            let per_code = self.rows_per_code;
            let first = (z_min * per_code).floor();
            let rows = ((z_max - 1.0) * per_code).floor() - first;
            let row = (z * per_code - 0.5 - first).fast_max(zero).fast_min(rows);
            let low = row.floor();
            let a = self.read(from_wall, texels + whole::<S>(low));
            let b = self.read(from_wall, texels + whole::<S>((low + 1.0).fast_min(rows)));
            let covered = always!(|texel: U<S>, share: F<S>| (texel & OPAQUE).simd_ne(zeros).select(share, zero));
            let (wa, wb) = (covered(a, one - (row - low)), covered(b, row - low));
            let both = wa + wb;
            let some = from_wall & both.simd_gt(zero);
            sky = some.select((ao(a) * wa + ao(b) * wb) / both, sky);
            weight = some.select(one, weight);
        }
        (sky, weight)
    }

    /// Whether the places in front of surfaces are within columns' solids.
    #[inline(always)]
    fn is_inside(&self, node: &DrawNode, lanes: M<S>, p: Vec3s<S>, normal: Vec3s<S>) -> M<S> {
        let simd = self.simd;
        let offset = halves(node.leaf_offset) / LEAF_OFFSET_STEPS;
        let before = always!(|p: F<S>, corner: f32, normal: F<S>| p - corner + normal * node.cell_m);
        let x = before(p.x, node.corner[0], normal.x) / node.cell_m + offset.x;
        let y = before(p.y, node.corner[1], normal.y) / node.cell_m + offset.y;
        let z = before(p.z, node.corner[2], normal.z) / node.z_step_m;
        let walk = self.read_plane(WALK_PLANE, self.number(x, y));
        let occupied = has(simd, walk, u32::from(flag::OCCUPIED) << FLAGS_SHIFT);
        // A gap may be in front of the surface.
        let gap = has(simd, walk, u32::from(flag::GAP) << FLAGS_SHIFT);
        let (z_max, z_min) = self.bounds(walk);
        lanes & occupied & !gap & z.simd_gt(z_min) & z.simd_lt(z_max)
    }
}
