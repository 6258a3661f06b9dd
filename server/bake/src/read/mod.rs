//! Reads city files of several formats into one city.
//!
//! In: files, folders or embedded bytes. Out: `ScratchScene`, or a whole [`Scene`], and [`ReadReport`].
//! Next: `partition`.

mod bad_inputs;
mod cityjson;
mod context;
mod counted_float;
mod facade;
mod geojson;
mod json;
mod obj;
mod palette;
mod polygon;
mod report;
mod scene_builder;
mod source;
#[cfg(test)]
mod tests;
mod texture;
mod texture_level;
mod unread_formats;

use std::path::{Path, PathBuf};

pub use crate::error::InputError;
pub use context::{ObjUpAxis, ReadOptions};
pub use facade::{ALGORITHM as FACADE_ALGORITHM, FacadeOption};
pub use palette::{Palette, PaletteMode};
pub use report::{BadInput, ColourCounts, FacadeReport, FaultCount, ReadReport, SourceFormat, SourceReport};
pub use source::ReadProgress;

use crate::error::BakeError;
use crate::scene::Scene;
use crate::scene::scratch_budget::ScratchBudget;
use crate::scene::scratch_scene::ScratchScene;
use crate::scene::texture_store::TextureStore;
use crate::scene::triangle_store::TriangleStore;
use crate::subject;
use bad_inputs::{BadInputs, nothing_left};
use context::{ByteProgress, ReadContext};
use source::{CitySource, SourceKind, kind_by_name};

/// Reads files, and the city files directly in folders by name, into one scene.
///
/// Fails if a source cannot be read at all, if nothing is left of it, if sources disagree on the coordinate system, or if
/// there are no triangles. Faults of single objects are in the report instead, and so are bad sources if they are skipped.
pub fn read(
    inputs: &[PathBuf],
    options: &ReadOptions,
    progress: &dyn Fn(ReadProgress),
) -> Result<(Scene, ReadReport), InputError> {
    let mut bad = BadInputs::new(options.skip_bad_inputs);
    read_scene(&source::list(inputs, &options.texture_roots, &mut bad)?, bad, options, progress)
}

/// Reads city files from memory, each named as it would be on disk. Material libraries and textures are looked up among
/// the given files by the name that the city file uses. Fails as [`read`] does.
pub fn read_embedded(
    files: &[(&str, &[u8])],
    options: &ReadOptions,
    progress: &dyn Fn(ReadProgress),
) -> Result<(Scene, ReadReport), InputError> {
    read_scene(&source::embedded(files), BadInputs::new(options.skip_bad_inputs), options, progress)
}

/// Where [`read_to_disk`] keeps triangles and textures.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ScratchOptions<'a> {
    /// An existing folder.
    pub(crate) folder: &'a Path,
    /// Size of the loaded textures together.
    pub(crate) texture_cache_bytes: usize,
    /// Bounds the files.
    pub(crate) budget: &'a ScratchBudget,
}

/// Reads as [`read`] does, but keeps triangles and textures in scratch files. Fails also if these cannot be written.
pub(crate) fn read_to_disk(
    inputs: &[PathBuf],
    options: &ReadOptions,
    scratch: ScratchOptions<'_>,
    progress: &dyn Fn(ReadProgress),
) -> Result<(ScratchScene, ReadReport), BakeError> {
    let triangles = TriangleStore::in_file(scratch.folder.join("triangles"), scratch.budget.clone())?;
    let folder = scratch.folder.to_owned();
    let textures = TextureStore::in_folder(folder, scratch.texture_cache_bytes, scratch.budget.clone());
    let context = ReadContext::new(options, triangles, textures);
    let mut bad = BadInputs::new(options.skip_bad_inputs);
    let sources = source::list(inputs, &options.texture_roots, &mut bad)?;
    let mut read = read_sources(&sources, bad, context, progress)?;
    read.city.stored.finish()?;
    read.city.names.finish();
    read.city.textures.finish()?;
    read.level_textures(options)?;
    Ok((read.city, read.report))
}

fn read_scene(
    sources: &[CitySource<'_>],
    bad: BadInputs,
    options: &ReadOptions,
    progress: &dyn Fn(ReadProgress),
) -> Result<(Scene, ReadReport), InputError> {
    let context = ReadContext::new(options, TriangleStore::Memory(Vec::new()), TextureStore::in_memory());
    let mut read = read_sources(sources, bad, context, progress)?;
    let label = || sources.first().map_or(String::new(), |source| source.label.clone());
    let levelled = read.level_textures(options);
    let scene = levelled.and_then(|()| read.city.into_scene());
    Ok((scene.map_err(|error| InputError::io(&label(), std::io::Error::other(error)))?, read.report))
}

/// A city as it is read, with the textures of photos at the level that they have.
struct ReadCity {
    city: ScratchScene,
    report: ReadReport,
    /// The set of each photo, whose members get one factor; `None` for a generated texture.
    set_of_texture: Vec<Option<u32>>,
    /// The set of each source in the report.
    set_of_source: Vec<u32>,
}

impl ReadCity {
    /// Brings photo textures to the level of lit materials, unless sources stay as they are. Fails if scratch files cannot
    /// be read.
    fn level_textures(&mut self, options: &ReadOptions) -> Result<(), BakeError> {
        if options.palette.mode == PaletteMode::Source {
            return Ok(());
        }
        let gains = texture_level::level_textures(&mut self.city, &self.set_of_texture)?;
        for (source, set) in self.report.sources.iter_mut().zip(&self.set_of_source) {
            source.texture_gain = gains.get(*set as usize).copied().unwrap_or(1.0);
        }
        Ok(())
    }
}

fn read_sources(
    sources: &[CitySource<'_>],
    mut bad: BadInputs,
    mut context: ReadContext<'_>,
    progress: &dyn Fn(ReadProgress),
) -> Result<ReadCity, InputError> {
    if sources.is_empty() {
        bad.fail_with_first()?;
        return Err(InputError::NoSource { path: "the input".to_owned() });
    }
    let bytes_total = sources.iter().map(|source| source.bytes).sum();
    let mut report = ReadReport::default();
    let mut set_of_source = Vec::new();
    let mut bytes_before = 0;
    for source in sources {
        let tick = |done: u64| {
            progress(ReadProgress { bytes_done: bytes_before + done.min(source.bytes), bytes_total });
        };
        tick(0);
        context.source = report.sources.len();
        subject::set(format_args!("{}", source.label));
        let mark = context.mark();
        let result = read_source(&mut context, source, &tick);
        match bad.skip(&source.label, result)? {
            Some(Some(read)) => {
                report.sources.push(read);
                set_of_source.push(context.textures.set_of(source));
            }
            Some(None) => report.ignored.push(source.label.clone()),
            None => context.abandon_source(mark),
        }
        bytes_before += source.bytes;
    }
    progress(ReadProgress { bytes_done: bytes_total, bytes_total });
    report.facades = context.take_facades();
    let set_of_texture = std::mem::take(&mut context.textures.set_of_texture);
    let mut city = context.finish(&mut report.sources);
    if city.triangles == 0 {
        bad.fail_with_first()?;
        return Err(empty_city(sources, &report));
    }
    remove_empty_sources(&mut report, &mut set_of_source, &mut city, &mut bad)?;
    report.objects = city.objects.len() as u64;
    report.triangles = city.triangles;
    report.crs.clone_from(&city.crs);
    report.bad_inputs = bad.into_found();
    #[cfg(test)]
    report.sources.iter().for_each(|source| assert_eq!(source.unaccounted(), 0, "{source:?}"));
    Ok(ReadCity { city, report, set_of_texture, set_of_source })
}

/// Removes the sources of which nothing is left, and their coordinate system, from the city that the others give. Fails if
/// there is one, unless bad inputs are skipped.
fn remove_empty_sources(
    report: &mut ReadReport,
    set_of_source: &mut Vec<u32>,
    city: &mut ScratchScene,
    bad: &mut BadInputs,
) -> Result<(), InputError> {
    let count = report.sources.len();
    let all = std::mem::take(&mut report.sources).into_iter().zip(std::mem::take(set_of_source));
    for (source, set) in all {
        if let Some(error) = nothing_left(&source) {
            bad.add(&source.path, error)?;
        } else {
            report.sources.push(source);
            set_of_source.push(set);
        }
    }
    if report.sources.len() < count {
        city.crs = report.sources.iter().find_map(|source| source.crs.clone());
    }
    Ok(())
}

/// Reads a source; `None` if it was found in a folder and turns out to be other JSON than a city.
fn read_source(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    tick: ByteProgress<'_>,
) -> Result<Option<SourceReport>, InputError> {
    match kind_by_name(&source.name) {
        Some(SourceKind::Json) => {
            let json_type = geojson::read_type(source, context.options.max_line_bytes);
            match json_type.as_deref() {
                Some("FeatureCollection") => geojson::read(context, source, tick).map(Some),
                _ => cityjson::read(context, source, tick),
            }
        }
        Some(SourceKind::JsonLines) => cityjson::read(context, source, tick),
        Some(SourceKind::GeoJson | SourceKind::GeoJsonLines) => geojson::read(context, source, tick).map(Some),
        Some(SourceKind::Obj) => obj::read(context, source, tick).map(Some),
        None => Err(unread_formats::refusal(&source.label)),
    }
}

fn empty_city(sources: &[CitySource<'_>], report: &ReadReport) -> InputError {
    let first = sources.first().map_or("", |source| &source.label);
    let more = if sources.len() > 1 { format!(" and {} more", sources.len() - 1) } else { String::new() };
    let hint = report.main_reason().map(|reason| format!(" ({reason})")).unwrap_or_default();
    InputError::Empty { sources: format!("{first}{more}"), hint }
}
