//! What a ray meets in a column (Vacca 2008, 3.5; design 6): its solids, their strips, their holes.
//!
//! In: a cell that a ray crosses, from where to where. Out: what it gathers there. Next: `raycast` goes on, or is done.
//!
//! Functions bear the names that they have in `column.wgsl` and stand in the same order, but that `column` is there in two:
//! `meets` finds a solid, `hit_solid` gathers it, and the loop around them is the walk's.

use super::{
    machine::{floor, least, most},
    raycast::{Gathered, NodeRay, OPAQUE, SUN_LIFT_CELLS, SceneRef, ahead},
    shade::linear_of,
};
use crate::{
    layout::PAGE_WORDS,
    pack::{CONCAVE, CORNER, head_words, slope_codes},
};
use glam::{IVec2, Vec2, Vec3, Vec3Swizzles};
use insula_protocol::{
    NODE_CELLS,
    blockmap::{CLIP_STEPS_PER_CELL, flag},
    octahedral,
};

/// Where a ray is inside a solid: from `s` to `e`, entered through `face`.
#[derive(Clone, Copy)]
struct Span {
    s: f32,
    e: f32,
    face: Face,
}

#[derive(Clone, Copy, PartialEq)]
enum Face {
    Side,
    Top,
    Bottom,
}

fn word(scene: &SceneRef<'_>, gathered: &mut Gathered, page: u32, i: usize) -> u32 {
    gathered.counts.fetches += 1;
    scene.atlas.get(page as usize * PAGE_WORDS + i).copied().unwrap_or(0)
}

/// What stands in a cell, as `column` reads it from the atlas.
struct Column {
    cell: IVec2,
    i: usize,
    flags: u8,
    z_min: f32,
    attributes: u32,
    /// Words of its strip, the first of which are those of [`head_words`].
    strip: usize,
}

/// One of the solids of a column, between these heights.
#[derive(Clone, Copy, PartialEq)]
enum Solid {
    /// The only one, or the upper of two: its top is the roof.
    Upper,
    /// Below the gap.
    Lower,
    /// Beyond the plane that clips the column.
    Outer,
}

/// Whether the ray may be in a solid somewhere in the cell, by one word alone. `quad_top` is at least as high as whatever
/// inclined column is here.
fn may_hit(walk: u32, [lower, upper]: [f32; 2], quad_top: f32) -> bool {
    let flags = (walk >> 24) as u8;
    let (high, low) = ((walk & 0xfff) as f32, (walk >> 12 & 0xfff) as f32);
    if flags & flag::OCCUPIED == 0 {
        return false;
    }
    if flags & flag::GAP != 0 {
        return lower <= low || upper >= high;
    }
    let highest = if flags & flag::INCLINED != 0 { quad_top } else { high };
    lower <= highest && upper >= low
}

/// A column's highest and lowest point.
fn bounds_of(scene: &SceneRef<'_>, walk: u32, strip: usize, gathered: &mut Gathered) -> [f32; 2] {
    let flags = (walk >> 24) as u8;
    let has_gap = flags & flag::GAP != 0;
    let bounds = if has_gap { word(scene, gathered, 0, strip + head_words(flags) - 1) } else { walk };
    [(bounds & 0xfff) as f32, (bounds >> 12 & 0xfff) as f32]
}

/// Gathers what the ray meets in a cell between `ta` and `te`.
pub(super) fn column(
    scene: &SceneRef<'_>,
    ray: &NodeRay<'_>,
    cell: IVec2,
    [ta, te]: [f32; 2],
    quad_top: f32,
    gathered: &mut Gathered,
) {
    let i = cell.y as usize * NODE_CELLS + cell.x as usize;
    let walk = word(scene, gathered, ray.node.page(0), i);
    let flags = (walk >> 24) as u8;
    let z = |t: f32| ray.o.z + ray.d.z * t;
    if !may_hit(walk, [least(z(ta), z(te)), most(z(ta), z(te))], quad_top) {
        return;
    }
    let centre = cell.as_vec2() + 0.5;
    let attributes = word(scene, gathered, ray.node.page(2), i);
    let mut slope = Vec2::ZERO;
    if flags & flag::INCLINED != 0 {
        slope = Vec2::from(slope_codes(attributes as u16, ray.node.z_shift()));
    }
    let strip = if flags & flag::EXPOSED != 0 { word(scene, gathered, ray.node.page(3), i) as usize } else { 0 };
    let bounds = bounds_of(scene, walk, strip, gathered);
    let [z_max, z_min] = bounds;
    let top = |t: f32| z_max + slope.dot(ray.o.xy() + ray.d.xy() * t - centre);
    let clip = if flags & flag::CLIPPED != 0 { word(scene, gathered, 0, strip) } else { 0 };
    let border = if flags & flag::CLIPPED != 0 {
        border(ray, attributes, clip, centre, ta, te)
    } else {
        Border { from: ta, to: te, within_is_outer: false, normals: [attributes >> 16 & 255; 3] }
    };
    let outer_top = (clip & 0xfff) as f32;
    let gap = flags & flag::GAP != 0;
    let gap_word = if gap { word(scene, gathered, 0, strip + head_words(flags) - 2) } else { 0 };
    let (low, high) = ((gap_word & 0xffff) as f32, (gap_word >> 16) as f32);
    let column = Column { cell, i, flags, z_min, attributes, strip };
    // Before, within and behind the border's part of the ray, and in each the solids in the ray's order.
    for n in 0..6 {
        let (part, second) = (n >> 1, n & 1 == 1);
        let outer = (part == 1) == border.within_is_outer;
        let lower = second != (ray.d.z > 0.0);
        let solid = match (outer, lower) {
            (true, _) => Solid::Outer,
            (false, true) => Solid::Lower,
            (false, false) => Solid::Upper,
        };
        let (s, e) = [(ta, border.from), (border.from, border.to), (border.to, te)][part];
        let missing = match solid {
            Solid::Outer => second || outer_top == 0.0,
            Solid::Lower => !gap,
            Solid::Upper => false,
        };
        if missing || s >= e {
            continue;
        }
        let bottom = if solid == Solid::Upper && gap { high } else { z_min };
        let (over, bounds) = match solid {
            Solid::Upper => ([z(s) - top(s), z(e) - top(e)], [bottom, z_max]),
            Solid::Lower => ([z(s) - low, z(e) - low], [bottom, low]),
            Solid::Outer => ([z(s) - outer_top, z(e) - outer_top], [bottom, outer_top]),
        };
        let span = clip_solid(s, e, over, [z(s) - bottom, z(e) - bottom]);
        hit_solid(scene, ray, &column, solid, border.normals[part], span, bounds, gathered);
    }
}

/// How a clipped column parts a ray: between `from` and `to` it is on one side of the column's border, else on the other.
struct Border {
    from: f32,
    to: f32,
    /// Whether what is between is beyond the border.
    within_is_outer: bool,
    /// Azimuths of the walls through which the ray gets into the part before, within and behind.
    normals: [u32; 3],
}

/// Inside one plane or both of a convex corner a ray is for one part of its way, and so it is beyond both of a concave one.
fn border(ray: &NodeRay<'_>, attributes: u32, clip_word: u32, centre: Vec2, ta: f32, te: f32) -> Border {
    let first = attributes >> 16 & 255;
    let concave = clip_word & CONCAVE != 0;
    let side = if concave { -1.0 } else { 1.0 };
    let mut border = Border { from: ta, to: te, within_is_outer: concave, normals: [first; 3] };
    for (k, word) in [attributes, clip_word].into_iter().enumerate() {
        if k == 1 && clip_word & CORNER == 0 {
            break;
        }
        let turn = word >> 16 & 255;
        let offset = (word as i32 >> 24) as f32 / CLIP_STEPS_PER_CELL as f32;
        let n = azimuth(turn);
        let beyond = |t: f32| side * (n.dot(ray.o.xy() + ray.d.xy() * t - centre) - offset);
        let (a, b) = (beyond(ta), beyond(te));
        let through = ta + (te - ta) * (a / (a - b));
        if a > 0.0 && b > 0.0 {
            border.from = te;
        } else if a > 0.0 && through > border.from {
            border.from = through;
            border.normals[1] = turn;
        } else if b > 0.0 && a <= 0.0 && through < border.to {
            border.to = through;
            border.normals[2] = turn;
        }
    }
    // Never within: all of the ray is on the other side, and comes in through the cell's face.
    if border.from >= border.to {
        (border.from, border.to) = (te, te);
    }
    border
}

/// The part of `ta..te` below the top (`over` <= 0) and above the bottom (`above` >= 0); both are linear along the ray and
/// given at its two ends. Empty if `s > e`.
fn clip_solid(ta: f32, te: f32, over: [f32; 2], above: [f32; 2]) -> Span {
    const NONE: Span = Span { s: 1.0, e: 0.0, face: Face::Side };
    let mut span = Span { s: ta, e: te, face: Face::Side };
    if over[0] > 0.0 {
        if over[1] > 0.0 {
            return NONE;
        }
        span.s = ta + (te - ta) * (over[0] / (over[0] - over[1]));
        span.face = Face::Top;
    } else if over[1] > 0.0 {
        span.e = ta + (te - ta) * (over[0] / (over[0] - over[1]));
    }
    if above[0] < 0.0 {
        if above[1] < 0.0 {
            return NONE;
        }
        let s = ta + (te - ta) * (above[0] / (above[0] - above[1]));
        if s > span.s {
            span.s = s;
            span.face = Face::Bottom;
        }
    } else if above[1] < 0.0 {
        span.e = least(span.e, ta + (te - ta) * (above[0] / (above[0] - above[1])));
    }
    span
}

/// Gathers what a solid shows at the start of `span`, and behind its transparent texels. `wall` is the azimuth of the wall
/// through which the ray comes in, if it does not come in through the cell's face.
#[allow(clippy::too_many_arguments)] // One call in WGSL too; a struct for it would only rename them.
fn hit_solid(
    scene: &SceneRef<'_>,
    ray: &NodeRay<'_>,
    column: &Column,
    solid: Solid,
    wall: u32,
    span: Span,
    bounds: [f32; 2],
    gathered: &mut Gathered,
) {
    // Who stands inside a column (a wall nearer than half a cell) looks out of it.
    let inside = span.s <= 0.0 && span.face == Face::Side;
    if span.s >= span.e || inside || gathered.left <= OPAQUE {
        return;
    }
    let Column { cell, i, flags, z_min, attributes, .. } = *column;
    let roof_normal = Vec3::from(octahedral::decode(attributes as u16));
    let flat_normal = if span.face == Face::Bottom { Vec3::NEG_Z } else { Vec3::Z };
    let (mut texel, mut normal) = (0, flat_normal);
    let mut rows = false;
    if solid == Solid::Outer {
        texel = word(scene, gathered, 0, column.strip + 1) | 3 << 24;
        if span.face == Face::Side {
            normal = face_normal(ray, cell);
        }
    } else if solid == Solid::Upper && span.face == Face::Top {
        texel = word(scene, gathered, ray.node.page(1), i) | 3 << 24;
        normal = roof_normal;
    } else if flags & flag::EXPOSED != 0 {
        rows = true;
    } else if span.face == Face::Side
        && let Some(wall) = beside(scene, ray, cell, span.s, gathered)
    {
        (texel, normal) = wall;
    } else {
        texel = word(scene, gathered, ray.node.page(1), i) | 3 << 24;
        normal = if span.face == Face::Bottom { Vec3::NEG_Z } else { roof_normal };
        if normal.dot(ray.leg.dir) >= 0.0 {
            normal = face_normal(ray, cell);
        }
    }
    let strip = (column.strip + head_words(flags)) as u32;
    let codes = (16 >> ray.node.z_shift()) as f32;
    let first = floor(z_min / codes);
    let (row_low, row_high) = (floor(bounds[0] / codes), floor((bounds[1] - 1.0) / codes));
    let mut row = floor((ray.o.z + ray.d.z * span.s) / codes).clamp(row_low, row_high);
    let up = ray.d.z > 0.0;
    let mut s = span.s;
    if rows && span.face == Face::Side {
        normal = wall_normal(ray, cell, wall);
    }
    for _ in 0..256 {
        if rows {
            texel = word(scene, gathered, 0, (strip as i32 + row - first) as usize);
        }
        gather(ray, s, texel, normal, flags, gathered);
        if !rows || gathered.left <= OPAQUE || flags & flag::HOLES == 0 {
            return;
        }
        s = ((row + i32::from(up)) as f32 * codes - ray.o.z) / ray.d.z;
        normal = if up { Vec3::NEG_Z } else { Vec3::Z };
        row += if up { 1 } else { -1 };
        if s > span.e || row < row_low || row > row_high {
            return;
        }
    }
}

/// What the wall looks like through whose column the ray came into one that has none, if there is such a wall at this height:
/// between the planes of two clipped columns of a wall, a ray may pass to what stands behind them.
fn beside(
    scene: &SceneRef<'_>,
    ray: &NodeRay<'_>,
    cell: IVec2,
    t: f32,
    gathered: &mut Gathered,
) -> Option<(u32, Vec3)> {
    let before = cell + face_normal(ray, cell).xy().as_ivec2();
    if before.min_element() < 0 || before.max_element() >= NODE_CELLS as i32 {
        return None;
    }
    let i = before.y as usize * NODE_CELLS + before.x as usize;
    let walk = word(scene, gathered, ray.node.page(0), i);
    let (flags, z) = ((walk >> 24) as u8, ray.o.z + ray.d.z * t);
    if flags & flag::EXPOSED == 0 {
        return None;
    }
    let strip = word(scene, gathered, ray.node.page(3), i) as usize;
    let [z_max, z_min] = bounds_of(scene, walk, strip, gathered);
    if z < z_min || z >= z_max {
        return None;
    }
    let codes = (16 >> ray.node.z_shift()) as f32;
    let row = (floor(z / codes) - floor(z_min / codes)) as usize;
    let strip = strip + head_words(flags);
    let texel = word(scene, gathered, 0, strip + row);
    let attributes = word(scene, gathered, ray.node.page(2), i);
    (texel >> 24 & 3 != 0).then(|| (texel | 3 << 24, wall_normal(ray, cell, attributes >> 16 & 255)))
}

/// Horizontal unit vector, 256 azimuths to a turn.
fn azimuth(turn: u32) -> Vec2 {
    Vec2::from_angle(turn as f32 * (std::f32::consts::TAU / 256.0))
}

fn wall_normal(ray: &NodeRay<'_>, cell: IVec2, wall: u32) -> Vec3 {
    let normal = azimuth(wall).extend(0.0);
    if normal.dot(ray.leg.dir) < 0.0 { normal } else { face_normal(ray, cell) }
}

/// Normal of the cell's face through which the ray came in.
fn face_normal(ray: &NodeRay<'_>, cell: IVec2) -> Vec3 {
    let ahead = ahead(ray.d.xy());
    let near = (cell.as_vec2() + 1.0 - ahead - ray.o.xy()) * ray.inv;
    if near.x >= near.y { Vec3::new(1.0 - 2.0 * ahead.x, 0.0, 0.0) } else { Vec3::new(0.0, 1.0 - 2.0 * ahead.y, 0.0) }
}

/// Adds what of a texel is seen to what was seen before it. It is lit once, when all is there.
fn gather(ray: &NodeRay<'_>, t: f32, texel: u32, normal: Vec3, flags: u8, gathered: &mut Gathered) {
    let alpha = (texel >> 24 & 3) as f32 / 3.0;
    let (before, share) = (gathered.left, gathered.left * alpha);
    gathered.left *= 1.0 - alpha;
    if ray.leg.to_sun {
        return;
    }
    gathered.albedo += linear_of(texel) * share;
    gathered.ao += (texel >> 26) as f32 / 63.0 * share;
    gathered.normal += normal * share;
    gathered.mean_m += t * share;
    if share > 0.0 && before > 0.5 {
        (gathered.flags, gathered.level) = (u32::from(flags), ray.node.level);
        if gathered.left <= 0.5 {
            gathered.distance_m = t;
            gathered.node = ray.index;
            gathered.sun_from = ray.leg.dir * t + normal * (ray.node.cell_m * SUN_LIFT_CELLS);
        }
    }
}
