//! The stages of a bake, in order.
//!
//! The same scene and settings give the same bytes with any number of threads, interrupted or not: the tiles of a block
//! depend on that block alone, and archives are written in the order of tile ids.

mod block_scene;
mod context;
mod far_land;
mod frame;
mod generated;
mod hashed;
mod leaves;
mod levels;
mod pack_inputs;
mod parents;
mod steps;
mod update;
mod work_queue;

use crate::config::{BakeConfig, BakeOptions};
use crate::error::BakeError;
use crate::ground;
use crate::kept_work::scratch_folder;
use crate::progress::Progress;
use crate::read::{self, BadInput, FarModels, ReadProgress, ReadReport, ScratchOptions};
use crate::report::{BakeReport, MeshReport, ReportInput, ResumeStatus, StageClock};
use crate::scene::Scene;
use crate::scene::grid::CityGrid;
use crate::scene::object_numbers::ObjectNumbers;
use crate::scene::object_records::ObjectRecords;
use crate::scene::partition::BlockSquare;
use crate::scene::scratch_budget::ScratchBudget;
use crate::scene::scratch_scene::ScratchScene;
use crate::write::city::{self, CityInput, WrittenCity};
use crate::write::objects::NumberedRecords;
use crate::write::ownership::{check_inputs, check_place};
use crate::write::scratch_folder::ScratchFolder;
use crate::write::tile_pack::{PackReader, StoredTile};
use context::TileContext;
use far_land::FarLand;
use frame::CityFrame;
pub use generated::{GeneratedCity, bake_generated};
use hashed::{HashedInput, HashedPartition};
use insula_archive::places::KeptFolder;
use insula_protocol::TileId;
use rayon::ThreadPool;
use std::cell::Cell;
pub use steps::{
    AbortedJob, BakeStage, BakeSteps, DEFAULT_CHUNK_BYTES, DEFAULT_REGION_LEAVES, Job, JobRequest, StageStatus,
    WorkFolder, WorkStore, abort,
};
use update::PreviousCity;

/// Bakes the inputs into `options.out`. A bake that fails or is killed leaves either no city or a complete one; its
/// finished work stays in `CITY.partial`, where a bake with `options.resume` continues.
pub fn bake(options: &BakeOptions, progress: &dyn Progress) -> Result<BakeReport, BakeError> {
    let config = BakeConfig::new(options)?;
    check_place(&config.options.out, "--out", KeptFolder::City)?;
    check_inputs(&[config.options.out.clone(), scratch_folder(&config.options.out)], "--out", options)?;
    let bake = || {
        let mut run = BakeRun::new(&config, progress)?;
        let (city, surroundings, read) = run.read()?;
        run.bake(city, surroundings.as_ref(), read)
    };
    bake().map_err(|error| error.of_bake(&config.options.out))
}

/// Bakes a scene that is in memory: no input is read, and of `options.read` only the unit of heights counts. Fails as [`bake`] does.
pub fn bake_scene(
    scene: Scene,
    read_report: ReadReport,
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<BakeReport, BakeError> {
    let config = BakeConfig::new(options)?;
    let bake = || BakeRun::new(&config, progress)?.bake(ScratchScene::from_scene(scene)?, None, read_report);
    bake().map_err(|error| error.of_bake(&config.options.out))
}

/// The state of a bake that lasts through all stages.
struct BakeRun<'a> {
    config: &'a BakeConfig,
    progress: &'a dyn Progress,
    scratch: ScratchFolder,
    budget: ScratchBudget,
    pool: ThreadPool,
    clock: StageClock,
}

impl<'a> BakeRun<'a> {
    fn new(config: &'a BakeConfig, progress: &'a dyn Progress) -> Result<Self, BakeError> {
        let scratch = ScratchFolder::lock(&config.options.out)?;
        let (pool, budget) = (config.thread_pool()?, ScratchBudget::new(config.options.scratch_bytes));
        Ok(Self { config, progress, scratch, budget, pool, clock: StageClock::new() })
    }

    /// Reads the inputs into the scratch folder.
    fn read(&mut self) -> Result<(ScratchScene, Option<FarModels>, ReadReport), BakeError> {
        let options = &self.config.options;
        let folder = self.scratch.scene_folder()?;
        let texture_cache_bytes = self.config.texture_cache_bytes();
        let scratch = ScratchOptions { folder: &folder, texture_cache_bytes, budget: &self.budget };
        // The reader reports bytes since the start; a step of the stage is a byte.
        let (total, done) = (Cell::new(None), Cell::new(0));
        let tick = |now: ReadProgress| {
            if total.replace(Some(now.bytes_total)) != Some(now.bytes_total) {
                self.progress.stage("read", now.bytes_total);
            }
            self.progress.advance(now.bytes_done.saturating_sub(done.replace(now.bytes_done)));
        };
        let (city, surroundings, report) =
            self.clock.time("read", || read::read_to_disk(&options.inputs, &options.read, scratch, &tick))?;
        for BadInput { path, reason } in &report.bad_inputs {
            self.progress.warn(&format!("{path}: left out: {reason}"));
        }
        if let Some(first) = report.ignored.first() {
            let more = report.ignored.len() - 1;
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            self.progress.warn(&format!("{first}{more}: no city model, left alone"));
        }
        report.unread.iter().for_each(|line| self.progress.warn(line));
        for warning in report.placing_warnings() {
            self.progress.warn(warning);
        }
        report.warnings().for_each(|warning| self.progress.warn(&warning));
        Ok((city, surroundings, report))
    }

    /// Runs all stages after reading.
    fn bake(
        mut self,
        mut city: ScratchScene,
        surroundings: Option<&FarModels>,
        read: ReadReport,
    ) -> Result<BakeReport, BakeError> {
        let (config, progress, cell_m) = (self.config, self.progress, self.config.options.cell_m);
        let add_ground = |city: &mut ScratchScene| {
            progress.stage("ground", 0);
            self.clock.time("ground", || ground::add(city, cell_m))
        };
        let frame = CityFrame::new(&mut city, surroundings, config, progress, add_ground)?;
        let CityFrame { facts, ground, grid, plane_m } = frame;
        let previous = self.open_previous(plane_m);
        let rows = {
            let known = previous.as_ref().map(PreviousCity::object_numbers).unwrap_or_default();
            let ObjectNumbers { of_object, rows } = ObjectNumbers::new(&city, &grid, &known)?;
            city.keep_object_facts(&of_object)?;
            rows
        };
        let partition = self.partition(&city, &grid)?;
        city.drop_triangles();
        let records = std::mem::replace(&mut city.records, ObjectRecords::Memory(Vec::new()));
        let mut start = self.prepare_scratch()?;
        let (pool, packs) = (&self.pool, &self.scratch.packs());
        let context = TileContext { config, grid: &grid, pool, packs, progress, previous: previous.as_ref(), plane_m };
        let (origin, triangles) = (city.origin, city.triangles as usize);
        let land = |leaves: &[StoredTile]| {
            if leaves.is_empty() {
                return Err(BakeError::Empty { triangles, cell_m });
            }
            let (nodes, levels) = (leaves.iter().map(|leaf| leaf.id), 0..=grid.depth);
            Ok(surroundings.map(|land| FarLand::within(land, origin, &grid, nodes, TileId::ROOT, levels)))
        };
        let mut tiles = levels::bake(&context, &mut self.clock, city, &partition, 0, land)?;
        let mut fingerprints = partition.fingerprints();
        tiles.tree.merge_plain_nodes(&mut fingerprints);
        let tree = &tiles.tree;
        let searchable = config.options.search_attributes.clone();
        let objects = Some(NumberedRecords { records: &records, rows: &rows, origin_m: grid.corner, searchable });
        let base = None;
        let input = CityInput { config, grid: &grid, facts: &facts, read: &read, tree, fingerprints, objects, base };
        let (written, clock) = self.write(input, previous)?;
        let WrittenCity { manifest, bytes: city_bytes, filled_in } = written;
        let (threads, blocks) = (config.threads, tiles.counts);
        let meshes = MeshReport::by_lod(tree.meshes().iter().map(|mesh| (mesh.lod, mesh.info)));
        if tiles.counts.resumed > 0 {
            start = ResumeStatus::Resumed;
        }
        Ok(BakeReport::new(
            ReportInput { manifest, city_bytes, read, filled_in, ground, grid, threads, start, blocks, meshes },
            clock,
        ))
    }

    /// Sorts the triangles into blocks and hashes each block's input.
    fn partition(&mut self, city: &ScratchScene, grid: &CityGrid) -> Result<HashedPartition, BakeError> {
        self.progress.stage("partition", city.triangles);
        self.clock.time("partition", || {
            let folder = self.scratch.scene_folder()?.join("buckets");
            let input = HashedInput { city, grid, config: self.config, budget: &self.budget };
            HashedPartition::new(input, &folder, BlockSquare::all(), |n| self.progress.advance(n))
        })
    }

    /// The city whose unchanged blocks are reused, if that was requested and is possible.
    fn open_previous(&self, plane_m: Option<f32>) -> Option<PreviousCity> {
        let folder = self.config.previous.as_ref()?;
        match PreviousCity::open(folder, self.config, plane_m) {
            Ok(previous) => Some(previous),
            Err(reason) => {
                let folder = folder.display();
                self.progress.warn(&format!("{folder}: cannot update: {reason}; baking the whole city"));
                None
            }
        }
    }

    /// Keeps or removes the packs of an interrupted bake, and logs which.
    fn prepare_scratch(&self) -> Result<ResumeStatus, BakeError> {
        let resume = self.config.options.resume;
        let status = self.scratch.prepare(resume)?;
        let what = match status {
            ResumeStatus::Fresh if resume => "no interrupted bake found, starting a new one",
            ResumeStatus::Fresh => return Ok(status),
            ResumeStatus::Resumed | ResumeStatus::Mismatch => "resuming the interrupted bake",
            ResumeStatus::Discarded => "removed an interrupted bake; --resume would have continued it",
        };
        tracing::info!("{}: {what}", self.config.options.out.display());
        Ok(status)
    }

    /// Writes the final files and replaces the output.
    fn write(
        self,
        input: CityInput<'_>,
        previous: Option<PreviousCity>,
    ) -> Result<(WrittenCity, StageClock), BakeError> {
        let Self { progress, scratch, mut clock, .. } = self;
        progress.stage("write", input.tree.levels().iter().map(|level| level.len() as u64).sum());
        let written = clock.time("write", || {
            let shares = input.config.base.is_some();
            let base = previous.as_ref().filter(|_| shares).map(PreviousCity::baked);
            let input = CityInput { base, ..input };
            let written = city::write(input, &mut PackReader::new(&scratch.packs()), &scratch.city(), progress)?;
            // Closes the previous city's files: some systems do not rename a folder with open files.
            drop(previous);
            scratch.publish().map(|()| written)
        })?;
        Ok((written, clock))
    }
}
