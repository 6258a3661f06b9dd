//! Visibility maps drawn on a GPU (feature `gpu`).

use glam::Vec3;

/// A triangle to draw into a visibility map.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(not(feature = "gpu"), allow(dead_code, reason = "only the GPU reads the fields"))]
pub(super) struct FacingTriangle {
    /// x and y in texels of the map, z in metres towards the viewer.
    pub(super) corners: [Vec3; 3],
    /// What the map stores where this triangle is the nearest; not 0.
    pub(super) number: u32,
}

#[cfg(feature = "gpu")]
mod device {
    use super::FacingTriangle;
    use insula_shaders::gpu::GpuError;
    use insula_shaders::gpu::nearest::{Nearest, NearestVertex};
    use std::sync::OnceLock;

    /// The device, which the whole process shares.
    fn device() -> Result<&'static Nearest, &'static GpuError> {
        static DEVICE: OnceLock<Result<Nearest, GpuError>> = OnceLock::new();
        DEVICE.get_or_init(Nearest::open).as_ref()
    }

    /// Opens the device. Fails if no device works.
    pub(in crate::sample) fn check() -> Result<(), String> {
        device().map(|device| tracing::info!("visibility on {}", device.name())).map_err(ToString::to_string)
    }

    /// The number of the nearest triangle for each texel, row by row, 0 where there is none; `None` if the device
    /// failed.
    pub(in crate::sample) fn draw(triangles: &[FacingTriangle], size: [usize; 2]) -> Option<Vec<u32>> {
        let heights = || triangles.iter().flat_map(|triangle| triangle.corners).map(|c| c.z);
        let (low, high) = (heights().fold(f32::MAX, f32::min), heights().fold(f32::MIN, f32::max));
        // Depth stays clear of 0, the value of empty texels, and of 1, beyond which rounding would clip.
        let depth = |z: f32| 0.01 + 0.98 * (z - low) / (high - low).max(1e-3);
        let corners: Vec<NearestVertex> = triangles
            .iter()
            .flat_map(|triangle| {
                triangle.corners.map(|c| NearestVertex { place: [c.x, c.y, depth(c.z)], number: triangle.number })
            })
            .collect();
        let drawn = device().ok()?.draw(&corners, size.map(|side| side as u32));
        drawn.inspect_err(|error| tracing::warn!("a visibility map is drawn on the CPU: {error}")).ok()
    }
}

#[cfg(not(feature = "gpu"))]
mod device {
    use super::FacingTriangle;

    pub(in crate::sample) fn check() -> Result<(), String> {
        Err("this program was built without feature `gpu`".into())
    }

    pub(in crate::sample) fn draw(_: &[FacingTriangle], _: [usize; 2]) -> Option<Vec<u32>> {
        None
    }
}

pub(super) use device::{check, draw};
