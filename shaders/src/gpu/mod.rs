//! The WGSL stages as wgpu passes, and the memory that they read.

pub mod compose;
pub mod raycast;

pub use compose::Compose;
pub use raycast::{Capacity, GpuError, Raycaster};
