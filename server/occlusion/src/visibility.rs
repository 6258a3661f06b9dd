//! Whether a vertex is seen from a direction (Mischitelli 2007, 3.3).

use crate::depth_map::{DepthMap, Projected};
use crate::prepared::{MapFrame, SUBTEXEL_BITS};
use crate::sums::COSINE_BITS;
use crate::{UNIT_SHIFT, ViewPair, dot};

/// A vertex may lie this much behind a map's depth, in texels, besides what its surface is inclined by (3.3.1).
pub(crate) const BIAS_TEXELS: f32 = 0.75;
/// The same for each unit of the surface's slope in the map.
pub(crate) const BIAS_PER_SLOPE: f32 = 0.25;
/// Up to this slope.
pub(crate) const MAX_BIAS_SLOPE: f32 = 8.0;
/// Steeper surfaces are treated like those of this slope. Their cosine, and with it their weight, is small.
pub(crate) const MAX_SLOPE: f32 = 100.0;
/// By how much products of two unit vectors are shifted to give cosines.
pub(crate) const COSINE_SHIFT: u32 = 2 * UNIT_SHIFT - COSINE_BITS;

#[inline(always)]
pub(crate) fn project(place: [i32; 3], pair: ViewPair, frame: MapFrame) -> Projected {
    let (shift, middle) = (frame.product_shift(), frame.middle());
    let [right, down, towards] = pair.axes;
    [
        (dot(right, place) >> shift) as i32 + middle,
        (dot(down, place) >> shift) as i32 + middle,
        (dot(towards, place) >> UNIT_SHIFT) as i32,
    ]
}

/// The product of a vertex's normal with the first direction of a pair, and whether the vertex is seen from that direction
/// of the pair which it faces.
///
/// The map's depth belongs to the centre of a texel. It is compared with the depth that the vertex's tangent plane has
/// there, so that only the curvature remains for the bias to cover. Both sides of the inequality are multiplied by the
/// cosine.
#[inline(always)]
pub(crate) fn sees(
    normal: [i32; 3],
    [x, y, depth]: Projected,
    pair: ViewPair,
    frame: MapFrame,
    map: &DepthMap,
) -> (i32, bool) {
    let [right, down, towards] = pair.axes;
    let facing = dot_of_units(towards, normal);
    let (along_x, along_y) = (dot_of_units(right, normal) as f32, dot_of_units(down, normal) as f32);
    let along = (along_x * along_x + along_y * along_y).sqrt();
    let cosine = (facing.unsigned_abs() as f32).max(along / MAX_SLOPE);
    let [near, far] = map.depths(x >> SUBTEXEL_BITS, y >> SUBTEXEL_BITS);
    let in_front = if facing > 0 { near - depth as f32 } else { depth as f32 - far };
    let texel = frame.texel_steps();
    let plane = -(along_x * to_centre(x) + along_y * to_centre(y));
    let bias = BIAS_TEXELS * cosine + BIAS_PER_SLOPE * along.min(MAX_BIAS_SLOPE * cosine);
    (facing, in_front * cosine <= texel * (plane + bias))
}

/// From a step of a map to the centre of its texel, in texels.
#[inline(always)]
fn to_centre(step: i32) -> f32 {
    const TEXEL: i32 = 1 << SUBTEXEL_BITS;
    (TEXEL / 2 - (step & (TEXEL - 1))) as f32 / TEXEL as f32
}

/// Scalar product of two vectors whose lengths have at most 15 bits.
#[inline(always)]
fn dot_of_units(a: [i32; 3], b: [i32; 3]) -> i32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
