//! Reads city files of several formats into one city.
//!
//! In: files, folders or embedded bytes. Out: `ScratchScene`, or a whole [`Scene`], and [`ReadReport`].
//! Next: `partition`.

mod bad_inputs;
mod context;
mod duplicates;
mod facade_city;
mod json_kind;
mod landmark;
mod list;
mod part;
mod proposal;
mod proposal_options;
mod scene_builder;
mod sink;
mod slice;
mod stone;
mod survey;
#[cfg(test)]
mod tests;
mod texture;
mod texture_level;

use crate::error::BakeError;
use crate::scene::Scene;
use crate::scene::scratch_budget::ScratchBudget;
use crate::scene::scratch_scene::ScratchScene;
use crate::scene::texture_store::TextureStore;
use crate::scene::triangle_store::TriangleStore;
use bad_inputs::{BadInputs, TOO_SMALL, nothing_left};
use context::{ByteProgress, ReadContext};
pub use context::{ObjUpAxis, ReadOptions};
pub use duplicates::DuplicateOption;
pub use insula_dress::facade::{ALGORITHM as FACADE_ALGORITHM, FacadeOption};
pub use insula_dress::footprint::{BuildingHeight, GroundPlans, PrismMaterials};
use insula_dress::map_store::MapStore;
pub use insula_dress::palette::{Palette, PaletteMode};
pub use insula_dress::polygon::Triangulator;
pub use insula_place::PlacingOptions;
pub use insula_place::earth_place::EarthPlace;
pub use insula_place::placement::{AxisOrders, AxisRule};
use insula_read_city::{CityJsonForm, read_citygml};
pub(crate) use insula_read_ground::elevation::{ALIGNED_LEAVES, FarModels, LandFacts, LandSquare};
pub use insula_read_ground::elevation::{SurroundingsOptions, TerrainOptions};
use insula_read_map::{osm, vector};
use insula_read_scene::{read_3d_tiles, read_gltf, read_i3s, read_mesh, read_obj};
use insula_scratch::record_list::RecordScratch;
pub use insula_source::address_reader::{AddressReader, ListedObject};
pub use insula_source::attributes::NamePatterns;
pub use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::ObjectSink;
pub use insula_source::object::{FeatureKind, KindFilter};
use insula_source::problems::{FEW_CORNERS, INEXACT};
pub use insula_source::report::{
    AttributeCount, BadInput, ColourCounts, FacadeReport, FaultCount, ProposalReport, ReadReport, SourceFormat,
    SourceReport,
};
pub use insula_source::source::ReadProgress;
use insula_source::source::{CitySource, SourceKind, embedded, kind_by_name, open};
pub use insula_source::units::HeightUnit;
use insula_source::{subject, unread_formats};
use json_kind::JsonKind;
pub use landmark::cell_of_monument;
use list::SourceList;
pub use list::named_paths;
pub(crate) use part::{ListedInputs, PartHead, PartsCity, RECORDS, SHAPES, SceneParts, TRIANGLES, records_of};
pub use proposal_options::{AddedContent, AddedInput, ProposalOptions, RemovedObject};
use sink::SceneSink;
use std::collections::VecDeque;
use std::io::Read;
use std::path::{Path, PathBuf};
pub use survey::{InputSurvey, survey};

/// Name of the file that describes a folder of terrain tiles.
const TERRAIN_LAYER: &str = "layer.json";

/// Memory of the shapes that are painted on terrain, and of the bases of buildings that it meets; further ones are in
/// scratch files of at most this size each.
const MAX_SHAPE_BYTES: u64 = 32 << 20;
const MAX_SHAPE_FILE_BYTES: u64 = 16 << 30;

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
    let listed = list::list(inputs, options, &mut bad)?;
    read_scene(&listed, bad, options, progress)
}

/// Reads city files from memory, each named as it would be on disk. Material libraries and textures are looked up among
/// the given files by the name that the city file uses. Fails as [`read`] does.
pub fn read_embedded(
    files: &[(&str, &[u8])],
    options: &ReadOptions,
    progress: &dyn Fn(ReadProgress),
) -> Result<(Scene, ReadReport), InputError> {
    let listed = SourceList { sources: embedded(files), unread: Vec::new() };
    read_scene(&listed, BadInputs::new(options.skip_bad_inputs), options, progress)
}

/// Where [`read_to_disk`] keeps triangles, textures and objects.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ScratchOptions<'a> {
    /// An existing folder.
    pub(crate) folder: &'a Path,
    /// Size of the loaded textures together.
    pub(crate) texture_cache_bytes: usize,
    /// Bounds the files.
    pub(crate) budget: &'a ScratchBudget,
}

/// Reads as [`read`] does, but keeps triangles, textures and what is known of each object in scratch files. Fails also if these cannot be written.
pub(crate) fn read_to_disk(
    inputs: &[PathBuf],
    options: &ReadOptions,
    scratch: ScratchOptions<'_>,
    progress: &dyn Fn(ReadProgress),
) -> Result<(ScratchScene, Option<FarModels>, ReadReport), BakeError> {
    let triangles = TriangleStore::in_file(scratch.folder.join("triangles"), scratch.budget.clone())?;
    let folder = scratch.folder.to_owned();
    let textures = TextureStore::in_folder(folder, scratch.texture_cache_bytes, scratch.budget.clone());
    let mut context = ReadContext::new(options, triangles, textures)?;
    context.builder.keep_in(&RecordScratch::in_folder(scratch.folder));
    context.shapes = MapStore::new(&scratch.folder.join("shapes"), MAX_SHAPE_BYTES, MAX_SHAPE_FILE_BYTES);
    context.elevation.bases = MapStore::new(&scratch.folder.join("bases"), MAX_SHAPE_BYTES, MAX_SHAPE_FILE_BYTES);
    let mut bad = BadInputs::new(options.skip_bad_inputs);
    let listed = list::list(inputs, options, &mut bad)?;
    let mut read = read_city(&listed, bad, context, progress)?;
    read.city.stored.finish()?;
    read.city.records.finish()?;
    read.city.textures.finish()?;
    read.level_textures(options)?;
    Ok((read.city, read.surroundings, read.report))
}

fn read_scene(
    listed: &SourceList<'_>,
    bad: BadInputs,
    options: &ReadOptions,
    progress: &dyn Fn(ReadProgress),
) -> Result<(Scene, ReadReport), InputError> {
    let context = ReadContext::new(options, TriangleStore::Memory(Vec::new()), TextureStore::in_memory())?;
    let mut read = read_city(listed, bad, context, progress)?;
    let label = || listed.sources.first().map_or(String::new(), |source| source.label.clone());
    let levelled = read.level_textures(options);
    let scene = levelled.and_then(|()| read.city.into_scene());
    Ok((scene.map_err(|error| InputError::io(&label(), std::io::Error::other(error)))?, read.report))
}

/// A city as it is read, with the textures of photos at the level that they have.
struct ReadCity {
    city: ScratchScene,
    surroundings: Option<FarModels>,
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

/// Reads the sources, the landmarks and the proposal into a city.
fn read_city(
    listed: &SourceList<'_>,
    bad: BadInputs,
    context: ReadContext<'_>,
    progress: &dyn Fn(ReadProgress),
) -> Result<ReadCity, InputError> {
    let mut read = read_sources(listed, bad, context, progress)?;
    let ReadSources { context, report, set_of_source, bad } = &mut read;
    read_landmarks(context, bad, report, set_of_source)?;
    proposal::apply(context, report, set_of_source)?;
    finish_city(read)
}

/// Reads all sources, elevation models first.
fn read_sources<'o>(
    listed: &SourceList<'_>,
    mut bad: BadInputs,
    mut context: ReadContext<'o>,
    progress: &dyn Fn(ReadProgress),
) -> Result<ReadSources<'o>, InputError> {
    let sources = &listed.sources;
    if sources.is_empty() {
        bad.fail_with_first()?;
        return Err(InputError::NoSource { path: "the input".to_owned() });
    }
    let bytes_total = sources.iter().map(|source| source.bytes).sum();
    let mut report = ReadReport { unread: listed.unread.clone(), ..ReadReport::default() };
    let mut set_of_source = Vec::new();
    let mut bytes_before = 0;
    // Buildings stand on the ground, so its heights come first.
    let (elevation, others): (Vec<_>, Vec<_>) = sources.iter().partition(|source| is_elevation(source));
    let mut waiting: VecDeque<&CitySource<'_>> = elevation.into_iter().chain(others).collect();
    let mut postponed = Vec::new();
    context.is_last_resort = sources.len() == 1;
    while let Some(source) = waiting.pop_front() {
        let tick = |done: u64| {
            progress(ReadProgress { bytes_done: bytes_before + done.min(source.bytes), bytes_total });
        };
        tick(0);
        context.source = report.sources.len();
        subject::set(format_args!("{}", source.label));
        settle_for_area(&mut context, source)?;
        let mark = context.mark();
        let result = if context.options.is_monument {
            landmark::read_alone(&mut context, source).map(Some)
        } else {
            read_source(&mut context, source, &tick)
        };
        if matches!(result, Err(InputError::NoProjection { .. })) && !context.is_last_resort {
            context.abandon_source(mark)?;
            postponed.push(source);
        } else {
            match bad.skip(&source.label, result)? {
                Some(Some(read)) => {
                    report.sources.push(read);
                    set_of_source.push(context.textures.set_of(source));
                }
                Some(None) => report.ignored.push(source.label.clone()),
                None => context.abandon_source(mark)?,
            }
            bytes_before += source.bytes;
        }
        if waiting.is_empty() && !postponed.is_empty() {
            context.is_last_resort = true;
            waiting.extend(std::mem::take(&mut postponed));
        }
    }
    progress(ReadProgress { bytes_done: bytes_total, bytes_total });
    Ok(ReadSources { context, report, set_of_source, bad })
}

/// Finds the city's system by the first place of a source, if only an area in metres of that system is wanted: readers leave out what is
/// outside only if they know it before. An error of the source comes again when it is read.
fn settle_for_area(context: &mut ReadContext<'_>, source: &CitySource<'_>) -> Result<(), InputError> {
    let PlacingOptions { bbox_deg, bbox_m, .. } = context.options.placing;
    let is_needed = bbox_deg.is_none() && bbox_m.is_some() && context.is_last_resort && !context.world.is_settled();
    if !is_needed || is_elevation(source) || context.options.is_monument {
        return Ok(());
    }
    let mark = context.mark();
    context.ends_at_place = true;
    let result = read_source(context, source, &|_| {});
    context.ends_at_place = false;
    let found = context.world.clone();
    context.abandon_source(mark)?;
    if matches!(result, Err(InputError::Settled { .. })) {
        context.world.take_system(found);
    }
    Ok(())
}

/// What all sources have, before anything is decided that depends on all of them.
struct ReadSources<'o> {
    context: ReadContext<'o>,
    report: ReadReport,
    set_of_source: Vec<u32>,
    bad: BadInputs,
}

/// Makes a city of what the sources have. Fails if nothing is left of a source, or of all.
fn finish_city(read: ReadSources<'_>) -> Result<ReadCity, InputError> {
    let ReadSources { mut context, mut report, mut set_of_source, mut bad } = read;
    context.fit_ground(&mut report.sources)?;
    context.add_terrain(&mut report.sources)?;
    let surroundings = context.take_surroundings()?;
    report.facades = report.facades.take().or_else(|| context.take_facades());
    let set_of_texture = std::mem::take(&mut context.textures.set_of_texture);
    let first = report.sources.first().map_or(String::new(), |source| source.path.clone());
    let failed = |error: BakeError| InputError::io(&first, std::io::Error::other(error));
    let placing = &context.options.placing;
    let mut city = context.finish(&mut report).map_err(failed)?;
    if city.triangles == 0 {
        bad.fail_with_first()?;
        return Err(empty_city(&report, placing));
    }
    remove_empty_sources(&mut report, &mut set_of_source, &mut city, &mut bad)?;
    report.objects = city.objects.len() as u64;
    report.triangles = city.triangles;
    report.crs.clone_from(&city.crs);
    report.bad_inputs.extend(bad.into_found());
    #[cfg(test)]
    report.sources.iter().for_each(|source| assert_eq!(source.unaccounted(), 0, "{source:?}"));
    Ok(ReadCity { city, surroundings, report, set_of_texture, set_of_source })
}

/// Makes level ground if there has to be some, and reads the landmarks that the options name. Fails as [`landmark::read`], unless bad inputs are skipped.
fn read_landmarks(
    context: &mut ReadContext<'_>,
    bad: &mut BadInputs,
    report: &mut ReadReport,
    set_of_source: &mut Vec<u32>,
) -> Result<(), InputError> {
    // Landmarks stand on it.
    context.level_ground(&report.sources)?;
    let Some(file) = &context.options.landmarks else { return Ok(()) };
    context.is_last_resort = true;
    for plan in landmark::read_plans(file)? {
        let listed = list::list_mesh(std::slice::from_ref(&plan.mesh), context.options, bad)?;
        for source in &listed.sources {
            context.source = report.sources.len();
            subject::set(format_args!("{}", source.label));
            let mark = context.mark();
            match bad.skip(&source.label, landmark::read(context, source, &plan))? {
                Some(read) => {
                    report.sources.push(read);
                    set_of_source.push(context.textures.set_of(source));
                }
                None => context.abandon_source(mark)?,
            }
        }
    }
    context.stand_landmarks()
}

/// Removes the sources of which nothing is left, and the coordinate system that only they have. Fails if there is one,
/// unless bad inputs are skipped.
fn remove_empty_sources(
    report: &mut ReadReport,
    set_of_source: &mut Vec<u32>,
    city: &mut ScratchScene,
    bad: &mut BadInputs,
) -> Result<(), InputError> {
    let count = report.sources.len();
    let is_alone = report.sources.iter().all(|source| source.objects + source.painted == 0);
    let all = std::mem::take(&mut report.sources).into_iter().zip(std::mem::take(set_of_source));
    for (source, set) in all {
        if let Some(error) = nothing_left(&source, is_alone) {
            bad.add(&source.path, error)?;
        } else {
            report.sources.push(source);
            set_of_source.push(set);
        }
    }
    if report.sources.len() < count && report.sources.iter().all(|source| source.crs.is_none()) {
        city.crs = None;
    }
    Ok(())
}

/// Reads a source; `None` if it was found in a folder and turns out not to be a city.
fn read_source(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    tick: ByteProgress<'_>,
) -> Result<Option<SourceReport>, InputError> {
    // Any folder has files of these names that are no cities.
    let is_common = matches!(
        kind_by_name(&source.name),
        Some(SourceKind::Json | SourceKind::JsonLines | SourceKind::Xml | SourceKind::Csv)
    );
    match read_by_kind(context, source, tick) {
        Err(InputError::Unsupported { .. } | InputError::UnknownFormat { .. }) if source.found && is_common => Ok(None),
        Err(
            error @ (InputError::Json { .. }
            | InputError::Damaged { .. }
            | InputError::Unsupported { .. }
            | InputError::UnknownFormat { .. }),
        ) => Err(other_content(source).unwrap_or(error)),
        result => result,
    }
}

/// The error of a source with the content of another format than its name says; `None` if that is not known.
fn other_content(source: &CitySource<'_>) -> Option<InputError> {
    let mut start = Vec::new();
    open(source).ok()?.reader.take(unread_formats::CONTENT_BYTES).read_to_end(&mut start).ok()?;
    unread_formats::by_content(&source.label, &start)
}

fn read_by_kind(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    tick: ByteProgress<'_>,
) -> Result<Option<SourceReport>, InputError> {
    let Some(kind) = kind_by_name(&source.name) else { return Err(unread_formats::refusal(&source.label)) };
    if source.is_surroundings && !is_elevation(source) {
        let what = "surroundings are elevation models and pictures from above: give it as an input of the city";
        return Err(InputError::unsupported(&source.label, what));
    }
    if source.is_streets && is_elevation(source) {
        let what = "streets are areas and lines on the map: give an elevation model as an input of the city";
        return Err(InputError::unsupported(&source.label, what));
    }
    let (format, reader): (SourceFormat, Reader) = match kind {
        SourceKind::Json => match json_kind::of(source) {
            JsonKind::Tileset => (SourceFormat::Tiles3d, read_3d_tiles),
            JsonKind::SceneLayer => (SourceFormat::I3s, read_i3s),
            JsonKind::Terrain => return open_elevation(context, source).map(Some),
            JsonKind::GeoJson => (SourceFormat::GeoJson, vector::read_geojson),
            JsonKind::Other => return read_cityjson(context, source, CityJsonForm::Document, tick).map(Some),
        },
        SourceKind::JsonLines if json_kind::of(source) == JsonKind::GeoJson => {
            (SourceFormat::GeoJson, vector::read_geojson)
        }
        SourceKind::JsonLines => return read_cityjson(context, source, CityJsonForm::Sequence, tick).map(Some),
        SourceKind::GeoJson | SourceKind::GeoJsonLines => (SourceFormat::GeoJson, vector::read_geojson),
        SourceKind::Obj => (SourceFormat::Obj, read_obj),
        SourceKind::Xml => (SourceFormat::CityGml, read_citygml),
        SourceKind::FlatGeobuf => (SourceFormat::FlatGeobuf, vector::read_flatgeobuf),
        SourceKind::GeoPackage => (SourceFormat::GeoPackage, vector::read_geopackage),
        SourceKind::Shapefile => (SourceFormat::Shapefile, vector::read_shapefile),
        SourceKind::GeoParquet => (SourceFormat::GeoParquet, vector::read_geoparquet),
        SourceKind::Csv => (SourceFormat::Csv, vector::read_csv),
        SourceKind::OpenStreetMap => (SourceFormat::OpenStreetMap, osm::read),
        SourceKind::Gltf => (SourceFormat::Gltf, read_gltf),
        SourceKind::Ply => (SourceFormat::Ply, read_mesh),
        SourceKind::Stl => (SourceFormat::Stl, read_mesh),
        SourceKind::Off => (SourceFormat::Off, read_mesh),
        SourceKind::Tile => (SourceFormat::Tiles3d, read_3d_tiles),
        SourceKind::Elevation => return open_elevation(context, source).map(Some),
    };
    let mut sink = SceneSink::new(context, source, format, tick)?;
    let input = sink.input();
    reader(&input, &mut sink)?;
    Ok(Some(sink.into_report()))
}

/// Reads CityJSON of the form that its name tells. Fails as [`insula_read_city::read_cityjson`].
fn read_cityjson(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    form: CityJsonForm,
    tick: ByteProgress<'_>,
) -> Result<SourceReport, InputError> {
    let ReadOptions { max_source_bytes, max_document_bytes, .. } = *context.options;
    // A sequence is in memory line by line.
    let max_bytes = match form {
        CityJsonForm::Document => max_document_bytes.min(max_source_bytes),
        CityJsonForm::Sequence => u64::MAX,
    };
    let mut sink = SceneSink::new(context, source, SourceFormat::CityJson, tick)?;
    let input = Input { max_bytes, ..sink.input() };
    if insula_read_city::read_cityjson(&input, form, &mut sink)? == CityJsonForm::Sequence {
        sink.set_format(SourceFormat::CityJsonSeq);
    }
    Ok(sink.into_report())
}

/// Opens an elevation model or a picture, which is read later. Fails as `Elevation::open`.
fn open_elevation(context: &mut ReadContext<'_>, source: &CitySource<'_>) -> Result<SourceReport, InputError> {
    let warnings = context.elevation.open(source, context.source, context.options.nodata)?;
    let mut report = SourceReport::new(&source.label, SourceFormat::Elevation, source.bytes);
    for warning in warnings {
        report.problem(INEXACT, || warning);
    }
    Ok(report)
}

/// Reads a source and passes its objects to the sink. Fails if the source cannot be read at all.
type Reader = fn(&Input<'_>, &mut dyn ObjectSink) -> Result<(), InputError>;

fn is_elevation(source: &CitySource<'_>) -> bool {
    match kind_by_name(&source.name) {
        Some(SourceKind::Elevation) => true,
        // The name is checked first: telling the kind of a large document takes time.
        Some(SourceKind::Json) => source.name.ends_with(TERRAIN_LAYER) && json_kind::of(source) == JsonKind::Terrain,
        _ => false,
    }
}

/// Says that nothing was read, and why: most likely the wanted area is elsewhere, if there is one.
fn empty_city(report: &ReadReport, placing: &PlacingOptions) -> InputError {
    let Some(first) = report.sources.first().map(|source| &source.path) else {
        let path = report.ignored.first().cloned().unwrap_or_default();
        return InputError::NoSource { path };
    };
    let others = report.sources.len().saturating_sub(1);
    let more = if others > 0 { format!(" and {others} more") } else { String::new() };
    let sources = format!("{first}{more}");
    let in_degrees = "check that the input reaches into this area, which is west, south, east and north in degrees";
    let in_metres = "check that the input reaches into this area, which is west, south, east and north in metres of the city's coordinate system (--crs)";
    let wanted = match (placing.bbox_deg, placing.bbox_m) {
        (Some(degrees), _) => Some(("--bbox", degrees, in_degrees)),
        (None, metres) => metres.map(|metres| ("--bbox-metres", metres, in_metres)),
    };
    if let Some((option, corners, advice)) = wanted {
        let hint = format!(" in {option} {}", corners.map(|side| side.to_string()).join(","));
        return InputError::Empty { sources, hint, advice };
    }
    let hint = report.main_reason().map(|reason| format!(" ({reason})")).unwrap_or_default();
    let is_small = |source: &SourceReport| source.crs.is_some() && source.skipped.contains_key(FEW_CORNERS);
    let advice = if report.sources.iter().any(is_small) { TOO_SMALL } else { "check that the input contains surfaces" };
    InputError::Empty { sources, hint, advice }
}
