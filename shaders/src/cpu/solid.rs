//! Surfaces of a solid that a ray hits: roof, wall strip, and surfaces behind the strip's holes. GPU twin:
//! `solid.wgsl`.
//!
//! On the CPU, `adjacent_wall` returns a texel and its normal. On the GPU it returns the texel's address, and
//! `hit_solid` reads it.

use super::column::{ColumnSolid, ColumnVisit, FoundSolid, SolidFace, bounds_of};
use super::fast_math::{ahead_of, floor};
use super::objects::{is_hidden, object_colour, object_of_solid};
use super::ray::{NodeRay, Ray, RayHit, SUN_LIFT_CELLS};
use super::shade::linear_of;
use super::words::{
    ao_of, azimuth_direction, azimuth_of, codes_per_row, flags_of, hits_share, is_open, is_thin, thin_share,
};
use crate::layout::{ATTRIBUTE_PLANE, ROOF_PLANE, STRIP_PLANE, WALK_PLANE};
use crate::pack::head_words;
use glam::{IVec2, Vec3, Vec3Swizzles};
use insula_protocol::blockmap::flag;
use insula_protocol::texel::AO_MAX;
use insula_protocol::{NODE_CELLS, octahedral};

/// Most rows of a strip: a guard, as no strip has more.
pub(crate) const MAX_STRIP_ROWS: i32 = 256;

/// Hits the first opaque texel of a solid that the ray meets, if there is one.
#[inline]
pub(super) fn hit_solid(ray: &mut Ray<'_>, column: &ColumnVisit, found: &FoundSolid) {
    let (cell, flags, span) = (column.cell, column.flags, found.span);
    let object = object_of_solid(ray, column, found);
    if is_hidden(ray, object) {
        return;
    }
    let side = span.face == SolidFace::Side;
    let thin = is_thin(flags, column.attributes) && found.solid == ColumnSolid::Upper;
    if thin && !hits_share(thin_share(column.attributes, side), ray.threshold, column.i as u32) {
        return;
    }
    let roof_normal = if thin { Vec3::Z } else { Vec3::from(octahedral::decode(column.attributes as u16)) };
    let flat_normal = if span.face == SolidFace::Bottom { Vec3::NEG_Z } else { Vec3::Z };
    let (mut texel, mut normal) = (0, flat_normal);
    let (mut has_rows, mut below_top) = (false, 0.0);
    if found.solid == ColumnSolid::Outer {
        texel = ray.read_word(column.strip + 1);
        if side {
            normal = face_normal(&ray.node, cell);
        }
    } else if found.solid == ColumnSolid::Upper && span.face == SolidFace::Top {
        texel = ray.read_plane(ROOF_PLANE, column.i);
        normal = roof_normal;
    } else if flags & flag::EXPOSED != 0 {
        has_rows = true;
        if side {
            normal = wall_normal(ray, cell, found.wall);
        }
    } else if side && let Some(wall) = adjacent_wall(ray, cell, span.s) {
        (texel, normal) = wall;
    } else {
        texel = ray.read_plane(ROOF_PLANE, column.i);
        normal = if span.face == SolidFace::Bottom { Vec3::NEG_Z } else { roof_normal };
        if normal.dot(ray.segment.dir) >= 0.0 {
            normal = face_normal(&ray.node, cell);
        } else if side {
            // It shows its top, and has the light of that: between blocks, where one is a little higher, the sun would not reach it.
            below_top = (found.top - ray.node.z_at(span.s)).max(0.0);
        }
    }
    let codes = codes_per_row(ray.node.z_shift);
    let first = (column.strip + head_words(flags)) as i32 - floor(column.z_min / codes);
    let (row_low, row_high) = (floor(found.bottom / codes), floor((found.top - 1.0) / codes));
    let mut row = floor(ray.node.z_at(span.s) / codes).clamp(row_low, row_high);
    let up = ray.node.d.z > 0.0;
    let mut s = span.s;
    for _ in 0..MAX_STRIP_ROWS {
        if has_rows {
            texel = ray.read_word((first + row) as usize);
        }
        if !has_rows || !is_open(texel) {
            return hit_texel(ray, s, texel, (normal, below_top), flags, object);
        }
        s = ((row + i32::from(up)) as f32 * codes - ray.node.o.z) / ray.node.d.z;
        normal = if up { Vec3::NEG_Z } else { Vec3::Z };
        row += if up { 1 } else { -1 };
        if s > span.e || row < row_low || row > row_high {
            return;
        }
    }
}

/// Texel and normal of the wall of the column in front of `cell`, if it has one at `t`. Between the planes of two
/// clipped columns of one wall, a ray may reach the column behind them: it shows the wall that the ray slipped through.
fn adjacent_wall(ray: &mut Ray<'_>, cell: IVec2, t: f32) -> Option<(u32, Vec3)> {
    let before = cell + face_normal(&ray.node, cell).xy().as_ivec2();
    if before.min_element() < 0 || before.max_element() >= NODE_CELLS as i32 {
        return None;
    }
    let i = before.y as usize * NODE_CELLS + before.x as usize;
    let walk = ray.read_plane(WALK_PLANE, i);
    let (flags, z) = (flags_of(walk), ray.node.z_at(t));
    if flags & flag::EXPOSED == 0 {
        return None;
    }
    let strip = ray.read_plane(STRIP_PLANE, i) as usize + head_words(flags);
    let [z_max, z_min] = bounds_of(ray, walk, strip);
    if z < z_min || z >= z_max {
        return None;
    }
    let codes = codes_per_row(ray.node.z_shift);
    let texel = ray.read_word(strip + (floor(z / codes) - floor(z_min / codes)) as usize);
    let attributes = ray.read_plane(ATTRIBUTE_PLANE, i);
    (!is_open(texel) && !is_thin(flags, attributes)).then(|| (texel, wall_normal(ray, cell, azimuth_of(attributes))))
}

/// Normal of a wall that the ray enters from outside, else of the cell's face.
fn wall_normal(ray: &Ray<'_>, cell: IVec2, wall: u32) -> Vec3 {
    let normal = azimuth_direction(wall).extend(0.0);
    if normal.dot(ray.segment.dir) < 0.0 { normal } else { face_normal(&ray.node, cell) }
}

/// Normal of the cell's face through which the ray enters.
fn face_normal(node: &NodeRay, cell: IVec2) -> Vec3 {
    let ahead = ahead_of(node.d.xy());
    let near = (cell.as_vec2() + 1.0 - ahead - node.o.xy()) * node.inv;
    if near.x >= near.y { Vec3::new(1.0 - 2.0 * ahead.x, 0.0, 0.0) } else { Vec3::new(0.0, 1.0 - 2.0 * ahead.y, 0.0) }
}

/// Ends the segment at a texel with a normal, so many codes below the place whose sun it has. It is lit only once, when the ray has ended.
#[inline]
fn hit_texel(ray: &mut Ray<'_>, t: f32, texel: u32, (normal, below): (Vec3, f32), flags: u8, object: u32) {
    ray.hit.is_hit = true;
    if ray.segment.to_sun {
        return;
    }
    ray.hit = RayHit {
        is_hit: true,
        albedo: object_colour(ray, object, linear_of(texel)),
        ao: ao_of(texel) / f32::from(AO_MAX),
        normal,
        flags: u32::from(flags),
        level: ray.node.level,
        distance_m: t,
        node: ray.node.index,
        object,
        shadow_origin: ray.segment.dir * t
            + normal * (ray.node.cell_m * SUN_LIFT_CELLS)
            + Vec3::Z * (below * ray.segment.dir.z / ray.node.d.z),
        stone: 0,
        stone_point: Vec3::ZERO,
    };
}
