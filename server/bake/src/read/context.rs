//! Options and shared state of reading.

use std::path::PathBuf;

use super::facade::{FacadeMaker, FacadeOption, FacadeUse};
use super::palette::Palette;
use super::polygon::Triangulator;
use super::report::{FacadeReport, SourceReport};
use super::scene_builder::{OpenObject, SceneBuilder, WorldTriangle};
use super::texture::TextureLoader;
use crate::error::InputError;
use crate::scene::scratch_scene::ScratchScene;
use crate::scene::texture_store::TextureStore;
use crate::scene::triangle_store::TriangleStore;

/// The vertical axis of an OBJ file. In the other formats it is always z.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ObjUpAxis {
    /// x is east, y is north.
    #[default]
    Z,
    /// x is east, z is south, as modelling programs export.
    Y,
}

/// How to read, and the limits.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadOptions {
    pub obj_up: ObjUpAxis,
    /// Images with more pixels are not decoded.
    pub max_texture_pixels: u64,
    /// Sources with more unpacked bytes are refused.
    pub max_source_bytes: u64,
    /// CityJSON documents with more unpacked bytes are refused: the text is in memory while it is read.
    pub max_document_bytes: u64,
    /// Longer lines of a CityJSONSeq or GeoJSON are skipped. A larger feature of a GeoJSON document is an error.
    pub max_line_bytes: u64,
    /// Colours of surfaces, and what is done with those of the source.
    pub palette: Palette,
    /// Folders from which textures and material libraries may be read besides the source's own.
    pub texture_roots: Vec<PathBuf>,
    /// Side of a leaf's column in metres: an object with too much surface for it is left out.
    pub cell_m: f64,
    /// What walls without a texture get.
    pub facades: FacadeOption,
    /// Whether inputs that cannot be read, or of which nothing is left, are left out instead of being errors.
    pub skip_bad_inputs: bool,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            obj_up: ObjUpAxis::Z,
            max_texture_pixels: 64 << 20,
            max_source_bytes: 8 << 30,
            max_document_bytes: 8 << 30,
            max_line_bytes: 256 << 20,
            palette: Palette::default(),
            texture_roots: Vec::new(),
            cell_m: 1.0,
            facades: FacadeOption::default(),
            skip_bad_inputs: false,
        }
    }
}

/// Receives the number of bytes of the current source that are done.
pub(crate) type ByteProgress<'a> = &'a dyn Fn(u64);

/// The state that all sources of a city share.
pub(crate) struct ReadContext<'o> {
    pub(crate) options: &'o ReadOptions,
    pub(crate) builder: SceneBuilder,
    pub(crate) textures: TextureLoader,
    pub(crate) triangulator: Triangulator,
    /// Index of the current source.
    pub(crate) source: usize,
    crs: Option<NamedCrs>,
    facades: FacadeMaker,
}

/// The state before a source.
pub(crate) struct SourceMark {
    objects: usize,
    crs: Option<NamedCrs>,
}

/// A coordinate system and the first source that named it.
#[derive(Clone)]
struct NamedCrs {
    crs: String,
    path: String,
}

impl<'o> ReadContext<'o> {
    pub(crate) fn new(options: &'o ReadOptions, triangles: TriangleStore, textures: TextureStore) -> Self {
        Self {
            options,
            builder: SceneBuilder::new(triangles, options.cell_m),
            textures: TextureLoader::new(options.max_texture_pixels, textures),
            triangulator: Triangulator::new(),
            source: 0,
            crs: None,
            facades: FacadeMaker::default(),
        }
    }

    /// Moves faces to an object that is open in the builder. If facades are generated, walls get them by the building's
    /// use.
    pub(crate) fn push(&mut self, open: &mut OpenObject, faces: &mut Vec<WorldTriangle>, facade_use: FacadeUse) {
        if self.options.facades == FacadeOption::Windows {
            let has_facade = self.facades.apply(faces, facade_use, &mut self.builder, &mut self.textures);
            if has_facade && !std::mem::replace(&mut open.has_facade, true) {
                self.facades.count_object();
            }
        }
        self.builder.push(open, faces);
        faces.clear();
    }

    /// The generated facades so far; `None` without.
    pub(crate) fn take_facades(&mut self) -> Option<FacadeReport> {
        std::mem::take(&mut self.facades).into_report()
    }

    /// The state before the next source.
    pub(crate) fn mark(&self) -> SourceMark {
        SourceMark { objects: self.builder.len(), crs: self.crs.clone() }
    }

    /// Leaves out a source that failed, as far as it was read since the mark.
    pub(crate) fn abandon_source(&mut self, SourceMark { objects, crs }: SourceMark) {
        self.builder.abandon_since(objects);
        self.crs = crs;
    }

    /// The city's coordinate system, if a source named one.
    pub(crate) fn crs(&self) -> Option<&str> {
        self.crs.as_ref().map(|named| named.crs.as_str())
    }

    /// Sets the city's coordinate system. Fails if another source uses a different one. A source that names none is
    /// assumed to use that of the others.
    pub(crate) fn agree_on_crs(&mut self, path: &str, crs: Option<&str>) -> Result<(), InputError> {
        let Some(crs) = crs else { return Ok(()) };
        match &self.crs {
            None => self.crs = Some(NamedCrs { crs: crs.to_owned(), path: path.to_owned() }),
            Some(first) if first.crs == crs => {}
            Some(first) => {
                return Err(InputError::CrsMismatch {
                    path: path.to_owned(),
                    crs: crs.to_owned(),
                    first_path: first.path.clone(),
                    first_crs: first.crs.clone(),
                });
            }
        }
        Ok(())
    }

    /// The city of all sources. Corrects the reports for objects that are left out because they are too far away.
    pub(crate) fn finish(self, sources: &mut [SourceReport]) -> ScratchScene {
        let mut city = self.builder.finish(self.textures.textures, sources);
        city.crs = self.crs.map(|named| named.crs);
        city
    }
}
