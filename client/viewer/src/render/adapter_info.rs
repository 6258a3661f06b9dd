//! Description of a ray-caster, for reports and the overlay.

/// Name and backend of a ray-caster, and why it draws.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct AdapterInfo {
    pub name: String,
    /// `vulkan`, `gl`, `metal`, `dx12` or `cpu`.
    pub backend: String,
    /// Why this one draws, for people; empty if there was no choice.
    pub reason: String,
}

impl AdapterInfo {
    /// Description of the CPU ray-caster on a number of cores.
    pub fn cpu(cores: usize) -> Self {
        Self { name: format!("CPU ray-caster, {cores} cores"), backend: "cpu".into(), reason: String::new() }
    }
}
