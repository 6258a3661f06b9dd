//! Draws frames on a graphics device or on the CPU.

mod adapter;
mod cpu;
mod gpu;

pub use adapter::{Adapter, AdapterChoice};
pub use cpu::CpuAdapter;
pub use gpu::{Device, GpuAdapter};

/// Description of a ray-caster, for reports and the overlay.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct AdapterInfo {
    /// Name that the driver gives.
    pub name: String,
    /// `vulkan`, `gl`, `metal`, `dx12` or `cpu`.
    pub backend: String,
}

impl AdapterInfo {
    /// Description of the CPU ray-caster.
    pub fn cpu() -> Self {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Self { name: format!("CPU ray-caster, {cores} cores"), backend: "cpu".into() }
    }
}
