//! Description of a ray-caster, for reports and the overlay.

/// Name and backend of a ray-caster.
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
