//! `insula open`: bakes, serves and views city files in one process.

use super::{
    embedded::{BakeJob, cache_key},
    view,
};
use crate::{
    args::{GlobalArgs, OpenArgs, ViewArgs},
    error::{ClientError, Result},
};
use insula_bake::read::Palette;

/// Runs the command. Fails if the files cannot be baked, or as `view` does.
pub(super) fn run(args: &OpenArgs, global: &GlobalArgs) -> Result<()> {
    let cell_m = args.cell.unwrap_or(1.0);
    let palette = match &args.palette {
        Some(value) => Palette::from_option(value).map_err(|e| ClientError::Usage(e.to_string()))?,
        None => Palette::default(),
    };
    let facades = args.facades.parse().map_err(ClientError::Usage)?;
    let cache_key = cache_key(&args.inputs, &palette, facades, cell_m)?;
    let inputs = args.inputs.clone();
    let job = BakeJob { inputs, cell_m, palette, facades, cache_key, ..BakeJob::default() };
    let view = ViewArgs { sun: args.sun, pictures: args.pictures, ..ViewArgs::default() };
    view::open_baked(job, &view, global)
}
