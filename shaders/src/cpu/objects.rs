//! Objects of what a ray hits: their words in palettes. GPU twin: `objects.wgsl`.

use super::column::{ColumnSolid, ColumnVisit, FoundSolid, SolidFace};
use super::ray::Ray;
use super::shade::linear_of;
use crate::layout::{OBJECT_BITS, PAGE_WORDS, PALETTE_COLOURED, PALETTE_HIDDEN};
use glam::Vec3;

/// Address of the palette word of a solid's object; 0 if it has none, or if the frame does not need objects.
pub(super) fn object_of_solid(ray: &mut Ray<'_>, column: &ColumnVisit, found: &FoundSolid) -> u32 {
    if ray.scene.frame.objects == 0 {
        return 0;
    }
    let Some(node) = ray.scene.nodes.get(ray.node.index as usize).filter(|node| node.palette != 0) else { return 0 };
    let word = ray.read_word(node.object_page as usize * PAGE_WORDS + column.i);
    let mask = (1 << OBJECT_BITS) - 1;
    let (roof, wall, lower) = (word & mask, word >> OBJECT_BITS & mask, word >> (2 * OBJECT_BITS));
    let is_lower_top = found.solid == ColumnSolid::Lower && found.span.face == SolidFace::Top;
    let place = if found.solid == ColumnSolid::Outer || is_lower_top {
        lower
    } else if found.solid == ColumnSolid::Upper && found.span.face == SolidFace::Top || wall == 0 {
        roof
    } else {
        wall
    };
    if place == 0 { 0 } else { node.palette + place - 1 }
}

/// Address of the palette word of the triangle at `at` (in vec4s) of a mesh; 0 if it has none, or if the frame does not need objects.
pub(super) fn object_of_triangle(ray: &mut Ray<'_>, at: u32, palette: u32) -> u32 {
    if ray.scene.frame.objects == 0 || palette == 0 {
        return 0;
    }
    let place = ray.read_vec4(at + 1)[0] >> 16;
    if place == 0 { 0 } else { palette + place - 1 }
}

/// Whether rays pass through an object.
pub(super) fn is_hidden(ray: &mut Ray<'_>, object: u32) -> bool {
    object != 0 && ray.read_word(object as usize) & PALETTE_HIDDEN != 0
}

/// The colour that an object has instead of `albedo`, linear RGB.
pub(super) fn object_colour(ray: &mut Ray<'_>, object: u32, albedo: Vec3) -> Vec3 {
    if object == 0 {
        return albedo;
    }
    let word = ray.read_word(object as usize);
    if word & PALETTE_COLOURED != 0 { linear_of(word) } else { albedo }
}
