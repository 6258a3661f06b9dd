//! What a bake did and what it took.
//!
//! In: counts and times from `pipeline`. Out: [`Report`], serialisable. Next: `--report FILE.json` and the last lines that
//! the command prints.

use std::{collections::BTreeMap, time::Instant};

use insula_protocol::{Manifest, manifest::CityCounts, subtree::MeshLod};
use serde::Serialize;

pub use crate::write::scratch::Start;
use crate::{read::ReadReport, scene::grid::Grid};

/// A finished bake.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// The city's name in URLs.
    pub name: String,
    /// Hash of its content.
    pub version: String,
    /// What was read from each source, what was skipped and why.
    pub read: ReadReport,
    /// Side of a leaf's column.
    pub cell_m: f64,
    /// Level of the leaves.
    pub depth: u8,
    /// Objects baked.
    pub objects: u64,
    /// Triangles baked.
    pub triangles: u64,
    /// Root first.
    pub levels: Vec<LevelReport>,
    /// Nodes of all levels.
    pub nodes: u64,
    /// Bytes of all nodes' V-BlockMaps.
    pub blockmap_bytes: u64,
    /// Leaves' meshes by level of detail, the finest first; empty without meshes.
    pub meshes: Vec<MeshReport>,
    /// Bytes of the whole city on disk.
    pub city_bytes: u64,
    /// Worker threads.
    pub threads: usize,
    /// Whether an interrupted bake was found, and what became of it.
    pub start: Start,
    /// Blocks of leaves and of parents that were baked now.
    pub blocks_baked: u64,
    /// Blocks that an interrupted bake had finished.
    pub blocks_resumed: u64,
    /// Blocks that the city to update had already.
    pub blocks_unchanged: u64,
    /// In the order in which they ran.
    pub stages: Vec<StageReport>,
    /// From the first to the last.
    pub seconds: f64,
    /// Over the whole time.
    pub triangles_per_second: f64,
    /// Over the whole time.
    pub objects_per_second: f64,
    /// Most memory that the process ever held; `None` where the system does not tell.
    pub peak_memory_bytes: Option<u64>,
}

/// One level of the quadtree.
#[derive(Debug, Clone, Serialize)]
pub struct LevelReport {
    /// 0 for the root.
    pub level: u8,
    /// Side of a column.
    pub cell_m: f64,
    /// How many.
    pub nodes: u64,
    /// Of all V-BlockMaps.
    pub bytes: u64,
}

/// All meshes of one level of detail.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct MeshReport {
    /// 0 for the finest.
    pub lod: u8,
    /// Leaves that have it.
    pub leaves: u64,
    /// Of all tiles.
    pub bytes: u64,
    /// Of all.
    pub triangles: u64,
    /// Of all pictures.
    pub texture_px: u64,
    /// Largest error in metres.
    pub error_m: f32,
}

impl MeshReport {
    /// By level of detail, the finest first.
    pub fn count(meshes: impl Iterator<Item = (u8, MeshLod)>) -> Vec<Self> {
        let mut all: BTreeMap<u8, Self> = BTreeMap::new();
        for (lod, info) in meshes {
            let one = all.entry(lod).or_insert(Self { lod, ..Self::default() });
            one.leaves += 1;
            one.bytes += u64::from(info.bytes);
            one.triangles += u64::from(info.triangles);
            one.texture_px += u64::from(info.texture_px);
            one.error_m = one.error_m.max(info.error_m);
        }
        all.into_values().collect()
    }
}

/// One stage of the pipeline.
#[derive(Debug, Clone, Serialize)]
pub struct StageReport {
    /// As [`crate::Progress::stage`] names it.
    pub name: String,
    /// How long it took.
    pub seconds: f64,
}

/// Measures stages.
#[derive(Debug)]
pub(crate) struct Clock {
    start: Instant,
    pub(crate) stages: Vec<StageReport>,
}

impl Clock {
    pub(crate) fn new() -> Self {
        Self { start: Instant::now(), stages: Vec::new() }
    }

    /// Runs a stage.
    pub(crate) fn time<R>(&mut self, name: &str, stage: impl FnOnce() -> R) -> R {
        let start = Instant::now();
        let result = stage();
        self.stages.push(StageReport { name: name.to_owned(), seconds: start.elapsed().as_secs_f64() });
        result
    }

    pub(crate) fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}

/// Where a block's tiles come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Made {
    /// Baked now.
    Baked,
    /// Finished by an interrupted bake.
    Resumed,
    /// In the city to update.
    Unchanged,
}

/// Blocks done, by who did them.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Blocks {
    baked: u64,
    resumed: u64,
    unchanged: u64,
}

impl Blocks {
    pub(crate) fn count(&mut self, made: Made) {
        match made {
            Made::Baked => self.baked += 1,
            Made::Resumed => self.resumed += 1,
            Made::Unchanged => self.unchanged += 1,
        }
    }
}

/// What a report is made of besides times.
pub(crate) struct Outcome {
    pub(crate) manifest: Manifest,
    pub(crate) city_bytes: u64,
    pub(crate) read: ReadReport,
    pub(crate) grid: Grid,
    pub(crate) threads: usize,
    pub(crate) start: Start,
    pub(crate) blocks: Blocks,
    pub(crate) meshes: Vec<MeshReport>,
}

impl Report {
    pub(crate) fn new(outcome: Outcome, clock: Clock) -> Self {
        let Outcome { manifest, city_bytes, read, grid, threads, start, blocks, meshes } = outcome;
        let seconds = clock.seconds();
        let per_second = |n: u64| n as f64 / seconds.max(1e-9);
        let counts = &manifest.counts;
        Self {
            levels: levels(&grid, counts),
            nodes: counts.nodes_per_level.iter().sum(),
            blockmap_bytes: counts.bytes_per_level.iter().sum(),
            objects: counts.objects,
            triangles: counts.triangles,
            triangles_per_second: per_second(counts.triangles),
            objects_per_second: per_second(counts.objects),
            name: manifest.name,
            version: manifest.version,
            read,
            cell_m: grid.cell_m,
            depth: grid.depth,
            meshes,
            city_bytes,
            threads,
            start,
            blocks_baked: blocks.baked,
            blocks_resumed: blocks.resumed,
            blocks_unchanged: blocks.unchanged,
            stages: clock.stages,
            seconds,
            peak_memory_bytes: peak_memory_bytes(),
        }
    }
}

fn levels(grid: &Grid, counts: &CityCounts) -> Vec<LevelReport> {
    let each = (0..=grid.depth).zip(counts.nodes_per_level.iter().zip(&counts.bytes_per_level));
    each.map(|(level, (nodes, bytes))| LevelReport {
        level,
        cell_m: grid.cell_m_at(level),
        nodes: *nodes,
        bytes: *bytes,
    })
    .collect()
}

/// `VmHWM` of `/proc/self/status`.
pub fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn linux_tells_the_peak() {
        let peak = peak_memory_bytes().unwrap();
        assert!((1 << 20..1 << 40).contains(&peak), "{peak}");
    }

    #[test]
    fn a_clock_keeps_the_order_of_stages() {
        let mut clock = Clock::new();
        assert_eq!(clock.time("read", || 7), 7);
        clock.time("write", || std::thread::sleep(std::time::Duration::from_millis(5)));
        assert_eq!(clock.stages.iter().map(|stage| stage.name.as_str()).collect::<Vec<_>>(), ["read", "write"]);
        assert!(clock.stages[1].seconds >= 0.005 && clock.seconds() >= clock.stages[1].seconds);
    }
}
