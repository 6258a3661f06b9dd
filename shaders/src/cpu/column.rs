//! Which of a column's solids a ray meets (Vacca 2008, 3.5). GPU twin: `column.wgsl`.
//!
//! On the CPU, [`ColumnVisit::read`] reads a column once. On the GPU, `meets` reads it again for each solid.

use super::fast_math::fast_min;
use super::ray::Ray;
use super::words::{azimuth_direction, azimuth_of, clip_offset_of, flags_of, halves, high_of, low_of};
use crate::layout::{ATTRIBUTE_PLANE, STRIP_PLANE, WALK_PLANE};
use crate::pack::{CLIP_CONCAVE, CLIP_CORNER, head_words, slope_codes};
use glam::{IVec2, Vec2, Vec3Swizzles};
use insula_protocol::NODE_CELLS;
use insula_protocol::blockmap::flag;

/// The face of a solid through which the ray enters.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) enum SolidFace {
    #[default]
    Side,
    Top,
    Bottom,
}

/// One of the solids of a column.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) enum ColumnSolid {
    /// The only one, or the upper of two: its top is the roof.
    #[default]
    Upper,
    /// Below the gap.
    Lower,
    /// Beyond the plane that clips the column.
    Outer,
}

/// The column that the walk is at.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ColumnVisit {
    pub(super) cell: IVec2,
    /// Number of the column in its node.
    pub(super) i: usize,
    pub(super) flags: u8,
    pub(super) attributes: u32,
    /// Word of its strip's head.
    pub(super) strip: usize,
    pub(super) z_min: f32,
    z_max: f32,
    /// Slope of the top, in height codes per cell.
    slope: Vec2,
    /// Bottom and top of the gap.
    gap: Vec2,
    /// Top of the solid beyond the plane; 0 without one.
    outer_top: f32,
    /// Where the ray enters and leaves the cell.
    ta: f32,
    te: f32,
    split: ClipSplit,
    /// The next of the solids in the ray's order.
    solid: usize,
}

/// The interval of the ray inside a solid: from `s` to `e`, entered through `face`. Empty if `s >= e`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SolidSpan {
    pub(super) s: f32,
    pub(super) e: f32,
    pub(super) face: SolidFace,
}

/// A solid that the ray meets.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct FoundSolid {
    pub(super) span: SolidSpan,
    pub(super) solid: ColumnSolid,
    /// Azimuth of the wall through which the ray enters, if not through the cell's face.
    pub(super) wall: u32,
    pub(super) bottom: f32,
    pub(super) top: f32,
}

/// How the planes of a clipped column split a ray: from `begin` to `end` it is on one side of them, else on the other.
#[derive(Debug, Clone, Copy, Default)]
struct ClipSplit {
    begin: f32,
    end: f32,
    within_is_outer: bool,
    /// Azimuths of the walls through which the ray enters the part before, within and behind.
    walls: [u32; 3],
}

/// The column's word, if it says that the ray may be in a solid somewhere in the cell. `quad_top` bounds the top of an
/// inclined column.
#[inline]
pub(super) fn may_hit(ray: &mut Ray<'_>, cell: IVec2, ta: f32, te: f32, quad_top: f32) -> Option<u32> {
    let walk = ray.read_plane(WALK_PLANE, cell.y as usize * NODE_CELLS + cell.x as usize);
    let flags = flags_of(walk);
    if flags & flag::OCCUPIED == 0 {
        return None;
    }
    let (high, low) = (high_of(walk), low_of(walk));
    let (lower_t, upper_t) = if ray.node.d.z > 0.0 { (ta, te) } else { (te, ta) };
    let (lower, upper) = (ray.node.z_at(lower_t), ray.node.z_at(upper_t));
    let may_hit = if flags & flag::GAP != 0 {
        lower <= low || upper >= high
    } else {
        lower <= if flags & flag::INCLINED != 0 { quad_top } else { high } && upper >= low
    };
    may_hit.then_some(walk)
}

impl ColumnVisit {
    /// Reads the column of a cell that the ray crosses from `ta` to `te`.
    #[inline]
    pub(super) fn read(ray: &mut Ray<'_>, cell: IVec2, ta: f32, te: f32, walk: u32) -> Self {
        let i = cell.y as usize * NODE_CELLS + cell.x as usize;
        let flags = flags_of(walk);
        let centre = cell.as_vec2() + 0.5;
        let attributes = ray.read_plane(ATTRIBUTE_PLANE, i);
        let mut slope = Vec2::ZERO;
        if flags & flag::INCLINED != 0 {
            slope = Vec2::from(slope_codes(attributes as u16, ray.node.z_shift));
        }
        let strip = if flags & flag::EXPOSED != 0 { ray.read_plane(STRIP_PLANE, i) as usize } else { 0 };
        let [z_max, z_min] = bounds_of(ray, walk, strip + head_words(flags));
        let clip = if flags & flag::CLIPPED != 0 { ray.read_word(strip) } else { 0 };
        let split = clip_split(ray, flags & flag::CLIPPED != 0, attributes, clip, centre, ta, te);
        let has_gap = flags & flag::GAP != 0;
        let gap = halves(if has_gap { ray.read_word(strip + head_words(flags) - 2) } else { 0 });
        let outer_top = high_of(clip);
        Self { cell, i, flags, attributes, strip, z_min, z_max, slope, gap, outer_top, ta, te, split, solid: 0 }
    }

    /// The next of the column's solids that the ray meets.
    #[inline]
    pub(super) fn meets(&mut self, ray: &Ray<'_>) -> Option<FoundSolid> {
        let centre = self.cell.as_vec2() + 0.5;
        let (node, split) = (&ray.node, &self.split);
        let has_gap = self.flags & flag::GAP != 0;
        // Each part has two solids in the ray's order.
        while self.solid < 6 {
            let (part, second) = (self.solid >> 1, self.solid & 1 == 1);
            self.solid += 1;
            let lower = second != (node.d.z > 0.0);
            let outer = (part == 1) == split.within_is_outer;
            let solid = match (outer, lower) {
                (true, _) => ColumnSolid::Outer,
                (false, true) => ColumnSolid::Lower,
                (false, false) => ColumnSolid::Upper,
            };
            let missing = match solid {
                ColumnSolid::Outer => second || self.outer_top == 0.0,
                ColumnSolid::Lower => !has_gap,
                ColumnSolid::Upper => false,
            };
            let (s, e) = [(self.ta, split.begin), (split.begin, split.end), (split.end, self.te)][part];
            if missing || s >= e {
                continue;
            }
            let bottom = if solid == ColumnSolid::Upper && has_gap { self.gap.y } else { self.z_min };
            let (top, slope) = match solid {
                ColumnSolid::Upper => (self.z_max, self.slope),
                ColumnSolid::Lower => (self.gap.x, Vec2::ZERO),
                ColumnSolid::Outer => (self.outer_top, Vec2::ZERO),
            };
            let (zs, ze) = (node.z_at(s), node.z_at(e));
            let top_at = |t: f32| top + slope.dot(node.o.xy() + node.d.xy() * t - centre);
            let span = clip_to_solid(s, e, [zs - top_at(s), ze - top_at(e)], [zs - bottom, ze - bottom]);
            // An eye inside a column (less than half a cell in front of a wall) sees out of it.
            let inside = span.s <= 0.0 && span.face == SolidFace::Side;
            if span.s < span.e && !inside {
                return Some(FoundSolid { span, solid, wall: split.walls[part], bottom, top });
            }
        }
        None
    }
}

/// Highest and lowest point of a column whose strip's texels begin at `texels`.
#[inline]
pub(super) fn bounds_of(ray: &mut Ray<'_>, walk: u32, texels: usize) -> [f32; 2] {
    let has_gap = flags_of(walk) & flag::GAP != 0;
    let bounds = if has_gap { ray.read_word(texels.wrapping_sub(1)) } else { walk };
    [high_of(bounds), low_of(bounds)]
}

/// A ray is inside of one plane, or of both planes of a convex corner, for one part of its way; likewise beyond both
/// planes of a concave corner.
#[inline]
fn clip_split(ray: &Ray<'_>, clipped: bool, attributes: u32, clip: u32, centre: Vec2, ta: f32, te: f32) -> ClipSplit {
    let concave = clip & CLIP_CONCAVE != 0;
    let side = if concave { -1.0 } else { 1.0 };
    let walls = [azimuth_of(attributes); 3];
    let mut split = ClipSplit { begin: ta, end: te, within_is_outer: concave, walls };
    let planes = if !clipped { 0 } else { 1 + usize::from(clip & CLIP_CORNER != 0) };
    for word in [attributes, clip].into_iter().take(planes) {
        let wall = azimuth_of(word);
        let offset = clip_offset_of(word);
        let n = azimuth_direction(wall);
        let beyond = |t: f32| side * (n.dot(ray.node.o.xy() + ray.node.d.xy() * t - centre) - offset);
        let (a, b) = (beyond(ta), beyond(te));
        let crossing = ta + (te - ta) * (a / (a - b));
        if a > 0.0 && b > 0.0 {
            split.begin = te;
        } else if a > 0.0 && crossing > split.begin {
            split.begin = crossing;
            split.walls[1] = wall;
        } else if b > 0.0 && a <= 0.0 && crossing < split.end {
            split.end = crossing;
            split.walls[2] = wall;
        }
    }
    // Never within: all of the ray is in the part before, which it enters through the cell's face.
    if split.begin >= split.end {
        (split.begin, split.end) = (te, te);
    }
    split
}

/// The part of `ta..te` below the top (`over` <= 0) and above the bottom (`above` >= 0). Both are linear along the ray
/// and given at its two ends.
#[inline]
fn clip_to_solid(ta: f32, te: f32, over: [f32; 2], above: [f32; 2]) -> SolidSpan {
    const NONE: SolidSpan = SolidSpan { s: 1.0, e: 0.0, face: SolidFace::Side };
    let mut span = SolidSpan { s: ta, e: te, face: SolidFace::Side };
    if over[0] > 0.0 {
        if over[1] > 0.0 {
            return NONE;
        }
        span.s = ta + (te - ta) * (over[0] / (over[0] - over[1]));
        span.face = SolidFace::Top;
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
            span.face = SolidFace::Bottom;
        }
    } else if above[1] < 0.0 {
        span.e = fast_min(span.e, ta + (te - ta) * (above[0] / (above[0] - above[1])));
    }
    span
}
