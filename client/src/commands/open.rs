//! `insula open`: city files, baked, served and shown by one program.
//!
//! In: city files. Out: a window. Next: people.

use super::{
    embedded::{Recipe, bake, key_of, serve},
    view,
};
use crate::{args::Global, error::Result};
use std::path::PathBuf;

/// Runs the command.
pub fn run(inputs: &[PathBuf], cell_m: Option<f64>, global: &Global) -> Result<()> {
    let cell_m = cell_m.unwrap_or(1.0);
    let key = key_of(inputs, cell_m)?;
    let folder = bake(&Recipe { inputs: inputs.to_vec(), cell_m, key, ..Recipe::default() })?;
    let server = serve(&folder)?;
    view::run(&server.url, global)
}
