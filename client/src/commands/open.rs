//! `insula open`: city files, baked, served and shown by one program.
//!
//! In: city files. Out: a window. Next: people.

use super::{
    embedded::{Recipe, bake, key_of, serve},
    view,
};
use crate::args::SunArgs;
use crate::{
    args::{Global, View},
    error::{ClientError, Result},
};
use insula_bake::read::Palette;
use std::path::{Path, PathBuf};

/// Runs the command.
pub fn run(
    inputs: &[PathBuf],
    cell_m: Option<f64>,
    palette: Option<&Path>,
    sun: &SunArgs,
    global: &Global,
) -> Result<()> {
    let cell_m = cell_m.unwrap_or(1.0);
    let palette_file = palette;
    let palette = match palette_file {
        Some(path) => Palette::read(path).map_err(|e| ClientError::Usage(e.to_string()))?,
        None => Palette::default(),
    };
    let key = key_of(inputs, palette_file, cell_m)?;
    let folder = bake(&Recipe { inputs: inputs.to_vec(), cell_m, palette, key, ..Recipe::default() })?;
    let server = serve(&folder)?;
    view::run(&View { url: server.url.clone(), sun: *sun, ..View::default() }, global)
}
