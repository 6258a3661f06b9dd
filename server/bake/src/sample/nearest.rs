//! Maps drawn by a graphics device (feature `gpu`).
//!
//! In: triangles in a map's coordinates. Out: the nearest one's number for each texel. Next: `visibility` asks the map.

use glam::Vec3;

/// One triangle that faces the viewer: x and y in texels of the map, z in metres towards the viewer; its number.
pub(super) type Facing = ([Vec3; 3], u32);

#[cfg(feature = "gpu")]
mod device {
    use super::Facing;
    use insula_shaders::gpu::{
        GpuError,
        nearest::{Nearest, NearestVertex},
    };
    use std::sync::OnceLock;

    /// One device for the whole process.
    fn device() -> Result<&'static Nearest, &'static GpuError> {
        static DEVICE: OnceLock<Result<Nearest, GpuError>> = OnceLock::new();
        DEVICE.get_or_init(Nearest::open).as_ref()
    }

    pub(in super::super) fn check() -> Result<(), String> {
        device().map(|device| tracing::info!("visibility on {}", device.name())).map_err(ToString::to_string)
    }

    pub(in super::super) fn draw(triangles: &[Facing], size: [usize; 2]) -> Option<Vec<u32>> {
        let heights = || triangles.iter().flat_map(|(corners, _)| corners).map(|c| c.z);
        let (low, high) = (heights().fold(f32::MAX, f32::min), heights().fold(f32::MIN, f32::max));
        // Away from 0, which is what nothing has, and from 1, beyond which rounding would clip.
        let nearness = |z: f32| 0.01 + 0.98 * (z - low) / (high - low).max(1e-3);
        let corner = |c: &glam::Vec3, number: u32| NearestVertex { place: [c.x, c.y, nearness(c.z)], number };
        let corners: Vec<NearestVertex> =
            triangles.iter().flat_map(|(corners, number)| corners.iter().map(|c| corner(c, *number))).collect();
        let drawn = device().ok()?.draw(&corners, size.map(|side| side as u32));
        drawn.inspect_err(|error| tracing::warn!("a map is drawn by the processor: {error}")).ok()
    }
}

#[cfg(not(feature = "gpu"))]
mod device {
    use super::Facing;

    pub(in super::super) fn check() -> Result<(), String> {
        Err("this program was built without feature `gpu`".into())
    }

    pub(in super::super) fn draw(_: &[Facing], _: [usize; 2]) -> Option<Vec<u32>> {
        None
    }
}

pub(super) use device::{check, draw};
