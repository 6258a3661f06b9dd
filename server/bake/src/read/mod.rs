//! City files of several formats to one city.
//!
//! In: files, folders or embedded bytes. Out: `ScratchScene`, or a whole [`Scene`], and [`ReadReport`]. Next: `partition`.

mod builder;
mod cityjson;
mod error;
mod geojson;
mod obj;
mod palette;
mod polygon;
mod report;
mod source;
#[cfg(test)]
mod tests;
mod texture;

use std::path::{Path, PathBuf};

pub use error::InputError;
pub use palette::Palette;
pub use report::{FaultCount, ReadReport, SourceFormat, SourceReport};
pub use source::ReadProgress;

use crate::error::BakeError;
use crate::scene::Scene;
use crate::scene::scratch_scene::{ScratchScene, TextureStore, TriangleStore};
use builder::SceneBuilder;
use polygon::Triangulator;
use source::{CitySource, SourceKind, named_as};
use texture::TextureLoader;

/// Which axis of an OBJ points up; CityJSON's is always z.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum UpAxis {
    /// x east, y north.
    #[default]
    Z,
    /// x east, z south, as modelling programs export.
    Y,
}

/// How to read, and how much.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReadOptions {
    /// Which axis of an OBJ points up.
    pub obj_up: UpAxis,
    /// A picture of more pixels is not decoded.
    pub max_texture_pixels: u64,
    /// A source of more unpacked bytes is refused.
    pub max_source_bytes: u64,
    /// A line of a CityJSONSeq or of a GeoJSON of more bytes is skipped; a larger feature of a GeoJSON document is
    /// refused.
    pub max_line_bytes: u64,
    /// Colours where the source has none.
    pub palette: Palette,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            obj_up: UpAxis::Z,
            max_texture_pixels: 64 << 20,
            max_source_bytes: 8 << 30,
            max_line_bytes: 256 << 20,
            palette: Palette::default(),
        }
    }
}

/// Tells how many bytes of the current source are done.
pub(crate) type ByteProgress<'a> = &'a dyn Fn(u64);

/// What all sources of one reading share.
pub(crate) struct ReadContext<'o> {
    pub(crate) options: &'o ReadOptions,
    pub(crate) builder: SceneBuilder,
    pub(crate) textures: TextureLoader,
    pub(crate) triangulator: Triangulator,
    /// Number of the source that is being read.
    pub(crate) source: usize,
    /// The first coordinate system named, and by which source.
    crs: Option<(String, String)>,
}

impl<'o> ReadContext<'o> {
    fn new(options: &'o ReadOptions, triangles: TriangleStore, pictures: TextureStore) -> Self {
        Self {
            options,
            builder: SceneBuilder::new(triangles),
            textures: TextureLoader::new(options.max_texture_pixels, pictures),
            triangulator: Triangulator::new(),
            source: 0,
            crs: None,
        }
    }

    /// A source without a system is taken to lie in that of the others.
    pub(crate) fn agree_on_crs(&mut self, path: &str, crs: Option<&str>) -> Result<(), InputError> {
        let Some(crs) = crs else { return Ok(()) };
        match &self.crs {
            None => self.crs = Some((crs.to_owned(), path.to_owned())),
            Some((first, _)) if first == crs => {}
            Some((first_crs, first_path)) => {
                return Err(InputError::CrsMismatch {
                    path: path.to_owned(),
                    crs: crs.to_owned(),
                    first_path: first_path.clone(),
                    first_crs: first_crs.clone(),
                });
            }
        }
        Ok(())
    }
}

/// Reads files and folders (every city file directly in them, by name) into one scene.
///
/// # Errors
///
/// If a source cannot be read at all, if sources disagree on the coordinate system, or if no triangle comes of them.
/// Faults of single objects are in the report instead.
pub fn read(
    inputs: &[PathBuf],
    options: &ReadOptions,
    progress: &dyn Fn(ReadProgress),
) -> Result<(Scene, ReadReport), InputError> {
    read_scene(&source::list(inputs)?, options, progress)
}

/// Reads city files from memory. Each is named as it would be on disk; material libraries and pictures are found
/// among the given files by the name that the city file has for them.
///
/// # Errors
///
/// As [`read`].
pub fn read_embedded(
    files: &[(&str, &[u8])],
    options: &ReadOptions,
    progress: &dyn Fn(ReadProgress),
) -> Result<(Scene, ReadReport), InputError> {
    read_scene(&source::embedded(files), options, progress)
}

/// Reads as [`read`] does, but triangles and pictures go into files of the folder `spool`, which is there; of pictures at
/// most `picture_bytes` are held later on.
pub(crate) fn read_to_disk(
    inputs: &[PathBuf],
    options: &ReadOptions,
    (spool, picture_bytes): (&Path, usize),
    progress: &dyn Fn(ReadProgress),
) -> Result<(ScratchScene, ReadReport), BakeError> {
    let triangles = TriangleStore::in_file(spool.join("triangles"))?;
    let pictures = TextureStore::in_folder(spool.to_owned(), picture_bytes);
    let (mut city, report) = read_sources(&source::list(inputs)?, options, (triangles, pictures), progress)?;
    city.stored.finish()?;
    city.pictures.finish()?;
    Ok((city, report))
}

fn read_scene(
    sources: &[CitySource<'_>],
    options: &ReadOptions,
    progress: &dyn Fn(ReadProgress),
) -> Result<(Scene, ReadReport), InputError> {
    let kept = (TriangleStore::Memory(Vec::new()), TextureStore::in_memory());
    let (city, report) = read_sources(sources, options, kept, progress)?;
    let label = || sources.first().map_or(String::new(), |source| source.label.clone());
    let scene = city.into_scene().map_err(|error| InputError::io(&label(), std::io::Error::other(error)))?;
    Ok((scene, report))
}

fn read_sources(
    sources: &[CitySource<'_>],
    options: &ReadOptions,
    (triangles, pictures): (TriangleStore, TextureStore),
    progress: &dyn Fn(ReadProgress),
) -> Result<(ScratchScene, ReadReport), InputError> {
    if sources.is_empty() {
        return Err(InputError::NoSource { path: "the input".to_owned() });
    }
    let bytes_total = sources.iter().map(|source| source.bytes).sum();
    let mut reading = ReadContext::new(options, triangles, pictures);
    let mut report = ReadReport::default();
    let mut bytes_before = 0;
    for source in sources {
        let tick = |done: u64| {
            progress(ReadProgress { bytes_done: bytes_before + done.min(source.bytes), bytes_total });
        };
        tick(0);
        reading.source = report.sources.len();
        match read_source(&mut reading, source, &tick)? {
            Some(read) => report.sources.push(read),
            None => report.ignored.push(source.label.clone()),
        }
        bytes_before += source.bytes;
    }
    progress(ReadProgress { bytes_done: bytes_total, bytes_total });
    let mut city = reading.builder.finish(reading.textures.pictures, &mut report.sources);
    city.crs = reading.crs.map(|(crs, _)| crs);
    report.objects = city.objects.len() as u64;
    report.triangles = city.triangles;
    report.crs.clone_from(&city.crs);
    if city.triangles == 0 { Err(empty(sources, &report)) } else { Ok((city, report)) }
}

fn read_source(
    reading: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    tick: ByteProgress<'_>,
) -> Result<Option<SourceReport>, InputError> {
    match named_as(&source.name) {
        Some(SourceKind::Json) => {
            let kind = geojson::kind_of(source, reading.options.max_line_bytes);
            match kind.as_deref() {
                Some("FeatureCollection") => geojson::read(reading, source, tick).map(Some),
                _ => cityjson::read(reading, source, tick),
            }
        }
        Some(SourceKind::JsonLines) => cityjson::read(reading, source, tick),
        Some(SourceKind::GeoJson | SourceKind::GeoJsonLines) => geojson::read(reading, source, tick).map(Some),
        Some(SourceKind::Obj) => obj::read(reading, source, tick).map(Some),
        None => Err(InputError::unsupported(&source.label, "not a city file by its name")),
    }
}

fn empty(sources: &[CitySource<'_>], report: &ReadReport) -> InputError {
    let first = sources.first().map_or("", |source| &source.label);
    let more = if sources.len() > 1 { format!(" and {} more", sources.len() - 1) } else { String::new() };
    let hint = report.main_reason().map(|reason| format!(" ({reason})")).unwrap_or_default();
    InputError::Empty { sources: format!("{first}{more}"), hint }
}
