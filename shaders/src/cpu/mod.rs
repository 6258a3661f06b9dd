//! The ray-caster on the CPU, which defines what a frame shows, and the CPU twins of the other WGSL stages.
//!
//! Each file is the twin of the WGSL file of its name: the same functions under the same names in the same order. Where
//! one language has something that the other does not, the file says so. Helpers that another module provides (`pack`,
//! `layout`, `insula_protocol::octahedral`) are not repeated.

mod column;
mod fast_math;
pub mod hit_counts;
pub mod instruction_set;
pub(crate) mod landmark;
pub(crate) mod mesh;
pub(crate) mod mesh_surface;
pub mod night;
mod node;
pub mod noise;
mod objects;
mod packet;
pub(crate) mod ray;
pub mod raycast;
pub mod render;
pub(crate) mod sea;
pub mod shade;
pub(crate) mod solid;
pub mod stepped;
pub mod stone;
mod surface;
pub mod translucency;
pub mod translucency_map;
mod walk;
pub mod ward;
mod words;
