//! What a shell asks a streamer for.

use crate::camera::Camera;
use crate::switching::SwitchDistances;

/// A frame that is to be shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameRequest {
    pub camera: Camera,
    /// Where a moving camera will be in half a second: tiles of that view are preloaded.
    pub heading: Option<Camera>,
    pub size_px: [u32; 2],
    /// Tolerated screen-space error in pixels.
    pub tau_px: f64,
    /// What decides instead of the screen-space error.
    pub switching: Option<SwitchDistances>,
}
