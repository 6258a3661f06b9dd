//! The WGSL stages as wgpu passes, and the memory that they read.

pub mod compose;
pub mod nearest;
pub mod raycast;
pub mod tally;

pub use compose::Compose;
pub use nearest::Nearest;
pub use raycast::{Capacity, GpuError, Raycaster};
pub use tally::Tally;
