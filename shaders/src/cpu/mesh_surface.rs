//! Texture and ambient occlusion of a mesh's surface. GPU twin: `mesh_surface.wgsl`.
//!
//! A mesh has no ambient occlusion of its own: it takes that of the columns that it replaces, so that neither of the
//! two is darker than the other.

use super::column::bounds_of;
use super::node::{column_word, planes_of};
use super::ray::Ray;
use super::words::{ao_of, codes_per_row, flags_of, halves, is_open};
use crate::layout::{ADDED_LEVEL, DrawNode, ROOF_PLANE, STRIP_PLANE, WALK_PLANE};
use crate::mesh::{LEAF_OFFSET_STEPS, LEVELS_MASK, TEXTURE_TILE_PX};
use crate::pack::head_words;
use crate::srgb::linear_of_srgb;
use glam::{IVec2, Vec2, Vec3, Vec3Swizzles};
use insula_protocol::NODE_CELLS;
use insula_protocol::blockmap::flag;
use insula_protocol::texel::AO_MAX;

/// Share of the sky where no column is near.
pub(crate) const UNKNOWN_AO: f32 = 0.7;
/// Share of the sky inside of a building, whose columns only know how its outside is lit.
pub(crate) const INSIDE_AO: f32 = 0.3;
/// Weight of a roof's occlusion for a wall below its edge, where the wall's own columns store none.
pub(crate) const ROOF_WEIGHT_ON_WALL: f32 = 0.02;
/// Least z of the normal of a surface that counts as a roof.
pub(crate) const ROOF_NORMAL_Z: f32 = 0.7;

/// Linear RGB of a texture at `uv`, blended between the two levels nearest to `wanted`.
pub(super) fn sample_texture(ray: &mut Ray<'_>, info: [u32; 4], uv: Vec2, wanted: f32) -> Vec3 {
    let levels = (info[2] & LEVELS_MASK).max(1);
    let level = wanted.min((levels - 1) as f32);
    let fine = level.floor() as u32;
    let mut table = info[3];
    for k in 0..fine {
        table += tiles_of_level(info[1], k);
    }
    let squared = bilinear(ray, info[1], table, fine, uv);
    let coarse = (fine + 1).min(levels - 1);
    let coarse_table = if coarse > fine { table + tiles_of_level(info[1], fine) } else { table };
    let coarser = bilinear(ray, info[1], coarse_table, coarse, uv);
    let mean = squared + (coarser - squared) * (level - fine as f32);
    mean.max(Vec3::ZERO).map(|v| linear_of_srgb(v.sqrt()))
}

/// Width and height of a level, in texels.
fn level_size(size: u32, level: u32) -> [u32; 2] {
    [((size & 0xffff) >> level).max(1), (size >> 16 >> level).max(1)]
}

fn tiles_of_level(size: u32, level: u32) -> u32 {
    let [width, height] = level_size(size, level);
    width.div_ceil(TEXTURE_TILE_PX) * height.div_ceil(TEXTURE_TILE_PX)
}

/// Mean of the squares of the four texels around `uv`: squares of sRGB values are close to linear light.
fn bilinear(ray: &mut Ray<'_>, size: u32, table: u32, level: u32, uv: Vec2) -> Vec3 {
    let [width, height] = level_size(size, level);
    let last = IVec2::new(width as i32 - 1, height as i32 - 1);
    let at = uv * Vec2::new(width as f32, height as f32) - 0.5;
    let corner = at.floor();
    let part = at - corner;
    let mut sum = Vec3::ZERO;
    for k in 0..4 {
        let step = IVec2::new(k & 1, k >> 1);
        let p = (corner.as_ivec2() + step).clamp(IVec2::ZERO, last).as_uvec2();
        let tile = table + p.y / TEXTURE_TILE_PX * width.div_ceil(TEXTURE_TILE_PX) + p.x / TEXTURE_TILE_PX;
        let first = ray.read_word(tile as usize);
        let row = p.y % TEXTURE_TILE_PX * width.min(TEXTURE_TILE_PX);
        let texel = ray.read_word((first + row + p.x % TEXTURE_TILE_PX) as usize);
        let rgb = Vec3::new((texel & 255) as f32, (texel >> 8 & 255) as f32, (texel >> 16 & 255) as f32) / 255.0;
        sum += rgb * rgb * bilinear_weight(part, step);
    }
    sum
}

/// Weight of the neighbour at `step` (0 or 1 along each axis) for a point `part` of the way to the last one.
fn bilinear_weight(part: Vec2, step: IVec2) -> f32 {
    let along = if step.x == 1 { part.x } else { 1.0 - part.x };
    let up = if step.y == 1 { part.y } else { 1.0 - part.y };
    along * up
}

/// What the columns around a mesh's surface know of it.
pub(super) struct SurfaceLight {
    /// Share of the sky that is visible.
    pub(super) sky: f32,
    /// Whether it is water or glass.
    pub(super) is_reflective: bool,
}

/// Share of the sky at `p`: a weighted mean of what the four columns just below the surface store. The nearest of them says
/// whether it is reflective.
pub(super) fn surface_light(ray: &mut Ray<'_>, node: &DrawNode, p: Vec3, normal: Vec3) -> SurfaceLight {
    let below = p - Vec3::from(node.corner) - normal * (0.5 * node.cell_m);
    let at = below.xy() / node.cell_m + halves(node.leaf_offset) / LEAF_OFFSET_STEPS - 0.5;
    let z = below.z / node.z_step_m;
    let corner = at.floor();
    let part = at - corner;
    let (mut sum, mut weights) = (0.0, 0.0);
    let within = |cell: IVec2| cell.clamp(IVec2::ZERO, IVec2::splat(NODE_CELLS as i32 - 1));
    for k in 0..4 {
        let step = IVec2::new(k & 1, k >> 1);
        let cell = within(corner.as_ivec2() + step);
        let sky = column_sky(ray, node, cell, z, normal.z);
        let weight = (bilinear_weight(part, step) + 1e-4) * sky.y;
        sum += sky.x * weight;
        weights += weight;
    }
    let nearest = within((at + 0.5).floor().as_ivec2());
    let walk = ray.read_word(planes_of(node)[WALK_PLANE] + nearest.y as usize * NODE_CELLS + nearest.x as usize);
    SurfaceLight {
        sky: if weights > 0.0 { sum / weights } else { unknown_sky(node, normal.z) },
        is_reflective: flags_of(walk) & flag::REFLECTIVE != 0,
    }
}

/// Share of the sky of a surface where no column is near.
fn unknown_sky(node: &DrawNode, upwards: f32) -> f32 {
    if node.level == ADDED_LEVEL { 0.5 + 0.5 * upwards } else { UNKNOWN_AO }
}

/// Whether the place in front of a surface is within a column's solid: rays that see the surface from behind look at it
/// from inside of a building.
pub(super) fn is_inside(ray: &mut Ray<'_>, node: &DrawNode, p: Vec3, normal: Vec3) -> bool {
    let before = p - Vec3::from(node.corner) + normal * node.cell_m;
    let z = before.z / node.z_step_m;
    ray.counts.fetches += 1;
    let walk = column_word(ray.scene, node, before);
    let flags = flags_of(walk);
    // A gap may be in front of the surface.
    if flags & flag::OCCUPIED == 0 || flags & flag::GAP != 0 {
        return false;
    }
    let [z_max, z_min] = bounds_of(ray, walk, 0);
    z > z_min && z < z_max
}

/// Share of the sky that a column sees at height `z`, and the weight of that: 0 far above or below the column.
fn column_sky(ray: &mut Ray<'_>, node: &DrawNode, cell: IVec2, z: f32, upwards: f32) -> Vec2 {
    let i = cell.y as usize * NODE_CELLS + cell.x as usize;
    let planes = planes_of(node);
    let walk = ray.read_word(planes[WALK_PLANE] + i);
    let flags = flags_of(walk);
    let exposed = flags & flag::EXPOSED != 0;
    let texels = if exposed { ray.read_word(planes[STRIP_PLANE] + i) as usize + head_words(flags) } else { 0 };
    let [z_max, z_min] = bounds_of(ray, walk, texels);
    let codes = codes_per_row(node.z_shift());
    if flags & flag::OCCUPIED == 0 || z > z_max + 1.5 * codes || z < z_min - 1.5 * codes {
        return Vec2::ZERO;
    }
    let ao = |texel: u32| ao_of(texel) / f32::from(AO_MAX);
    let near_top = z > z_max - 1.5 * codes;
    if !exposed || upwards > ROOF_NORMAL_Z && near_top {
        if !near_top {
            return Vec2::ZERO;
        }
        // The occlusion of walls does not apply to roofs. That of a roof applies to walls with a small weight, and
        // halved, because walls see half of the sky.
        let known = if upwards > ROOF_NORMAL_Z { Vec2::ONE } else { Vec2::new(0.5, ROOF_WEIGHT_ON_WALL) };
        return Vec2::new(ao(ray.read_word(planes[ROOF_PLANE] + i)), 1.0) * known;
    }
    let first = (z_min / codes).floor();
    let rows = ((z_max - 1.0) / codes).floor() - first;
    let row = (z / codes - 0.5 - first).clamp(0.0, rows);
    let low = row.floor();
    let a = ray.read_word(texels + low as usize);
    let b = ray.read_word(texels + (low + 1.0).min(rows) as usize);
    let covered = Vec2::new(f32::from(!is_open(a)), f32::from(!is_open(b)));
    let weights = Vec2::new(1.0 - (row - low), row - low) * covered;
    let weight = weights.x + weights.y;
    if weight > 0.0 { Vec2::new((ao(a) * weights.x + ao(b) * weights.y) / weight, 1.0) } else { Vec2::ZERO }
}
