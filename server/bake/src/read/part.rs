//! Inputs in parts, which different machines read.
//!
//! A part is a run of sources. It has what its sources have ([`PartHead`]), before anything is decided that depends on all sources,
//! and files of its triangles, records and textures. [`SceneParts`] makes of all parts what reading all sources at once makes.

use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::bad_inputs::BadInputs;
use super::context::{ReadContext, ReadOptions};
use super::list::{self, SourceList};
use super::report::ReadReport;
use super::scene_builder::{BuilderParts, PartObjects, SceneBuilder};
use super::slice::slices;
use super::source::ReadProgress;
use super::{ReadSources, ScratchOptions, finish_city, is_elevation, read_source, read_sources};
use crate::error::{BakeError, InputError};
use crate::scene::object_records::{self, ObjectRecords, RecordPart};
use crate::scene::scratch_budget::ScratchBudget;
use crate::scene::scratch_scene::{ScratchScene, StoredMaterial};
use crate::scene::texture_store::{TextureFacts, TextureStore};
use crate::scene::triangle_store::{TrianglePart, TriangleStore};

/// Name of a part's file of triangles.
pub(crate) const TRIANGLES: &str = "triangles";

/// The sources of inputs, in their order.
pub(crate) struct ListedInputs {
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

/// A part and where its files are.
#[derive(Debug)]
pub(crate) struct PartFiles {
    pub(crate) head: PartHead,
    pub(crate) triangles: PathBuf,
}

impl ListedInputs {
    /// Lists the sources, sequences of more than `slice_bytes` as several. Fails as reading them does, and for sources that cannot be read in parts: elevation models, landmarks and
    /// land around the city.
    pub(crate) fn new(inputs: &[PathBuf], options: &ReadOptions, slice_bytes: u64) -> Result<Self, InputError> {
        let mut listed = list::list(inputs, options, &mut BadInputs::new(options.skip_bad_inputs))?;
        let unsupported = |label: &str| {
            InputError::unsupported(label, "elevation models and landmarks are not baked in steps; bake without --work")
        };
        if let Some(source) = listed.sources.iter().find(|source| is_elevation(source) || source.is_surroundings) {
            return Err(unsupported(&source.label));
        }
        if let Some(file) = &options.landmarks {
            return Err(unsupported(&file.display().to_string()));
        }
        if let Some(source) = listed.sources.first().filter(|_| options.is_monument) {
            return Err(unsupported(&source.label));
        }
        listed.sources = listed.sources.into_iter().flat_map(|source| slices(source, slice_bytes)).collect();
        Ok(Self { listed })
    }

    /// Size of each source in bytes.
    pub(crate) fn sizes(&self) -> Vec<u64> {
        self.listed.sources.iter().map(|source| source.bytes).collect()
    }

    /// The coordinate system that a city of all sources has; `None` if none of them has one. Reads the sources as far as their first
    /// place. Fails as reading them does.
    pub(crate) fn settle(&self, options: &ReadOptions) -> Result<Option<String>, InputError> {
        let mut context = ReadContext::new(options, TriangleStore::Memory(Vec::new()), TextureStore::in_memory())?;
        context.ends_at_place = true;
        for is_last_resort in [self.listed.sources.len() == 1, true] {
            context.is_last_resort = is_last_resort;
            for source in &self.listed.sources {
                if context.world.is_settled() {
                    return Ok(context.world.crs_name());
                }
                let mark = context.mark();
                match read_source(&mut context, source, &|_| {}) {
                    Ok(_) | Err(InputError::Settled { .. }) => {}
                    Err(InputError::NoProjection { .. }) if !is_last_resort => context.abandon_source(mark),
                    Err(_) if options.skip_bad_inputs => context.abandon_source(mark),
                    Err(error) => return Err(error),
                }
            }
        }
        Ok(context.world.crs_name())
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
        let mut context = ReadContext::new(options, triangles, textures)?;
        context.is_last_resort = true;
        let bad = BadInputs::new(options.skip_bad_inputs);
        let read = read_sources(&self.listed, bad, context, progress)?;
        let ReadSources { mut context, mut report, set_of_source, bad } = read;
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

/// All parts of a city.
pub(crate) struct SceneParts {
    pub(crate) parts: Vec<PartFiles>,
    /// Folder of the textures, which are there by the numbers that they have in the city.
    pub(crate) textures: PathBuf,
}

/// A city of parts.
pub(crate) struct PartsCity {
    pub(crate) city: ScratchScene,
    pub(crate) report: ReadReport,
    /// For each part, the number in the city of each of its materials.
    pub(crate) materials: Vec<Vec<u32>>,
    /// For each part, the number in the city of its first object, before objects were left out.
    pub(crate) first_objects: Vec<u32>,
}

/// The textures of all parts, equal ones once.
#[derive(Default)]
struct PartTextures {
    facts: Vec<TextureFacts>,
    known: HashMap<TextureFacts, u32>,
    sets: HashMap<String, u32>,
    set_of_texture: Vec<Option<u32>>,
}

impl PartTextures {
    /// The number of a set by name.
    fn set(&mut self, name: &str) -> u32 {
        let next = self.sets.len() as u32;
        *self.sets.entry(name.to_owned()).or_insert(next)
    }

    /// The number of each texture of a part.
    fn add(&mut self, head: &PartHead) -> Vec<u32> {
        let sets: Vec<u32> = head.sets.iter().map(|name| self.set(name)).collect();
        let textures = head.textures.iter().zip(&head.set_of_texture);
        let mut numbers = Vec::with_capacity(head.textures.len());
        for (facts, set) in textures {
            let next = self.facts.len() as u32;
            let number = *self.known.entry(facts.clone()).or_insert(next);
            if number == next {
                self.facts.push(facts.clone());
                self.set_of_texture.push(set.and_then(|set| sets.get(set as usize).copied()));
            }
            numbers.push(number);
        }
        numbers
    }
}

impl SceneParts {
    /// The textures of all parts by the numbers that they have in the city.
    pub(crate) fn textures(parts: &[PartFiles]) -> Vec<TextureFacts> {
        let mut textures = PartTextures::default();
        parts.iter().for_each(|part| drop(textures.add(&part.head)));
        textures.facts
    }

    /// Makes the city. `scratch` is for triangles that are made, and for names. Fails as reading all sources at once does.
    pub(crate) fn assemble(
        self,
        options: &ReadOptions,
        scratch: &Path,
        texture_cache_bytes: usize,
    ) -> Result<PartsCity, BakeError> {
        let budget = ScratchBudget::new(u64::MAX);
        let (mut textures, mut builder) = (PartTextures::default(), SceneBuilder::of_parts(options.cell_m));
        let (mut triangles, mut first_objects, mut materials) = (Vec::new(), Vec::new(), Vec::new());
        let (mut report, mut set_of_source, mut records) = (ReadReport::default(), Vec::new(), 0);
        for PartFiles { head, triangles: path } in self.parts {
            let texture_numbers = textures.add(&head);
            let damaged = || BakeError::Scratch { path: path.clone() };
            let renumber = |material: &StoredMaterial| {
                let texture = material.texture.map(|number| texture_numbers.get(number as usize).ok_or_else(damaged));
                Ok::<_, BakeError>(StoredMaterial { texture: texture.transpose()?.copied(), ..*material })
            };
            let own: Vec<u32> =
                head.materials.iter().map(|m| Ok(builder.material(renumber(m)?))).collect::<Result<_, BakeError>>()?;
            let first_object = builder.len() as u32;
            let sets = head.set_of_source.iter().filter_map(|set| head.sets.get(*set as usize));
            set_of_source.extend(sets.map(|name| textures.set(name)));
            builder.add_part(head.objects, report.sources.len() as u32, records);
            records += head.record_bytes;
            merge_reports(&mut report, head.report);
            triangles.push(TrianglePart { path: path.clone(), first_object, materials: own.clone() });
            first_objects.push(first_object);
            materials.push(own);
        }
        builder.set_triangles(TriangleStore::of_parts(triangles, scratch.join(TRIANGLES), budget)?);
        let facts = std::mem::take(&mut textures.facts);
        let store = TextureStore::of_files(facts, self.textures, texture_cache_bytes);
        let mut context = ReadContext::new(options, TriangleStore::Memory(Vec::new()), store)?;
        context.builder = builder;
        context.textures.set_of_texture = textures.set_of_texture;
        let (vertical_datum, geoid) = (report.vertical_datum.clone(), report.geoid.clone());
        let bad = BadInputs::new(options.skip_bad_inputs);
        let mut read = finish_city(ReadSources { context, report, set_of_source, bad })?;
        (read.report.vertical_datum, read.report.geoid) = (vertical_datum, geoid);
        read.city.stored.finish()?;
        read.city.names.finish();
        read.level_textures(options)?;
        Ok(PartsCity { city: read.city, report: read.report, materials, first_objects })
    }
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
