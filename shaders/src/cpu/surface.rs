//! What a ray found, before it is lit.

use glam::{Vec3, Vec4, Vec4Swizzles};

/// A surface: a texel, or the weighted mean of those that a ray passed.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceSample {
    /// Linear RGB.
    pub albedo: Vec3,
    /// Visible share of the sky.
    pub ao: f32,
    /// Unit normal towards the viewer.
    pub normal: Vec3,
    /// Flags of its column, or [`MESH_FLAG`](crate::layout::MESH_FLAG).
    pub flags: u32,
    /// Level of its node.
    pub level: u32,
}

pub(super) fn rgb(v: [f32; 4]) -> Vec3 {
    Vec4::from(v).xyz()
}
