//! Fields of the atlas's words ([`crate::pack`]). GPU twin: `shared/words.wgsl`.

use crate::pack::{
    AO_SHIFT, AZIMUTH_SHIFT, AZIMUTHS, CLIP_OFFSET_SHIFT, FLAGS_SHIFT, HEIGHT_BITS, HEIGHT_MASK, THIN_STEP,
};
use glam::Vec2;
use insula_protocol::blockmap::{CLIP_STEPS_PER_CELL, STEPS_PER_CELL, flag};
use insula_protocol::texel::OPAQUE;
use std::sync::LazyLock;

#[inline]
pub(super) fn flags_of(walk: u32) -> u8 {
    (walk >> FLAGS_SHIFT) as u8
}

/// The higher one of a word's two heights, in height codes.
#[inline]
pub(super) fn high_of(word: u32) -> f32 {
    (word & HEIGHT_MASK) as f32
}

#[inline]
pub(super) fn low_of(word: u32) -> f32 {
    (word >> HEIGHT_BITS & HEIGHT_MASK) as f32
}

/// Azimuth of a wall's normal, [`AZIMUTHS`] to a turn.
#[inline]
pub(super) fn azimuth_of(word: u32) -> u32 {
    word >> AZIMUTH_SHIFT & (AZIMUTHS - 1)
}

/// Horizontal unit vector.
#[inline]
pub(super) fn azimuth_direction(azimuth: u32) -> Vec2 {
    azimuth_directions()[azimuth as usize % AZIMUTHS as usize]
}

/// The vectors of all azimuths: sine and cosine would take a third of the time of a clipped column.
pub(super) fn azimuth_directions() -> &'static [Vec2; AZIMUTHS as usize] {
    static DIRECTIONS: LazyLock<[Vec2; AZIMUTHS as usize]> = LazyLock::new(|| {
        std::array::from_fn(|azimuth| Vec2::from_angle(azimuth as f32 * (std::f32::consts::TAU / AZIMUTHS as f32)))
    });
    &DIRECTIONS
}

/// Distance of a clipping plane from the cell's centre, in cells.
#[inline]
pub(super) fn clip_offset_of(word: u32) -> f32 {
    (word as i32 >> CLIP_OFFSET_SHIFT) as f32 / CLIP_STEPS_PER_CELL as f32
}

/// Whether a column with these flags and attributes is thin.
#[inline]
pub(super) fn is_thin(flags: u8, attributes: u32) -> bool {
    flags & (flag::HOLES | flag::CLIPPED) == flag::HOLES && attributes >> CLIP_OFFSET_SHIFT != 0
}

/// The code of the share of a thin column's sides, or of its top and underside.
#[inline]
pub(super) fn thin_share(attributes: u32, side: bool) -> u32 {
    if side { attributes >> CLIP_OFFSET_SHIFT } else { attributes & 0xff }
}

/// Whether a ray is among the share, given as a code, of all rays that hit what they meet in column `i`. Neighbouring rays differ by their thresholds
/// so that any few of them hit as often as many; in the next column, others do.
#[inline]
pub(super) fn hits_share(share: u32, threshold: u32, i: u32) -> bool {
    ((threshold << 4) + i * THIN_STEP) & 0xffff < share * (share + 2)
}

/// Whether rays pass a texel.
#[inline]
pub(super) fn is_open(texel: u32) -> bool {
    texel & OPAQUE == 0
}

/// Share of the sky that a texel sees, 0 to [`AO_MAX`](insula_protocol::texel::AO_MAX).
#[inline]
pub(super) fn ao_of(texel: u32) -> f32 {
    (texel >> AO_SHIFT) as f32
}

/// Height codes of a strip's row.
#[inline]
pub(super) fn codes_per_row(z_shift: u32) -> f32 {
    f32::from(STEPS_PER_CELL >> z_shift)
}

/// Halves of a word, the lower first.
#[inline]
pub(super) fn halves(word: u32) -> Vec2 {
    Vec2::new((word & 0xffff) as f32, (word >> 16) as f32)
}
