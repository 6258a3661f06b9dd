//! What a ray meets in a leaf that is drawn as a mesh.
//!
//! In: a leaf's mesh in pages (`crate::mesh`), a ray. Out: what it gathers there. Next: `raycast` goes on, or is done.
//!
//! A ray looks at boxes in boxes, the nearer half first, and at the triangles of those that it meets. What it hits gets its
//! share of the sky from the columns that the mesh stands for, so that neither of the two is darker than the other.
//! Functions bear the names that they have in `mesh.wgsl` and stand in the same order.

use super::{
    raycast::{Gathered, Leg, SceneRef},
    shade::linear_of,
};
use crate::{
    layout::{DrawNode, MESH_FLAG},
    mesh::{COUNT_SHIFT, PLACES, STACK, TILE_PX},
    pack::head_words,
};
use glam::{IVec2, Vec2, Vec3, Vec3Swizzles};
use insula_protocol::{NODE_CELLS, blockmap::flag};

/// Slack of barycentric coordinates, so that no ray slips between two triangles.
const EDGE_SLACK: f32 = 2e-5;
/// Slack of boxes, in steps of the grid.
const BOX_SLACK: f32 = 0.5;
/// Of faces nearer to each other than this many metres, the one that comes first in the atlas is seen: those that lie in one plane
/// do not flicker.
const TIE_M: f32 = 1e-4;
/// How far above a mesh its ray towards the sun begins, in metres, and in shares of the distance.
const MESH_LIFT_M: f32 = 0.02;
const MESH_LIFT_SHARE: f32 = 1e-4;
/// Least cosine that a texture's level is chosen for.
const FLATTEST: f32 = 0.15;
/// How much a roof tells of a wall below its edge, where the wall's own columns do not.
const ROOF_OF_WALL: f32 = 0.02;
/// Share of the sky where no column tells.
const UNKNOWN_AO: f32 = 0.7;

/// A ray in steps of a mesh's grid, from where it enters the mesh's box; `t` still in metres.
struct MeshRay {
    o: Vec3,
    d: Vec3,
    inv: Vec3,
    /// Where the box begins, in metres from where the ray does.
    enter_m: f32,
}

/// The nearest triangle so far.
struct MeshHit {
    t: f32,
    /// Where it lies; 0 if there is none.
    four: u32,
    u: f32,
    v: f32,
}

fn four(scene: &SceneRef<'_>, gathered: &mut Gathered, at: u32) -> [u32; 4] {
    gathered.counts.fetches += 1;
    scene.atlas.get(at as usize * 4..).and_then(|words| words.first_chunk()).copied().unwrap_or_default()
}

fn mesh_word(scene: &SceneRef<'_>, gathered: &mut Gathered, at: u32) -> u32 {
    gathered.counts.fetches += 1;
    scene.atlas.get(at as usize).copied().unwrap_or(0)
}

fn halves(word: u32) -> Vec2 {
    Vec2::new((word & 0xffff) as f32, (word >> 16) as f32)
}

pub(super) fn walk_mesh(scene: &SceneRef<'_>, node: &DrawNode, index: u32, leg: &Leg, gathered: &mut Gathered) {
    gathered.counts.nodes += 1;
    let head = node.mesh - 1;
    let place = four(scene, gathered, head).map(f32::from_bits);
    let about = four(scene, gathered, head + 1);
    let whole = four(scene, gathered, head + 2);
    let step_m = place[3];
    let zero = Vec3::new(node.corner[0], node.corner[1], node.mesh_z_m) + Vec3::new(place[0], place[1], place[2]);
    let o = (leg.from - zero) / step_m;
    let d = leg.dir / step_m;
    let fix = |v: f32| if v.abs() < 1e-12 { 1e-12 } else { v };
    let d = Vec3::new(fix(d.x), fix(d.y), fix(d.z));
    let mut ray = MeshRay { o, d, inv: 1.0 / d, enter_m: 0.0 };
    let [enter_m, exit_m] = box_span(&ray, whole);
    if enter_m > exit_m || enter_m > leg.reach_m {
        return;
    }
    // Numbers are smallest, and so most exact, where the box begins.
    ray.o += ray.d * enter_m;
    ray.enter_m = enter_m;
    let mut hit = MeshHit { t: leg.reach_m.min(exit_m + 1.0) - enter_m, four: 0, u: 0.0, v: 0.0 };
    nearest(scene, &ray, about[0], leg.to_sun, &mut hit, gathered);
    if hit.four == 0 {
        return;
    }
    if leg.to_sun {
        gathered.left = 0.0;
        return;
    }
    show(scene, node, index, leg, &ray, step_m, about, &hit, gathered);
}

/// Where a ray is in a box, metres; the first larger if nowhere.
fn box_span(ray: &MeshRay, words: [u32; 4]) -> [f32; 2] {
    let (x, y, z) = (halves(words[0]), halves(words[1]), halves(words[2]));
    let low = (Vec3::new(x.x, y.x, z.x) - BOX_SLACK - ray.o) * ray.inv;
    let high = (Vec3::new(x.y, y.y, z.y) + BOX_SLACK - ray.o) * ray.inv;
    [low.min(high).max_element().max(0.0), low.max(high).min_element()]
}

/// The nearest triangle before `hit`; any, if `to_sun`.
fn nearest(scene: &SceneRef<'_>, ray: &MeshRay, root: u32, to_sun: bool, hit: &mut MeshHit, gathered: &mut Gathered) {
    let mut stack = [(0u32, 0f32); STACK];
    let mut height = 0;
    let mut at = root;
    loop {
        let (count, place) = (at >> COUNT_SHIFT, at & ((1 << COUNT_SHIFT) - 1));
        if count > 0 {
            for k in 0..count {
                triangle(scene, ray, place + 2 * k, hit, gathered);
            }
            if to_sun && hit.four != 0 {
                return;
            }
        } else {
            let (a, b) = (four(scene, gathered, place), four(scene, gathered, place + 1));
            let (span_a, span_b) = (box_span(ray, a), box_span(ray, b));
            let meets_a = span_a[0] <= span_a[1] && span_a[0] <= hit.t;
            let meets_b = span_b[0] <= span_b[1] && span_b[0] <= hit.t;
            let a_first = meets_a && (!meets_b || span_a[0] <= span_b[0]);
            if meets_a && meets_b && height < STACK {
                stack[height] = if a_first { (b[3], span_b[0]) } else { (a[3], span_a[0]) };
                height += 1;
            }
            if meets_a || meets_b {
                at = if a_first { a[3] } else { b[3] };
                continue;
            }
        }
        loop {
            if height == 0 {
                return;
            }
            height -= 1;
            if stack[height].1 <= hit.t {
                break;
            }
        }
        at = stack[height].0;
    }
}

/// A triangle's corners, in steps.
fn corners(words: [u32; 4], last: u32) -> [Vec3; 3] {
    let [a, b, c, d] = words.map(halves);
    [Vec3::new(a.x, a.y, b.x), Vec3::new(b.y, c.x, c.y), Vec3::new(d.x, d.y, (last & 0xffff) as f32)]
}

/// Möller and Trumbore 1997, from both sides.
fn triangle(scene: &SceneRef<'_>, ray: &MeshRay, at: u32, hit: &mut MeshHit, gathered: &mut Gathered) {
    gathered.counts.cells += 1;
    let words = four(scene, gathered, at);
    let last = four(scene, gathered, at + 1)[0];
    let [a, b, c] = corners(words, last);
    let (e1, e2, from) = (b - a, c - a, ray.o - a);
    let p = ray.d.cross(e2);
    let scale = 1.0 / e1.dot(p);
    let u = from.dot(p) * scale;
    let q = from.cross(e1);
    let v = ray.d.dot(q) * scale;
    let t = e2.dot(q) * scale;
    // Comparisons with what is no number are false.
    let inside = u >= -EDGE_SLACK && v >= -EDGE_SLACK && u + v <= 1.0 + EDGE_SLACK;
    let nearer = t < hit.t - TIE_M || t < hit.t + TIE_M && at < hit.four;
    if inside && t >= 0.0 && nearer {
        *hit = MeshHit { t, four: at, u, v };
    }
}

/// Gathers what the triangle that was hit looks like. Nothing is seen behind it.
#[allow(clippy::too_many_arguments)] // One call in WGSL too; a struct for it would only rename them.
fn show(
    scene: &SceneRef<'_>,
    node: &DrawNode,
    index: u32,
    leg: &Leg,
    ray: &MeshRay,
    step_m: f32,
    about: [u32; 4],
    hit: &MeshHit,
    gathered: &mut Gathered,
) {
    let words = four(scene, gathered, hit.four);
    let looks = four(scene, gathered, hit.four + 1);
    let [a, b, c] = corners(words, looks[0]);
    let across = (b - a).cross(c - a);
    let facing = if across.dot(leg.dir) < 0.0 { across } else { -across };
    let normal = facing.normalize_or(-leg.dir);
    let t = ray.enter_m + hit.t;
    let p = leg.from + leg.dir * t;
    let (u, v) = (hit.u.clamp(0.0, 1.0), hit.v.clamp(0.0, 1.0));
    let albedo = if about[1] == 0 {
        let [a, b, c] = [looks[1], looks[2], looks[3]].map(linear_of);
        a + (b - a) * u + (c - a) * v
    } else {
        let size = Vec2::new((about[1] & 0xffff) as f32, (about[1] >> 16) as f32);
        let [a, b, c] = [looks[1], looks[2], looks[3]].map(|word| halves(word) / 65535.0 * size);
        let (e1, e2) = (b - a, c - a);
        let texels_per_m = (e1.perp_dot(e2).abs() / (across.length() * step_m * step_m).max(1e-12)).sqrt();
        let frame = scene.frame;
        let pixel = 2.0 * Vec3::from(frame.up).length() / (frame.height_px * frame.samples.max(1)) as f32;
        let flat = normal.dot(leg.dir).abs().max(FLATTEST).sqrt();
        let level = (t * pixel * texels_per_m / flat).max(1.0).log2();
        texture(scene, about, (a + e1 * u + e2 * v) / size, level, gathered)
    };
    let ao = open_sky(scene, node, p, normal, gathered);
    let share = gathered.left;
    gathered.albedo += albedo * share;
    gathered.ao += ao * share;
    gathered.normal += normal * share;
    gathered.mean_m += t * share;
    gathered.left = 0.0;
    if share > 0.5 {
        (gathered.flags, gathered.level) = (MESH_FLAG, node.level);
        (gathered.distance_m, gathered.node) = (t, index);
        gathered.sun_from = p + normal * (MESH_LIFT_M + MESH_LIFT_SHARE * t);
    }
}

/// Linear light of a texture at `uv`, between its two levels nearest to `level`.
fn texture(scene: &SceneRef<'_>, about: [u32; 4], uv: Vec2, level: f32, gathered: &mut Gathered) -> Vec3 {
    let levels = about[2].max(1);
    let level = level.min((levels - 1) as f32);
    let fine = level.floor() as u32;
    let mut table = about[3];
    for k in 0..fine {
        table += squares(about[1], k);
    }
    let squared = bilinear(scene, about[1], table, fine, uv, gathered);
    let coarse = (fine + 1).min(levels - 1);
    let coarse_table = if coarse > fine { table + squares(about[1], fine) } else { table };
    let coarser = bilinear(scene, about[1], coarse_table, coarse, uv, gathered);
    let mean = squared + (coarser - squared) * (level - fine as f32);
    decode(mean.max(Vec3::ZERO).map(f32::sqrt))
}

/// Width and height of a level.
fn level_size(size: u32, level: u32) -> [u32; 2] {
    [((size & 0xffff) >> level).max(1), (size >> 16 >> level).max(1)]
}

/// Squares of a level.
fn squares(size: u32, level: u32) -> u32 {
    let [width, height] = level_size(size, level);
    width.div_ceil(TILE_PX) * height.div_ceil(TILE_PX)
}

/// Squares of sRGB's numbers are nearly light: the mean of the four texels around.
fn bilinear(scene: &SceneRef<'_>, size: u32, table: u32, level: u32, uv: Vec2, gathered: &mut Gathered) -> Vec3 {
    let [width, height] = level_size(size, level);
    let last = IVec2::new(width as i32 - 1, height as i32 - 1);
    let at = uv * Vec2::new(width as f32, height as f32) - 0.5;
    let corner = at.floor();
    let part = at - corner;
    let mut sum = Vec3::ZERO;
    for k in 0..4 {
        let step = IVec2::new(k & 1, k >> 1);
        let p = (corner.as_ivec2() + step).clamp(IVec2::ZERO, last).as_uvec2();
        let square = table + p.y / TILE_PX * width.div_ceil(TILE_PX) + p.x / TILE_PX;
        let first = mesh_word(scene, gathered, square);
        let texel = mesh_word(scene, gathered, first + p.y % TILE_PX * width.min(TILE_PX) + p.x % TILE_PX);
        let rgb = Vec3::new((texel & 255) as f32, (texel >> 8 & 255) as f32, (texel >> 16 & 255) as f32) / 255.0;
        let along = if step.x == 1 { part.x } else { 1.0 - part.x };
        let up = if step.y == 1 { part.y } else { 1.0 - part.y };
        sum += rgb * rgb * (along * up);
    }
    sum
}

/// sRGB's numbers, 0 to 1, as linear light.
fn decode(srgb: Vec3) -> Vec3 {
    srgb.map(|v| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) })
}

/// Share of the sky at `p`, as the columns just below the surface say it; between their middles, a mean.
fn open_sky(scene: &SceneRef<'_>, node: &DrawNode, p: Vec3, normal: Vec3, gathered: &mut Gathered) -> f32 {
    let below = p - Vec3::from(node.corner) - normal * (0.5 * node.cell_m);
    let at = below.xy() / node.cell_m + halves(node.leaf_offset) / PLACES - 0.5;
    let z = below.z / node.z_step_m;
    let corner = at.floor();
    let part = at - corner;
    let (mut sum, mut weights) = (0.0, 0.0);
    for k in 0..4 {
        let step = IVec2::new(k & 1, k >> 1);
        let cell = (corner.as_ivec2() + step).clamp(IVec2::ZERO, IVec2::splat(NODE_CELLS as i32 - 1));
        let along = if step.x == 1 { part.x } else { 1.0 - part.x };
        let up = if step.y == 1 { part.y } else { 1.0 - part.y };
        let told = column_sky(scene, node, cell, z, normal.z, gathered);
        let weight = (along * up + 1e-4) * told.y;
        sum += told.x * weight;
        weights += weight;
    }
    if weights > 0.0 { sum / weights } else { UNKNOWN_AO }
}

/// Share of the sky that a column sees at height `z`, and how much it tells: nothing of what is far above or below.
fn column_sky(
    scene: &SceneRef<'_>,
    node: &DrawNode,
    cell: IVec2,
    z: f32,
    upwards: f32,
    gathered: &mut Gathered,
) -> Vec2 {
    let i = cell.y as u32 * NODE_CELLS as u32 + cell.x as u32;
    let page = |plane: usize| node.page(plane) * crate::layout::PAGE_WORDS as u32;
    let walk = mesh_word(scene, gathered, page(0) + i);
    let flags = (walk >> 24) as u8;
    let exposed = flags & flag::EXPOSED != 0;
    let strip = if exposed { mesh_word(scene, gathered, page(3) + i) + head_words(flags) as u32 } else { 0 };
    let bounds = if flags & flag::GAP != 0 { mesh_word(scene, gathered, strip.wrapping_sub(1)) } else { walk };
    let (z_max, z_min) = ((bounds & 0xfff) as f32, (bounds >> 12 & 0xfff) as f32);
    let codes = (16 >> node.z_shift()) as f32;
    if flags & flag::OCCUPIED == 0 || z > z_max + 1.5 * codes || z < z_min - 1.5 * codes {
        return Vec2::ZERO;
    }
    let sky = |texel: u32| (texel >> 26) as f32 / 63.0;
    if !exposed || upwards > 0.7 && z > z_max - 1.5 * codes {
        // Walls tell nothing of a roof, and it tells little of them: they see half of what it does.
        let near = z > z_max - 1.5 * codes;
        let told = if upwards > 0.7 { Vec2::ONE } else { Vec2::new(0.5, ROOF_OF_WALL) };
        return if near { Vec2::new(sky(mesh_word(scene, gathered, page(1) + i)), 1.0) * told } else { Vec2::ZERO };
    }
    let first = (z_min / codes).floor();
    let rows = ((z_max - 1.0) / codes).floor() - first;
    let row = (z / codes - 0.5 - first).clamp(0.0, rows);
    let low = row.floor();
    let a = mesh_word(scene, gathered, strip + low as u32);
    let b = mesh_word(scene, gathered, strip + (low + 1.0).min(rows) as u32);
    let weights =
        Vec2::new(1.0 - (row - low), row - low) * Vec2::new(f32::from(a >> 24 & 3 != 0), f32::from(b >> 24 & 3 != 0));
    let weight = weights.x + weights.y;
    if weight > 0.0 { Vec2::new((sky(a) * weights.x + sky(b) * weights.y) / weight, 1.0) } else { Vec2::ZERO }
}
