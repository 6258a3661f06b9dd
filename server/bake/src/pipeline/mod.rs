//! The stages of a bake, in their order. Nothing else decides order.
//!
//! In: [`BakeOptions`], and a scene or the inputs to read it from. Out: a city folder and a [`BakeReport`]. Next: the server.
//!
//! The same scene and settings give the same bytes whatever the number of threads, and whether or not a bake was
//! interrupted: tiles depend on their block alone, and the archives are written in the order of tile ids.

mod block;
mod feed;
mod generated;
mod leaves;
mod parents;
mod update;

use std::{cell::Cell, cmp::Reverse, path::Path};

use rayon::{ThreadPool, prelude::*};

use crate::{
    config::{BakeConfig, BakeOptions, short_hex},
    error::BakeError,
    progress::Progress,
    read::{self, ReadOptions, ReadProgress, ReadReport},
    report::{BakeReport, MeshReport, PackCounts, PackOutcome, ReportInput, ResumeStatus, StageClock},
    scene::{
        Scene,
        grid::CityGrid,
        partition::{LeafBlock, Partition},
        scratch_scene::{ScratchScene, ShortHash},
    },
    write::{
        city::{self, CityInput, SceneFacts},
        mesh_pack::StoredMesh,
        pack::{self, PackId, StoredTile},
        scratch::{InputHashes, ScratchFolder},
        tree::TileTree,
    },
};
pub use generated::{GeneratedCity, bake_generated};

use block::BlockScene;
use feed::MemoryBudget;
use update::PreviousCity;

/// Bakes the inputs into `options.out`. Killed at any moment, or failed, it leaves either no city or a whole one; what it
/// had finished lies in `CITY.partial`, where `options.resume` goes on.
pub fn bake(options: &BakeOptions, progress: &dyn Progress) -> Result<BakeReport, BakeError> {
    let config = BakeConfig::new(options)?;
    let scratch = ScratchFolder::lock(&config.out)?;
    let mut clock = StageClock::new();
    let (city, report) = clock.time("read", || read(options, &config, &scratch, progress))?;
    run(city, report, &config, scratch, clock, progress)
}

/// The reader counts bytes from the start; a step is a byte.
fn read(
    options: &BakeOptions,
    config: &BakeConfig,
    scratch: &ScratchFolder,
    progress: &dyn Progress,
) -> Result<(ScratchScene, ReadReport), BakeError> {
    let (obj_up, palette) = (options.obj_up, options.palette.clone());
    let read_options = ReadOptions { obj_up, palette, ..ReadOptions::default() };
    let total = Cell::new(None);
    let done = Cell::new(0);
    let tick = |now: ReadProgress| {
        if total.replace(Some(now.bytes_total)) != Some(now.bytes_total) {
            progress.stage("read", now.bytes_total);
        }
        progress.advance(now.bytes_done.saturating_sub(done.replace(now.bytes_done)));
    };
    read::read_to_disk(&options.inputs, &read_options, (&scratch.spool()?, config.picture_bytes()), &tick)
}

/// Bakes a scene that was read already; `options.inputs`, `obj_up` and `palette` are not looked at.
pub fn bake_scene(
    scene: Scene,
    read_report: ReadReport,
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<BakeReport, BakeError> {
    let config = BakeConfig::new(options)?;
    let scratch = ScratchFolder::lock(&config.out)?;
    run(ScratchScene::from_scene(scene)?, read_report, &config, scratch, StageClock::new(), progress)
}

/// What the stages that make tiles share.
#[derive(Clone, Copy)]
struct TileContext<'a> {
    config: &'a BakeConfig,
    grid: &'a CityGrid,
    packs: &'a Path,
    progress: &'a dyn Progress,
    start: ResumeStatus,
    /// The city to update.
    before: Option<&'a PreviousCity>,
}

impl TileContext<'_> {
    /// The pack, if an interrupted bake finished it.
    fn found(&self, pack: PackId) -> Option<Vec<StoredTile>> {
        if self.start == ResumeStatus::Resumed { pack::find(self.packs, pack) } else { None }
    }
}

fn run(
    mut city: ScratchScene,
    read: ReadReport,
    config: &BakeConfig,
    mut scratch: ScratchFolder,
    mut clock: StageClock,
    progress: &dyn Progress,
) -> Result<BakeReport, BakeError> {
    let pool = pool(config.threads)?;
    let Some([min, max]) = city.bounds else {
        return Err(BakeError::Empty { triangles: 0, cell_m: config.cell_m });
    };
    let facts = SceneFacts::new(&city, min, max);
    let grid = CityGrid::covering(min, max, city.origin, config.cell_m).ok_or_else(|| {
        let side_m = (max[0] - min[0]).max(max[1] - min[1]);
        BakeError::Extent { side_m, cell_m: config.cell_m }
    })?;
    progress.stage("partition", city.triangles);
    let (partition, fingerprints) = clock.time("partition", || {
        let place = (&*scratch.spool()?.join("buckets"), config.bucket_bytes());
        let partition = Partition::new(&city, &grid, config.sample.margin_m, place, |n| progress.advance(n))?;
        let fingerprints = pool.install(|| fingerprints(&partition, &city, config, &grid))?;
        Ok::<_, BakeError>((partition, fingerprints))
    })?;
    city.forget_triangles();
    let before = before(config);
    let origin = InputHashes { settings: config.settings.clone(), scene: hash(&partition, &fingerprints) };
    let start = scratch.prepare(&origin, config.resume)?;
    tell(start, config);
    let packs = scratch.packs();
    let stage = TileContext { config, grid: &grid, packs: &packs, progress, start, before: before.as_ref() };
    let mut blocks = PackCounts::default();
    let mut tree = TileTree::new(grid.depth);
    let triangles = city.triangles;
    let leaves = leaves::LeafBaker { stage: &stage, city: &city, partition: &partition };
    clock.time("sample", || sample(&leaves, &pool, &fingerprints, &mut tree, &mut blocks))?;
    drop(city);
    if tree.level(grid.depth).is_empty() {
        return Err(BakeError::Empty { triangles: triangles as usize, cell_m: config.cell_m });
    }
    for level in (0..grid.depth).rev() {
        clock.time(&format!("level {level}"), || parents(&stage, &pool, level, &mut tree, &mut blocks))?;
    }
    let fingerprints =
        partition.blocks.iter().zip(fingerprints).map(|(block, hash)| ((block.x, block.y), hash)).collect();
    let input = CityInput { config, grid: &grid, facts: &facts, read: &read, tree: &tree, packs: &packs, fingerprints };
    progress.stage("write", tree.levels().iter().map(|level| level.len() as u64).sum());
    let written = clock.time("write", || {
        let written = city::write(input, &scratch.city(), |n| progress.advance(n))?;
        // Its files are still open, and some systems rename no folder with open files.
        drop(before);
        scratch.publish().map(|()| written)
    })?;
    let (manifest, city_bytes, threads) = (written.manifest, written.bytes, config.threads);
    let meshes = tree.meshes().iter().map(|mesh| (mesh.lod, mesh.info));
    let meshes = MeshReport::count(meshes);
    Ok(BakeReport::new(ReportInput { manifest, city_bytes, read, grid, threads, start, blocks, meshes }, clock))
}

/// Of every block in its order.
fn fingerprints(
    partition: &Partition,
    city: &ScratchScene,
    config: &BakeConfig,
    grid: &CityGrid,
) -> Result<Vec<ShortHash>, BakeError> {
    let of = |block: &LeafBlock| Ok(BlockScene::load(partition, block)?.fingerprint(city, (config, grid), block));
    partition.blocks.par_iter().map(of).collect()
}

/// Of all that decides the tiles.
fn hash(partition: &Partition, fingerprints: &[ShortHash]) -> String {
    let mut hasher = blake3::Hasher::new();
    for (block, fingerprint) in partition.blocks.iter().zip(fingerprints) {
        hasher.update(&block.x.to_le_bytes()).update(&block.y.to_le_bytes()).update(fingerprint);
    }
    short_hex(&hasher.finalize())
}

/// The city to update, if that was asked for and can be.
fn before(config: &BakeConfig) -> Option<PreviousCity> {
    if !config.update {
        return None;
    }
    match PreviousCity::open(&config.out, config) {
        Ok(before) => Some(before),
        Err(why) => {
            tracing::warn!("{}: {why}: everything is baked", config.out.display());
            None
        }
    }
}

fn pool(threads: usize) -> Result<ThreadPool, BakeError> {
    let built = rayon::ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("bake-{i}")).build();
    built.map_err(|cause| BakeError::Threads { threads, cause: cause.to_string() })
}

fn tell(start: ResumeStatus, config: &BakeConfig) {
    let out = config.out.display();
    match start {
        ResumeStatus::Fresh if config.resume => {
            tracing::info!("{out}: there is nothing to resume, the bake starts anew")
        }
        ResumeStatus::Fresh => {}
        ResumeStatus::Resumed => tracing::info!("{out}: an interrupted bake goes on"),
        ResumeStatus::Mismatch => {
            tracing::warn!("{out}: the interrupted bake was of other input or settings, the bake starts anew");
        }
        ResumeStatus::Discarded => {
            tracing::info!("{out}: an interrupted bake was removed; --resume would have gone on with it")
        }
    }
}

/// Every block of leaves: sample, cut into meshes, parametrise, encode, store.
fn sample(
    leaves: &leaves::LeafBaker<'_>,
    pool: &ThreadPool,
    fingerprints: &[ShortHash],
    tree: &mut TileTree,
    counts: &mut PackCounts,
) -> Result<(), BakeError> {
    let (stage, partition) = (leaves.stage, leaves.partition);
    // Worked on from both ends: few heavy blocks meet in memory, and those left for the end are neither large nor many.
    let mut blocks: Vec<(&LeafBlock, ShortHash)> = partition.blocks.iter().zip(fingerprints.iter().copied()).collect();
    blocks.sort_by_key(|(block, _)| (Reverse(block.triangles), block.y, block.x));
    let total = blocks.iter().map(|(block, _)| u64::from(block.leaves.count_ones())).sum();
    stage.progress.stage("sample", total);
    let margin_m = stage.config.sample.margin_m;
    let budget = MemoryBudget::new(stage.config.block_bytes());
    let work = |(block, fingerprint): &(&LeafBlock, ShortHash)| {
        // What is only copied takes next to nothing.
        let copied = stage.before.is_some_and(|before| before.holds(block, *fingerprint));
        let bytes = if copied { 0 } else { block::memory_bytes(block, stage.grid, margin_m) };
        budget.with(bytes, || pool.install(|| leaves.block(block, *fingerprint)))
    };
    let done = feed::feed(stage.config.threads, &blocks, work)?;
    collect(done, stage.grid.depth, tree, counts);
    Ok(())
}

/// Every node of a level from its children: average, parametrise, encode, store.
fn parents(
    stage: &TileContext<'_>,
    pool: &ThreadPool,
    level: u8,
    tree: &mut TileTree,
    counts: &mut PackCounts,
) -> Result<(), BakeError> {
    let chunks = parents::chunks_above(tree, level + 1);
    stage.progress.stage(&format!("level {level}"), chunks.iter().map(|chunk| chunk.nodes.len() as u64).sum());
    let work = |chunk: &parents::ParentPack| pool.install(|| parents::chunk(stage, tree, chunk));
    let done = feed::feed(stage.config.threads, &chunks, work)?;
    collect(done, level, tree, counts);
    Ok(())
}

/// A finished piece of work.
struct FinishedPack {
    tiles: Vec<StoredTile>,
    /// Of leaves.
    meshes: Vec<StoredMesh>,
    made: PackOutcome,
}

fn collect(done: Vec<FinishedPack>, level: u8, tree: &mut TileTree, counts: &mut PackCounts) {
    let (mut tiles, mut meshes) = (Vec::new(), Vec::new());
    for piece in done {
        counts.count(piece.made);
        tiles.extend(piece.tiles);
        meshes.extend(piece.meshes);
    }
    tree.set(level, tiles);
    if !meshes.is_empty() {
        tree.set_meshes(meshes);
    }
}
