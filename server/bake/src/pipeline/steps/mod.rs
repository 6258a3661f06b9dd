//! A bake in steps, which any number of machines run: each reads results of earlier steps from a [`WorkStore`], and writes its own.
//!
//! | step | tasks | reads | writes |
//! |---|---|---|---|
//! | [`BakeSteps::begin`] | 1 | names of inputs, their first places | the job: chunks of sources, coordinate system |
//! | [`BakeSteps::scan`] | chunks | the sources of a chunk | objects, triangles, records, textures |
//! | [`BakeSteps::plan`] | 1 | all scans | grid, regions, numbers of objects, generated ground |
//! | [`BakeSteps::shuffle`] | chunks, and the ground | a scan, the plan | its triangles by region |
//! | [`BakeSteps::region`] | regions | its triangles | leaves, meshes, parents up to the region's root |
//! | [`BakeSteps::crown`] | 1 | the regions' roots | the levels above |
//! | [`BakeSteps::join_plan`] | 1 | the indexes of all tiles, V-BlockMaps of the leaves | the small files of the city; what the parts of the archives are |
//! | [`BakeSteps::join_part`] | parts | tiles | 64 MiB of an archive |
//! | [`BakeSteps::join_finish`] | 1 | receipts for the parts | the archives; `city.json` last |
//!
//! A step that finds its result does nothing. Results depend on nothing but the inputs and the options: the same task may run twice, on
//! two machines, in any order within its stage, with regions and chunks of any size, and the city is that of [`crate::bake`], byte for byte.

mod crown;
mod generated;
mod job;
mod join;
mod layout;
mod owned;
mod plan;
mod region;
mod region_file;
mod scan;
mod sealed;
mod shuffle;
mod stage;
mod store_tiles;
mod work;

pub use job::{BakeSteps, DEFAULT_CHUNK_BYTES, DEFAULT_REGION_LEAVES, Job, JobRequest};
pub use stage::{AbortedJob, BakeStage, StageStatus, abort};
pub use work::{WorkFolder, WorkStore};
