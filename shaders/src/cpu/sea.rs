//! Where the sea beyond the city is: on the plane, or on generated ground that lies on it, where the city ends in water. GPU twin:
//! `sea.wgsl`.

use super::surface::rgb;
use crate::layout::{FrameUniform, SHORE_PARTS, Shading};
use glam::{UVec2, Vec2, Vec3, Vec3Swizzles, Vec4, Vec4Swizzles};
use insula_protocol::blockmap::flag;

/// Generated ground has the albedo of the plane but for this difference of each channel: textures of meshes are not exact. Roads differ by
/// more than twice as much.
pub(crate) const BARE_TOLERANCE: f32 = 0.05;
/// Steeper surfaces within the map are no bare ground. Beyond, they are the ends of generated ground.
pub(crate) const BARE_NORMAL_Z: f32 = 0.7;
/// The sea fades into the fog later than land does, by this factor: nobody expects something else behind it.
pub(crate) const SEA_FADE: f32 = 0.286;
/// Nobody knows how coasts go on beyond the map. At its end they are sharp, and blurred from this share of its half width outwards.
pub(crate) const COAST_BLURS: f32 = 0.25;

/// Level water that differs so little from the sea in each channel is sea. Its tiles store the colour with losses, columns and meshes
/// with others: squares of several tints would lie on the sea.
pub(crate) const SEA_TOLERANCE: f32 = 0.05;
/// Steeper mirrors are no water, but panes.
pub(crate) const WATER_NORMAL_Z: f32 = 0.5;

/// Whether a surface can be generated ground.
fn is_bare(frame: &FrameUniform, albedo: Vec3) -> bool {
    (albedo - rgb(frame.light.plane)).abs().max_element() <= BARE_TOLERANCE
}

/// The albedo of a surface with this `normal` and these flags: that of the sea, if it is a part of it.
pub(super) fn with_sea_albedo(frame: &FrameUniform, albedo: Vec3, normal: Vec3, flags: u32) -> Vec3 {
    let is_water = flags & u32::from(flag::REFLECTIVE) != 0 && normal.z > WATER_NORMAL_Z;
    if !is_water || frame.sea_albedo[3] == 0.0 || frame.shading != Shading::Lit as u32 {
        return albedo;
    }
    let sea = rgb(frame.sea_albedo);
    if (albedo - sea).abs().max_element() <= SEA_TOLERANCE { sea } else { albedo }
}

/// How much of what a ray sees at `place`, relative to the camera, is sea, 0 to 1: generated ground if `surface` is one, else the plane.
pub(super) fn sea_share(frame: &FrameUniform, surface: Option<(Vec3, Vec3)>, place: Vec3) -> f32 {
    if frame.sea_albedo[3] == 0.0 || frame.shading != Shading::Lit as u32 {
        return 0.0;
    }
    if surface.is_some_and(|(albedo, _)| !is_bare(frame, albedo)) {
        return 0.0;
    }
    let is_level = surface.is_none_or(|(_, normal)| normal.z >= BARE_NORMAL_Z);
    let (low, high) = (Vec4::from(frame.shore).xy(), Vec4::from(frame.shore).zw());
    let half = (high - low) * 0.5;
    let from_middle = (place.xy() - low - half) / half;
    let away = from_middle.abs().max_element();
    if away > 1.0 {
        beyond(frame, from_middle / away, away - 1.0)
    } else if is_level {
        within(frame, place.xy(), from_middle)
    } else {
        0.0
    }
}

/// Bare ground between the ends of the map and its sea. `from_middle`: -1 to 1.
fn within(frame: &FrameUniform, place: Vec2, from_middle: Vec2) -> f32 {
    let (low, high) = (Vec4::from(frame.shore).xy(), Vec4::from(frame.shore).zw());
    let most = Vec2::splat(SHORE_PARTS as f32 - 1.0);
    let parts = ((from_middle * 0.5 + 0.5) * SHORE_PARTS as f32).clamp(Vec2::ZERO, most).as_uvec2();
    let (above, below) = ((place - low) * frame.sea_albedo[3], (high - place) * frame.sea_albedo[3]);
    let is_sea = [(parts.y, above.x), (parts.x, above.y), (parts.y, below.x), (parts.x, below.y)];
    let is_sea = (0..).zip(is_sea).any(|(side, (part, inwards))| inwards < bare_cells(shore_byte(frame, side, part)));
    f32::from(u8::from(is_sea))
}

/// The sea goes on away from the middle. `end`: where the line from there leaves the map; `away`: in half widths from it.
fn beyond(frame: &FrameUniform, end: Vec2, away: f32) -> f32 {
    let is_aside = end.x.abs() >= end.y.abs();
    let (across, along) = if is_aside { (end.x, end.y) } else { (end.y, end.x) };
    let side = u32::from(!is_aside) + if across < 0.0 { 0 } else { 2 };
    let parts = (along * 0.5 + 0.5) * SHORE_PARTS as f32;
    let sharp = bare_cells(shore_byte(frame, side, (parts as u32).min(SHORE_PARTS - 1)));
    let parts = (parts - 0.5).clamp(0.0, SHORE_PARTS as f32 - 1.0);
    let near = UVec2::new(parts as u32, (parts as u32 + 1).min(SHORE_PARTS - 1));
    let [first, next] = [near.x, near.y].map(|part| (shore_byte(frame, side, part) >> 4) as f32 / 15.0);
    let blurred = first + (next - first) * (parts - parts.floor());
    let sharp = if sharp > 0.0 { 1.0 } else { 0.0 };
    sharp + (blurred - sharp) * (away / COAST_BLURS).min(1.0)
}

/// The byte of a part of a side; sides are numbered west, south, east, north.
fn shore_byte(frame: &FrameUniform, side: u32, part: u32) -> u32 {
    let byte = (side * SHORE_PARTS + part) as usize;
    frame.sea[byte / 16][byte / 4 % 4] >> (byte % 4 * 8) & 0xff
}

/// So many cells inwards from a part, bare ground is sea; 0 for land.
fn bare_cells(byte: u32) -> f32 {
    (byte & 0xf) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn water_of_nearly_the_colour_of_the_sea_has_that_colour() {
        let sea = Vec3::new(0.07, 0.22, 0.31);
        let mut frame = FrameUniform { shading: Shading::Lit as u32, ..FrameUniform::zeroed() };
        let mirror = u32::from(flag::REFLECTIVE);
        let near = sea + Vec3::new(0.03, -0.03, 0.04);
        // Without a sea.
        assert_eq!(with_sea_albedo(&frame, near, Vec3::Z, mirror), near);
        frame.sea_albedo = sea.extend(0.1).to_array();
        assert_eq!(with_sea_albedo(&frame, near, Vec3::Z, mirror), sea);
        // A pool, a pane, a blue roof, and a picture of what is stored.
        let pool = sea + Vec3::new(0.0, 0.06, 0.0);
        assert_eq!(with_sea_albedo(&frame, pool, Vec3::Z, mirror), pool);
        assert_eq!(with_sea_albedo(&frame, near, Vec3::X, mirror), near);
        assert_eq!(with_sea_albedo(&frame, near, Vec3::Z, 0), near);
        frame.shading = Shading::Albedo as u32;
        assert_eq!(with_sea_albedo(&frame, near, Vec3::Z, mirror), near);
    }
}
