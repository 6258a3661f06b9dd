//! `insula open`: bakes, serves and views city files in one process.

use super::embedded::{BakeJob, CacheRoot, cache_key};
use super::view;
use crate::args::{GlobalArgs, OpenArgs, ViewArgs};
use crate::error::{ClientError, Result};
use crate::stream::location::CityLocation;
use insula_archive::city::read_manifest;
use insula_bake::read::Palette;
use std::path::Path;

/// Runs the command. Fails if the files cannot be baked, or as `view` does.
pub(super) fn run(args: &OpenArgs, global: &GlobalArgs) -> Result<()> {
    if let [place] = args.inputs()
        && is_baked(place)
    {
        return view::run(
            &ViewArgs { place: place.clone().into_os_string().into(), sun: args.sun, ..ViewArgs::default() },
            global,
        );
    }
    let cell_m = args.cell.unwrap_or(1.0);
    let palette = match &args.palette {
        Some(value) => Palette::from_option(value).map_err(|e| ClientError::Usage(e.to_string()))?,
        None => Palette::default(),
    };
    let facades = args.facades.parse().map_err(ClientError::Usage)?;
    let cache_key = cache_key(args.inputs(), &palette, facades, cell_m)?;
    let inputs = args.inputs().to_vec();
    let job = BakeJob { inputs, cell_m, palette, facades, cache_key, ..BakeJob::default() };
    let view = ViewArgs { sun: args.sun, pictures: args.pictures, ..ViewArgs::default() };
    view::open_baked(job, CacheRoot::open()?, &view, global)
}

/// Whether an input is the address of a city, or the folder or manifest of a baked one, and not a city file.
pub(super) fn is_baked(input: &Path) -> bool {
    // A city file may be named as a manifest is.
    let is_city = |location| matches!(location, CityLocation::Folder(folder) if read_manifest(&folder).is_ok());
    is_address(input) || CityLocation::parse(input).is_ok_and(is_city)
}

/// Whether an input is the address of a city on a server or web host.
pub(super) fn is_address(input: &Path) -> bool {
    input.to_str().is_some_and(|text| text.contains("://"))
}
