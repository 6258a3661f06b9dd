//! Insula's bake: city files in, a baked city out. Knows no HTTP.

mod clip;
pub mod config;
pub mod error;
pub mod grid;
pub mod lod;
mod merge;
mod mesh;
pub mod model;
pub mod parametrise;
mod partition;
pub mod pipeline;
pub mod progress;
pub mod read;
pub mod report;
pub mod sample;
pub mod scene;
pub mod simplify;
mod spool;
pub mod voxels;
pub mod write;

pub use config::{ALGORITHM, BakeOptions};
pub use error::BakeError;
pub use mesh::ALGORITHM as MESH_ALGORITHM;
pub use pipeline::{MadeCity, bake, bake_made, bake_scene};
pub use progress::{Progress, Silent};
pub use report::Report;
