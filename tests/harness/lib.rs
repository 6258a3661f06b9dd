//! Shared by the integration tests and the measuring programs: random cities, cameras, a GPU, ray-traced ground truth,
//! comparisons.

pub mod baked;
mod baked_meshes;
pub mod browser;
pub mod cameras;
pub mod carving;
pub mod compare;
pub mod deep_city;
pub mod draw_list;
pub mod fidelity;
pub mod fixtures;
pub mod gpu;
pub mod leaves;
pub mod load;
pub mod node_error;
pub mod pfm;
pub mod ports;
pub mod proxy;
pub mod random;
pub mod random_mesh;
pub mod reference_caster;
pub mod source_code;
pub mod synth;
pub mod terraces;
pub mod translucent_shapes;
pub mod trials;
pub mod truth;
pub mod twin;
pub mod view;
pub mod viewer;
pub mod zoo;

pub use insula_test_support::{programs, rng};
