//! The WGSL stages as wgpu passes, and the memory that they read.

pub mod compose;
pub mod hit_counts;
pub mod nearest;
pub mod raycast;

pub use compose::Compose;
pub use hit_counts::HitCounts;
pub use nearest::Nearest;
pub use raycast::{Capacity, GpuError, Raycaster};

/// A device, and the queue of its commands.
#[derive(Debug, Clone, Copy)]
pub struct DeviceQueue<'a> {
    /// Where resources are made.
    pub device: &'a wgpu::Device,
    /// Where commands and writes are submitted.
    pub queue: &'a wgpu::Queue,
}
