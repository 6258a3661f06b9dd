//! The ray-casters with the atlas that each reads: the CPU's in main memory, and with the feature `gpu` that of a device.
//!
//! They take pages by [`Upload`](crate::cache::Upload) and draw a [`FrameData`](crate::frame::FrameData).

mod adapter_info;
mod cpu;
#[cfg(feature = "gpu")]
mod gpu;

pub use adapter_info::AdapterInfo;
pub use cpu::CpuAdapter;
#[cfg(feature = "gpu")]
pub use gpu::{GpuAdapter, GpuDevice};
