//! Insula's bake: reads city files and writes a baked city. It has no HTTP.

pub mod columns;
pub mod config;
pub mod error;
pub mod ground;
mod hash;
pub mod kept_work;
mod mesh;
pub mod pipeline;
pub mod progress;
pub mod read;
mod release;
pub mod report;
pub mod sample;
pub mod scene;
mod write;

pub use config::{ALGORITHM, BakeOptions};
pub use error::BakeError;
pub use ground::{ALGORITHM as GROUND_ALGORITHM, GroundOption};
pub use mesh::ALGORITHM as MESH_ALGORITHM;
pub use pipeline::{
    AbortedJob, BakeStage, BakeSteps, DEFAULT_CHUNK_BYTES, DEFAULT_REGION_LEAVES, GeneratedCity, Job, JobRequest,
    StageStatus, WorkFolder, WorkStore, abort, bake, bake_generated, bake_scene,
};
pub use progress::{Progress, Silent};
pub use report::BakeReport;
pub use write::ownership::remove_damaged_city;
