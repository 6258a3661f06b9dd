//! Insula's ray-caster: WGSL, its CPU twin, and the layouts that both read.
//!
//! In: packed nodes (`pack`), the cut as a tree (`layout`), a camera. Out: pixels, distances, the node that each pixel
//! hit. Next: the client shows them.
//!
//! What a V-BlockMap looks like is defined once, by [`cpu::raycast`]; `wgsl/raycast.wgsl` must agree with it pixel for pixel
//! but for rounding at edges (`tests/integration/twin_raycast.rs`). No wgpu unless feature `gpu`.

pub mod cpu;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod grid;
pub mod layout;
pub mod light;
pub mod mesh;
pub mod pack;

/// The WGSL source of the ray-caster: bindings in [`layout::binding`], workgroups of [`layout::WORKGROUP`].
pub const RAYCAST_WGSL: &str = concat!(
    include_str!("../wgsl/raycast.wgsl"),
    "\n",
    include_str!("../wgsl/node.wgsl"),
    "\n",
    include_str!("../wgsl/column.wgsl"),
    "\n",
    include_str!("../wgsl/mesh.wgsl"),
    "\n",
    include_str!("../wgsl/shade.wgsl")
);
/// The WGSL source that puts the ray-caster's pixels on a render target.
pub const COMPOSE_WGSL: &str = include_str!("../wgsl/compose.wgsl");
/// The WGSL source that counts each node's pixels.
pub const TALLY_WGSL: &str = include_str!("../wgsl/tally.wgsl");
/// The WGSL source that draws which triangle is nearest, for the bake.
pub const NEAREST_WGSL: &str = include_str!("../wgsl/nearest.wgsl");
