//! Insula's ray-caster: its WGSL, its definition on the CPU, and the layouts that both read.
//!
//! [`cpu::raycast`] defines what a frame shows. `wgsl/raycast.wgsl` must agree with it pixel for pixel but for
//! rounding at edges (`tests/integration/twin_raycast.rs`).
//!
//! Feature `gpu` adds the wgpu passes. Without it the crate has no graphics API.

mod atmosphere;
mod compose;
pub mod cpu;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod grid;
mod lanes;
pub mod layout;
pub mod light;
pub mod look;
pub mod mesh;
pub mod pack;
mod parallel;
pub mod shore;
pub mod srgb;
pub mod stone;
pub mod tone;
pub mod translucency;
pub mod wgsl;
mod words;

pub use atmosphere::irradiance;
