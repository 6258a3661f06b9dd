//! Insula's bake: city files in, a baked city out. Knows no HTTP.

pub mod grid;
pub mod partition;
pub mod progress;
pub mod read;
pub mod scene;
pub mod voxels;

pub use progress::{Progress, Silent};
