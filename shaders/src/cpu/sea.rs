//! Where the sea beyond the city is: on the plane, or on generated ground that lies on it, where the city ends in water. GPU twin:
//! `sea.wgsl`.

use super::surface::rgb;
use crate::layout::{FrameUniform, SHORE_PARTS, Shading};
use glam::{Vec2, Vec3, Vec3Swizzles, Vec4, Vec4Swizzles};

/// Generated ground has the albedo of the plane but for this difference of each channel: textures of meshes are not exact. Roads differ by
/// more than twice as much.
pub(crate) const BARE_TOLERANCE: f32 = 0.05;
/// Steeper surfaces are no ground.
pub(crate) const BARE_NORMAL_Z: f32 = 0.7;
/// The sea fades into the fog later than land does, by this factor: nobody expects something else behind it.
pub(crate) const SEA_FADE: f32 = 0.6;

/// Whether what a ray sees at `place`, relative to the camera, is sea: generated ground if `surface` is one, else the plane.
pub(super) fn is_sea(frame: &FrameUniform, surface: Option<(Vec3, Vec3)>, place: Vec3) -> bool {
    if frame.sea_albedo[3] == 0.0 || frame.shading != Shading::Lit as u32 {
        return false;
    }
    if let Some((albedo, normal)) = surface {
        let difference = (albedo - rgb(frame.light.plane)).abs().max_element();
        if difference > BARE_TOLERANCE || normal.z < BARE_NORMAL_Z {
            return false;
        }
    }
    let (low, high) = (Vec4::from(frame.shore).xy(), Vec4::from(frame.shore).zw());
    let most = Vec2::splat(SHORE_PARTS as f32 - 1.0);
    let parts = ((place.xy() - low) / (high - low) * SHORE_PARTS as f32).clamp(Vec2::ZERO, most).as_uvec2();
    let (above, below) = ((place.xy() - low) * frame.sea_albedo[3], (high - place.xy()) * frame.sea_albedo[3]);
    let is_beyond = |side: u32, part: u32, inwards: f32| {
        let byte = (side * SHORE_PARTS + part) as usize;
        let cells = frame.sea[byte / 16][byte / 4 % 4] >> (byte % 4 * 8) & 0xff;
        cells > 0 && inwards < cells as f32
    };
    is_beyond(0, parts.y, above.x)
        || is_beyond(1, parts.x, above.y)
        || is_beyond(2, parts.y, below.x)
        || is_beyond(3, parts.x, below.y)
}
