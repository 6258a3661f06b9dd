//! What inputs contain, before anyone bakes them.

use super::{ReadOptions, ReadProgress, ReadReport, ScratchOptions, read_to_disk};
use crate::error::BakeError;
use crate::scene::scratch_budget::ScratchBudget;
use insula_source::error::InputError;
use insula_source::temporary;
use serde::Serialize;
use std::path::PathBuf;

/// Size of the loaded textures together.
const TEXTURE_CACHE_BYTES: usize = 64 << 20;
/// Most scratch files, as of a bake by default.
const SCRATCH_BYTES: u64 = 64 << 30;

/// What a bake would read of inputs.
#[derive(Debug, Serialize)]
pub struct InputSurvey {
    /// World bounds of all objects in metres, `[min, max]`.
    pub bounds: Option<[[f64; 3]; 2]>,
    #[serde(flatten)]
    pub read: ReadReport,
}

/// Reads inputs as a bake does and keeps nothing but the report. Fails as a bake does.
pub fn survey(
    inputs: &[PathBuf],
    options: &ReadOptions,
    progress: &dyn Fn(ReadProgress),
) -> Result<InputSurvey, BakeError> {
    let folder = temporary::folder().map_err(|cause| InputError::io("temporary folder", cause))?;
    let budget = ScratchBudget::new(SCRATCH_BYTES);
    let scratch = ScratchOptions { folder: folder.path(), texture_cache_bytes: TEXTURE_CACHE_BYTES, budget: &budget };
    let (city, _, read) = read_to_disk(inputs, options, scratch, progress)?;
    let to_world = |corner: [f64; 3]| std::array::from_fn(|axis| city.origin[axis] + corner[axis]);
    Ok(InputSurvey { bounds: city.bounds.map(|bounds| bounds.map(to_world)), read })
}
