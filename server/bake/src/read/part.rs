//! Inputs in parts, which different machines read.
//!
//! A part is a run of sources. It has what its sources have ([`PartHead`]), before anything is decided that depends on all sources,
//! and files of its triangles, records and textures. [`SceneParts`] makes of all parts what reading all sources at once makes.

use super::bad_inputs::BadInputs;
use super::context::{ReadContext, ReadOptions};
use super::list::{self, SourceList};
use super::scene_builder::{BuilderParts, PartObjects, SceneBuilder};
use super::slice::slices;
use super::{
    FarModels, LandFacts, MAX_SHAPE_BYTES, MAX_SHAPE_FILE_BYTES, ReadCity, ReadSources, ScratchOptions, finish_city,
    is_elevation, read_landmarks, read_source, read_sources,
};
use crate::error::BakeError;
use crate::hash::ShortHash;
use crate::scene::object_records::{self, ObjectRecords, RecordPart};
use crate::scene::scratch_budget::ScratchBudget;
use crate::scene::scratch_scene::{ScratchScene, StoredMaterial};
use crate::scene::texture_store::{TextureFacts, TextureStore};
use crate::scene::triangle_store::{TrianglePart, TriangleStore};
use insula_dress::map_store::{MapRecord, MapStore};
use insula_dress::paint::PaintShape;
use insula_scratch::record_list::RecordScratch;
use insula_source::error::InputError;
use insula_source::report::ReadReport;
use insula_source::source::ReadProgress;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Name of a part's file of triangles.
pub(crate) const TRIANGLES: &str = "triangles";
/// Name of a part's file of shapes that are painted on terrain.
pub(crate) const SHAPES: &str = "shapes";

/// Shorter sequences are not divided.
const MIN_SLICE_BYTES: u64 = 1 << 20;

/// The sources of inputs, in the order in which a plain bake reads them.
pub(crate) struct ListedInputs {
    /// Elevation models and pictures from above, which every part opens.
    elevation: SourceList<'static>,
    listed: SourceList<'static>,
}

/// What the sources of a part have.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct PartHead {
    objects: PartObjects,
    pub(crate) materials: Vec<StoredMaterial>,
    /// By the part's own numbers.
    pub(crate) textures: Vec<TextureFacts>,
    /// Index into `sets` of each texture; `None` for a generated one.
    set_of_texture: Vec<Option<u32>>,
    set_of_source: Vec<u32>,
    /// Names of the sets of textures that have one level.
    sets: Vec<String>,
    report: ReadReport,
    /// Size of the file of records.
    pub(crate) record_bytes: u64,
    pub(crate) triangles: u64,
}

impl ListedInputs {
    /// Lists the sources, sequences of more than `slice_bytes` as several. Fails as reading them does, and for a mesh that is the city.
    pub(crate) fn new(inputs: &[PathBuf], options: &ReadOptions, slice_bytes: u64) -> Result<Self, InputError> {
        let listed = list::list(inputs, options, &mut BadInputs::new(options.skip_bad_inputs))?;
        let unsupported =
            |label: &str, what: &str| InputError::unsupported(label, format!("{what} in steps; bake without --work"));
        if let Some(source) = listed.sources.first().filter(|_| options.is_monument) {
            return Err(unsupported(&source.label, "a mesh that is the city is not baked"));
        }
        let (elevation, others): (Vec<_>, Vec<_>) = listed.sources.into_iter().partition(is_elevation);
        let sources = others.into_iter().flat_map(|source| slices(source, slice_bytes.max(MIN_SLICE_BYTES))).collect();
        let elevation = SourceList { sources: elevation, unread: Vec::new() };
        Ok(Self { elevation, listed: SourceList { sources, unread: listed.unread } })
    }

    /// Size of each source in bytes; of the elevation models and pictures besides.
    pub(crate) fn sizes(&self) -> (Vec<u64>, Vec<u64>) {
        let of = |list: &SourceList<'_>| list.sources.iter().map(|source| source.bytes).collect();
        (of(&self.listed), of(&self.elevation))
    }

    /// Moves sources with these numbers behind the others, see [`Self::settle`].
    pub(crate) fn postpone(&mut self, postponed: &[usize]) {
        let all = std::mem::take(&mut self.listed.sources).into_iter().enumerate();
        let (last, first): (Vec<_>, Vec<_>) = all.partition(|(number, _)| postponed.contains(number));
        self.listed.sources = first.into_iter().chain(last).map(|(_, source)| source).collect();
    }

    /// The coordinate system that a city of all sources has; `None` if none of them has one. And the numbers of the sources that wait for
    /// it, because they have none: these are read last. Reads the sources as far as their first place. Fails as reading them does.
    pub(crate) fn settle(&self, options: &ReadOptions) -> Result<(Option<String>, Vec<usize>), InputError> {
        let mut context = self.context(options, TriangleStore::Memory(Vec::new()), TextureStore::in_memory())?;
        context.ends_at_place = true;
        let mut postponed = Vec::new();
        for is_last_resort in [self.listed.sources.len() + self.elevation.sources.len() == 1, true] {
            context.is_last_resort = is_last_resort;
            for (number, source) in self.listed.sources.iter().enumerate() {
                if context.world.is_settled() {
                    return Ok((context.world.crs_name(), postponed));
                }
                let mark = context.mark();
                match read_source(&mut context, source, &|_| {}) {
                    Ok(_) | Err(InputError::Settled { .. }) => {}
                    Err(InputError::NoProjection { .. }) if !is_last_resort => {
                        context.abandon_source(mark)?;
                        postponed.push(number);
                    }
                    Err(_) if options.skip_bad_inputs => context.abandon_source(mark)?,
                    Err(error) => return Err(error),
                }
            }
        }
        Ok((context.world.crs_name(), postponed))
    }

    /// The land around the city, of which `facts` are known. Fails if a model cannot be opened or placed.
    pub(crate) fn land(&self, options: &ReadOptions, facts: LandFacts) -> Result<FarModels, InputError> {
        let context = self.context(options, TriangleStore::Memory(Vec::new()), TextureStore::in_memory())?;
        context.into_land(facts)
    }

    /// The state of a reader that has opened the elevation models. Fails if one cannot be opened, unless bad inputs are skipped.
    fn context<'o>(
        &self,
        options: &'o ReadOptions,
        triangles: TriangleStore,
        textures: TextureStore,
    ) -> Result<ReadContext<'o>, InputError> {
        let mut context = ReadContext::new(options, triangles, textures)?;
        for source in &self.elevation.sources {
            match read_source(&mut context, source, &|_| {}) {
                Err(_) if options.skip_bad_inputs => {}
                opened => drop(opened?),
            }
        }
        Ok(context)
    }

    /// Reads a run of the sources into files in the scratch folder. Fails as reading them does.
    pub(crate) fn read(
        mut self,
        range: Range<usize>,
        options: &ReadOptions,
        scratch: ScratchOptions<'_>,
        progress: &dyn Fn(ReadProgress),
    ) -> Result<PartHead, BakeError> {
        self.listed.sources = self.listed.sources.drain(range).collect();
        let triangles = TriangleStore::in_file(scratch.folder.join(TRIANGLES), scratch.budget.clone())?;
        let folder = scratch.folder.to_owned();
        let textures = TextureStore::in_folder(folder, scratch.texture_cache_bytes, scratch.budget.clone());
        let mut context = self.context(options, triangles, textures)?;
        context.shapes = MapStore::new(&scratch.folder.join("painted"), MAX_SHAPE_BYTES, MAX_SHAPE_FILE_BYTES);
        let bad = BadInputs::new(options.skip_bad_inputs);
        let (report, set_of_source) = (ReadReport::default(), Vec::new());
        let read = match self.listed.sources.is_empty() {
            true => ReadSources { context, report, set_of_source, bad },
            false => read_sources(&self.listed, bad, context, progress)?,
        };
        let ReadSources { mut context, mut report, set_of_source, bad } = read;
        write_shapes(&context.shapes, &scratch.folder.join(SHAPES))?;
        report.bad_inputs = bad.into_found();
        report.facades = context.take_facades();
        report.vertical_datum = context.world.vertical();
        report.geoid = context.world.geoid();
        let sets = context.textures.set_names();
        let set_of_texture = context.textures.set_of_texture;
        let mut textures = context.textures.textures;
        textures.finish()?;
        let BuilderParts { objects, materials, record_bytes } = context.builder.into_parts()?;
        let triangles = objects.triangles();
        let textures = textures.facts().to_vec();
        Ok(PartHead {
            objects,
            materials,
            textures,
            set_of_texture,
            set_of_source,
            sets,
            report,
            record_bytes,
            triangles,
        })
    }
}

impl PartHead {
    /// Whether all numbers are of things that it has.
    pub(crate) fn is_valid(&self) -> bool {
        let has = |number: Option<u32>, count: usize| number.is_none_or(|number| (number as usize) < count);
        self.textures.len() == self.set_of_texture.len()
            && self.set_of_source.len() == self.report.sources.len()
            && self.materials.iter().all(|material| has(material.texture, self.textures.len()))
            && self.set_of_texture.iter().all(|set| has(*set, self.sets.len()))
            && self.set_of_source.iter().all(|set| has(Some(*set), self.sets.len()))
            && self.objects.is_valid(self.report.sources.len())
    }
}

/// All parts of a city. What is known of each object is in scratch files.
pub(crate) struct SceneParts<'o> {
    /// For scratch files.
    folder: PathBuf,
    read: ReadSources<'o>,
    triangles: Vec<TrianglePart>,
    record_bytes: u64,
}

pub(crate) struct PartsCity {
    pub(crate) city: ScratchScene,
    /// The land around it.
    pub(crate) surroundings: Option<FarModels>,
    pub(crate) report: ReadReport,
    /// For each part, the number in the city of each of its materials.
    pub(crate) materials: Vec<Vec<u32>>,
    /// For each part, the number in the city of its first object, before objects were left out; then that of the first object that is
    /// of no part.
    pub(crate) first_objects: Vec<u32>,
    /// Hash of each texture as it is in the folder of textures: those of the parts, then the city's own.
    pub(crate) pictures: Vec<ShortHash>,
    /// Size of the city's own file of records.
    pub(crate) own_record_bytes: u64,
}

impl<'o> SceneParts<'o> {
    /// Opens the elevation models, if there are any among the inputs. `folder` is for scratch files, `textures` an empty folder for
    /// textures by number. Fails if a model cannot be opened, unless bad inputs are skipped.
    pub(crate) fn new(
        inputs: Option<&ListedInputs>,
        options: &'o ReadOptions,
        folder: &Path,
        textures: &Path,
        texture_cache_bytes: usize,
    ) -> Result<Self, BakeError> {
        let budget = ScratchBudget::new(u64::MAX);
        let store = TextureStore::in_folder(textures.to_owned(), texture_cache_bytes, budget);
        let mut context = ReadContext::new(options, TriangleStore::Memory(Vec::new()), store)?;
        context.builder = SceneBuilder::of_parts(options.cell_m, &RecordScratch::in_folder(folder));
        context.shapes = MapStore::new(&folder.join("shapes"), MAX_SHAPE_BYTES, MAX_SHAPE_FILE_BYTES);
        context.elevation.bases = MapStore::new(&folder.join("bases"), MAX_SHAPE_BYTES, MAX_SHAPE_FILE_BYTES);
        let bad = BadInputs::new(options.skip_bad_inputs);
        let read = match inputs.filter(|inputs| !inputs.elevation.sources.is_empty()) {
            None => ReadSources { context, report: ReadReport::default(), set_of_source: Vec::new(), bad },
            Some(inputs) => read_sources(&inputs.elevation, bad, context, &|_| {})?,
        };
        Ok(Self { folder: folder.to_owned(), read, triangles: Vec::new(), record_bytes: 0 })
    }

    /// Adds a part, in the order of the sources. `triangles` and `shapes` are its files. Fails if the part is damaged.
    pub(crate) fn add(&mut self, head: PartHead, triangles: PathBuf, shapes: &Path) -> Result<(), BakeError> {
        let ReadSources { context, report, set_of_source, .. } = &mut self.read;
        let sets: Vec<u32> = head.sets.iter().map(|name| context.textures.set_of_name(name)).collect();
        let set = |number: u32| sets.get(number as usize).copied();
        let textures = head.textures.into_iter().zip(&head.set_of_texture);
        let textures: Vec<u32> =
            textures.map(|(facts, number)| context.textures.add_known(facts, number.and_then(set))).collect();
        let damaged = || BakeError::Scratch { path: triangles.clone() };
        let mut materials = Vec::with_capacity(head.materials.len());
        for material in head.materials {
            let texture = material.texture.map(|number| textures.get(number as usize).copied().ok_or_else(damaged));
            materials.push(context.builder.material(StoredMaterial { texture: texture.transpose()?, ..material }));
        }
        let first_object = context.builder.len() as u32;
        set_of_source.extend(head.set_of_source.iter().filter_map(|number| set(*number)));
        context.builder.add_part(head.objects, report.sources.len() as u32, self.record_bytes);
        read_shapes(&mut context.shapes, shapes)?;
        self.record_bytes += head.record_bytes;
        merge_reports(report, head.report);
        self.triangles.push(TrianglePart { path: triangles, first_object, materials });
        Ok(())
    }

    /// The textures of all parts by the numbers that they have in the city.
    pub(crate) fn textures(&self) -> &[TextureFacts] {
        self.read.context.textures.textures.facts()
    }

    /// Makes the city, with terrain and landmarks. The textures of all parts must be in their folder. Fails as reading all sources at
    /// once does.
    pub(crate) fn assemble(self, options: &ReadOptions) -> Result<PartsCity, BakeError> {
        let Self { folder, mut read, triangles, record_bytes } = self;
        let budget = ScratchBudget::new(u64::MAX);
        let materials = triangles.iter().map(|part| part.materials.clone()).collect();
        let mut first_objects: Vec<u32> = triangles.iter().map(|part| part.first_object).collect();
        let ReadSources { context, report, set_of_source, bad } = &mut read;
        first_objects.push(context.builder.len() as u32);
        let stored = TriangleStore::of_parts(triangles, folder.join(TRIANGLES), budget)?;
        context.builder.set_stores(ObjectRecords::after(record_bytes, &stored), stored);
        let (vertical_datum, geoid) = (report.vertical_datum.clone(), report.geoid.clone());
        read_landmarks(context, bad, report, set_of_source)?;
        let mut read = finish_city(read)?;
        read.report.vertical_datum = vertical_datum.or(read.report.vertical_datum.take());
        read.report.geoid = geoid.or(read.report.geoid.take());
        read.city.stored.finish()?;
        let own_record_bytes = read.city.records.bytes();
        read.city.records.finish()?;
        read.city.textures.finish()?;
        let pictures = read.city.textures.facts().iter().map(TextureFacts::hash).collect();
        read.level_textures(options)?;
        let ReadCity { city, surroundings, report, .. } = read;
        Ok(PartsCity { city, surroundings, report, materials, first_objects, pictures, own_record_bytes })
    }
}

/// Writes shapes that are painted on terrain, each after its length. Fails if they cannot be read or written.
fn write_shapes(shapes: &MapStore<PaintShape>, path: &Path) -> Result<(), BakeError> {
    let failed = |cause| BakeError::io(path, "written", cause);
    let mut writer = BufWriter::new(File::create(path).map_err(failed)?);
    let written = shapes.try_for_each(|shape| {
        let bytes = shape.encode().ok_or(io::ErrorKind::InvalidData)?;
        writer.write_all(&(bytes.len() as u64).to_le_bytes())?;
        writer.write_all(&bytes)
    });
    written.and_then(|()| writer.flush()).map_err(failed)
}

/// Adds the shapes of a file. Fails if it cannot be read, or is damaged.
fn read_shapes(shapes: &mut MapStore<PaintShape>, path: &Path) -> Result<(), BakeError> {
    let failed = |cause| BakeError::io(path, "read", cause);
    let damaged = || BakeError::Scratch { path: path.to_owned() };
    let file = File::open(path).map_err(failed)?;
    let mut left = file.metadata().map_err(failed)?.len();
    let mut reader = BufReader::new(file);
    while left > 0 {
        let mut length = [0; 8];
        reader.read_exact(&mut length).map_err(failed)?;
        let length = u64::from_le_bytes(length);
        left = left.checked_sub(8).and_then(|left| left.checked_sub(length)).ok_or_else(damaged)?;
        let mut bytes = vec![0; length as usize];
        reader.read_exact(&mut bytes).map_err(failed)?;
        let pushed = shapes.push(PaintShape::decode(&bytes).ok_or_else(damaged)?);
        pushed.map_err(|error| BakeError::io(path, "read", io::Error::other(error)))?;
    }
    Ok(())
}

/// The records of all parts, of files with these numbers of bytes.
pub(crate) fn records_of(files: Vec<(PathBuf, u64)>) -> ObjectRecords {
    let mut start = 0;
    let part = |(path, bytes): (PathBuf, u64)| {
        let part = RecordPart { path, start };
        start += bytes;
        part
    };
    ObjectRecords::Parts(files.into_iter().map(part).collect())
}

/// Name of a part's file of records.
pub(crate) const RECORDS: &str = object_records::FILE_NAME;

fn merge_reports(all: &mut ReadReport, part: ReadReport) {
    let ReadReport { sources, ignored, bad_inputs, vertical_datum, geoid, facades, .. } = part;
    all.sources.extend(sources);
    all.ignored.extend(ignored);
    all.bad_inputs.extend(bad_inputs);
    all.vertical_datum = all.vertical_datum.take().or(vertical_datum);
    all.geoid = all.geoid.take().or(geoid);
    if let Some(part) = facades {
        let sum = all.facades.get_or_insert_default();
        sum.generated |= part.generated;
        sum.objects += part.objects;
        sum.walls += part.walls;
        sum.windows += part.windows;
        sum.textures += part.textures;
    }
}
