//! The stages of a bake, in their order. Nothing else decides order.
//!
//! In: [`BakeOptions`], and a scene or the inputs to read it from. Out: a city folder and a [`Report`]. Next: the server.
//!
//! The same scene and settings give the same bytes whatever the number of threads, and whether or not a bake was
//! interrupted: tiles depend on their block alone, and the archives are written in the order of tile ids.

mod feed;
mod leaves;
mod parents;
mod scene;

use std::{cell::Cell, cmp::Reverse, path::Path};

use rayon::ThreadPool;

use crate::{
    config::{BakeOptions, Config},
    error::BakeError,
    grid::Grid,
    partition::Partition,
    progress::Progress,
    read::{self, ReadOptions, ReadProgress, ReadReport},
    report::{Blocks, Clock, Outcome, Report, Start},
    scene::Scene,
    write::{
        city::{self, CityInput, SceneFacts},
        pack::{self, PackId, Stored},
        scratch::{Origin, Scratch},
        tree::Tree,
    },
};

/// Bakes the inputs into `options.out`. Killed at any moment, or failed, it leaves either no city or a whole one; what it
/// had finished lies in `CITY.partial`, where `options.resume` goes on.
pub fn bake(options: &BakeOptions, progress: &dyn Progress) -> Result<Report, BakeError> {
    let config = Config::new(options)?;
    let scratch = Scratch::lock(&config.out)?;
    let mut clock = Clock::new();
    let (scene, report) = clock.time("read", || read(options, progress))?;
    run(scene, report, &config, scratch, clock, progress)
}

/// The reader counts bytes from the start; a step is a byte.
fn read(options: &BakeOptions, progress: &dyn Progress) -> Result<(Scene, ReadReport), BakeError> {
    let read_options = ReadOptions { obj_up: options.obj_up, ..ReadOptions::default() };
    let total = Cell::new(None);
    let done = Cell::new(0);
    let tick = |now: ReadProgress| {
        if total.replace(Some(now.bytes_total)) != Some(now.bytes_total) {
            progress.stage("read", now.bytes_total);
        }
        progress.advance(now.bytes_done.saturating_sub(done.replace(now.bytes_done)));
    };
    Ok(read::read(&options.inputs, &read_options, &tick)?)
}

/// Bakes a scene that was read already; `options.inputs` and `options.obj_up` are not looked at.
pub fn bake_scene(
    scene: Scene,
    read_report: ReadReport,
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<Report, BakeError> {
    let config = Config::new(options)?;
    let scratch = Scratch::lock(&config.out)?;
    run(scene, read_report, &config, scratch, Clock::new(), progress)
}

/// What the stages that make tiles share.
#[derive(Clone, Copy)]
struct Stage<'a> {
    config: &'a Config,
    grid: &'a Grid,
    packs: &'a Path,
    progress: &'a dyn Progress,
    start: Start,
}

impl Stage<'_> {
    /// The pack, if an interrupted bake finished it.
    fn found(&self, pack: PackId) -> Option<Vec<Stored>> {
        if self.start == Start::Resumed { pack::find(self.packs, pack) } else { None }
    }
}

fn run(
    scene: Scene,
    read: ReadReport,
    config: &Config,
    mut scratch: Scratch,
    mut clock: Clock,
    progress: &dyn Progress,
) -> Result<Report, BakeError> {
    let pool = pool(config.threads)?;
    let [min, max] = scene::bounds(&scene, config.cell_m)?;
    let facts = SceneFacts::new(&scene, min, max);
    let grid = Grid::covering(min, max, scene.origin, config.cell_m).ok_or_else(|| {
        let side_m = (max[0] - min[0]).max(max[1] - min[1]);
        BakeError::Extent { side_m, cell_m: config.cell_m }
    })?;
    let origin = Origin { settings: config.settings.clone(), scene: scene::hash(&scene) };
    let start = scratch.prepare(&origin, config.resume)?;
    tell(start, config);
    progress.stage("partition", scene.triangles.len() as u64);
    let margin_m = config.sample.margin_m;
    let partition = clock.time("partition", || pool.install(|| Partition::new(&scene, &grid, margin_m)));
    let packs = scratch.packs();
    let stage = Stage { config, grid: &grid, packs: &packs, progress, start };
    let mut blocks = Blocks::default();
    let mut tree = Tree::new(grid.depth);
    let triangles = scene.triangles.len();
    clock.time("sample", || leaves(&stage, &pool, &scene, &partition, &mut tree, &mut blocks))?;
    drop((scene, partition));
    if tree.level(grid.depth).is_empty() {
        return Err(BakeError::Empty { triangles, cell_m: config.cell_m });
    }
    for level in (0..grid.depth).rev() {
        clock.time(&format!("level {level}"), || parents(&stage, &pool, level, &mut tree, &mut blocks))?;
    }
    let input = CityInput { config, grid: &grid, facts: &facts, read: &read, tree: &tree, packs: &packs };
    progress.stage("write", tree.levels().iter().map(|level| level.len() as u64).sum());
    let written = clock.time("write", || {
        let written = city::write(&input, &scratch.city(), |n| progress.advance(n))?;
        scratch.publish().map(|()| written)
    })?;
    let (manifest, city_bytes, threads) = (written.manifest, written.bytes, config.threads);
    Ok(Report::new(Outcome { manifest, city_bytes, read, grid, threads, start, blocks }, clock))
}

fn pool(threads: usize) -> Result<ThreadPool, BakeError> {
    let built = rayon::ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("bake-{i}")).build();
    built.map_err(|cause| BakeError::Threads { threads, cause: cause.to_string() })
}

fn tell(start: Start, config: &Config) {
    let out = config.out.display();
    match start {
        Start::Fresh if config.resume => tracing::info!("{out}: there is nothing to resume, the bake starts anew"),
        Start::Fresh => {}
        Start::Resumed => tracing::info!("{out}: an interrupted bake goes on"),
        Start::Mismatch => {
            tracing::warn!("{out}: the interrupted bake was of other input or settings, the bake starts anew");
        }
        Start::Discarded => {
            tracing::info!("{out}: an interrupted bake was removed; --resume would have gone on with it")
        }
    }
}

/// Every block of leaves: sample, parametrise, encode, store.
fn leaves(
    stage: &Stage<'_>,
    pool: &ThreadPool,
    scene: &Scene,
    partition: &Partition,
    tree: &mut Tree,
    counts: &mut Blocks,
) -> Result<(), BakeError> {
    // The heaviest first, so that none is left over alone at the end.
    let mut blocks = partition.blocks.clone();
    blocks.sort_by_key(|block| (Reverse(partition.triangles(block).len()), block.y, block.x));
    let total = blocks.iter().map(|block| partition.leaves(block).len() as u64).sum();
    stage.progress.stage("sample", total);
    let leaves = leaves::Leaves { stage, scene, partition };
    let done = feed::feed(pool, stage.config.threads, &blocks, |block| leaves.block(block))?;
    collect(done, stage.grid.depth, tree, counts);
    Ok(())
}

/// Every node of a level from its children: average, parametrise, encode, store.
fn parents(
    stage: &Stage<'_>,
    pool: &ThreadPool,
    level: u8,
    tree: &mut Tree,
    counts: &mut Blocks,
) -> Result<(), BakeError> {
    let chunks = parents::chunks_above(tree, level + 1);
    stage.progress.stage(&format!("level {level}"), chunks.iter().map(|chunk| chunk.nodes.len() as u64).sum());
    let done = feed::feed(pool, stage.config.threads, &chunks, |chunk| parents::chunk(stage, tree, chunk))?;
    collect(done, level, tree, counts);
    Ok(())
}

fn collect(done: Vec<(Vec<Stored>, bool)>, level: u8, tree: &mut Tree, counts: &mut Blocks) {
    for (_, resumed) in &done {
        counts.count(*resumed);
    }
    tree.set(level, done.into_iter().flat_map(|(stored, _)| stored).collect());
}
