//! The report of a bake: counts, sizes and times. Written by `bake --report FILE.json` and summarised by the command.

use crate::ground::GroundReport;
use crate::read::ReadReport;
use crate::scene::grid::CityGrid;
pub use crate::write::scratch_folder::ResumeStatus;
use insula_protocol::Manifest;
use insula_protocol::manifest::CityCounts;
use insula_protocol::subtree::MeshLod;
use serde::Serialize;
use std::collections::BTreeMap;
use std::time::Instant;

/// A finished bake.
#[derive(Debug, Clone, Serialize)]
pub struct BakeReport {
    /// The city's name in URLs.
    pub name: String,
    /// Hash of the city's content.
    pub version: String,
    /// What was read from each source, and what was skipped and why.
    pub read: ReadReport,
    /// Names and licences that no source says, with what was filled in because the publisher is known.
    pub filled_in: Vec<String>,
    /// The generated ground; `None` without.
    pub ground: Option<GroundReport>,
    /// Side of a leaf's column in metres.
    pub cell_m: f64,
    /// Level of the leaves.
    pub depth: u8,
    /// Objects with triangles, of which a building may have several.
    pub objects: u64,
    /// Buildings, each once with all its parts.
    pub buildings: u64,
    /// The size of the city in words, as all programs say it: `1116 buildings`.
    pub size: String,
    pub triangles: u64,
    /// One entry per level, the root first.
    pub levels: Vec<LevelReport>,
    /// Number of nodes of all levels.
    pub nodes: u64,
    /// Size of all V-BlockMaps.
    pub blockmap_bytes: u64,
    /// Meshes by level of detail, the finest first; empty without meshes.
    pub meshes: Vec<MeshReport>,
    /// Size of all files of the city.
    pub city_bytes: u64,
    pub threads: usize,
    /// What became of an interrupted bake's work.
    pub start: ResumeStatus,
    /// Blocks of leaves and packs of parents that this run baked.
    pub blocks_baked: u64,
    /// Blocks taken from an interrupted bake.
    pub blocks_resumed: u64,
    /// Blocks taken from the city that is updated.
    pub blocks_unchanged: u64,
    /// In execution order.
    pub stages: Vec<StageReport>,
    /// Duration of all stages.
    pub seconds: f64,
    pub triangles_per_second: f64,
    pub objects_per_second: f64,
    /// Peak resident memory of the process; `None` where the system does not report it.
    pub peak_memory_bytes: Option<u64>,
}

/// One level of the quadtree.
#[derive(Debug, Clone, Serialize)]
pub struct LevelReport {
    /// 0 for the root.
    pub level: u8,
    /// Side of a column in metres.
    pub cell_m: f64,
    pub nodes: u64,
    /// Size of the level's V-BlockMaps.
    pub bytes: u64,
}

/// The meshes of one level of detail.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct MeshReport {
    /// 0 for the finest.
    pub lod: u8,
    /// Number of leaves with this level of detail.
    pub leaves: u64,
    /// Size of the mesh tiles.
    pub bytes: u64,
    pub triangles: u64,
    /// Pixels of all textures.
    pub texture_px: u64,
    /// Largest geometric error in metres.
    pub error_m: f32,
}

impl MeshReport {
    /// Sums meshes, given with their level of detail, by level; the finest first.
    pub(crate) fn by_lod(meshes: impl Iterator<Item = (u8, MeshLod)>) -> Vec<Self> {
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
    /// The name given to [`crate::Progress::stage`].
    pub name: String,
    pub seconds: f64,
}

/// Measures the duration of stages.
#[derive(Debug)]
pub(crate) struct StageClock {
    start: Instant,
    pub(crate) stages: Vec<StageReport>,
}

impl StageClock {
    pub(crate) fn new() -> Self {
        Self { start: Instant::now(), stages: Vec::new() }
    }

    /// Runs a stage and records its duration.
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

/// Where the tiles of a pack come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PackOutcome {
    /// Baked by this run.
    Baked,
    /// Taken from an interrupted bake.
    Resumed,
    /// Taken from the city that is updated.
    Unchanged,
}

/// Finished packs by [`PackOutcome`].
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct PackCounts {
    baked: u64,
    pub(crate) resumed: u64,
    unchanged: u64,
}

impl PackCounts {
    pub(crate) fn add(&mut self, outcome: PackOutcome) {
        match outcome {
            PackOutcome::Baked => self.baked += 1,
            PackOutcome::Resumed => self.resumed += 1,
            PackOutcome::Unchanged => self.unchanged += 1,
        }
    }
}

/// The contents of a report besides times.
pub(crate) struct ReportInput {
    pub(crate) manifest: Manifest,
    pub(crate) city_bytes: u64,
    pub(crate) read: ReadReport,
    pub(crate) filled_in: Vec<String>,
    pub(crate) ground: Option<GroundReport>,
    pub(crate) grid: CityGrid,
    pub(crate) threads: usize,
    pub(crate) start: ResumeStatus,
    pub(crate) blocks: PackCounts,
    pub(crate) meshes: Vec<MeshReport>,
}

impl BakeReport {
    pub(crate) fn new(input: ReportInput, clock: StageClock) -> Self {
        let ReportInput { manifest, city_bytes, read, filled_in, ground, grid, threads, start, blocks, meshes } = input;
        let seconds = clock.seconds();
        let per_second = |n: u64| n as f64 / seconds.max(1e-9);
        let counts = &manifest.counts;
        Self {
            levels: levels(&grid, counts),
            nodes: counts.nodes_per_level.iter().sum(),
            blockmap_bytes: counts.bytes_per_level.iter().sum(),
            objects: counts.objects,
            buildings: counts.buildings.unwrap_or_default(),
            size: counts.words(),
            triangles: counts.triangles,
            triangles_per_second: per_second(counts.triangles),
            objects_per_second: per_second(counts.objects),
            name: manifest.name,
            version: manifest.version,
            read,
            filled_in,
            ground,
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

fn levels(grid: &CityGrid, counts: &CityCounts) -> Vec<LevelReport> {
    let each = (0..=grid.depth).zip(counts.nodes_per_level.iter().zip(&counts.bytes_per_level));
    each.map(|(level, (nodes, bytes))| LevelReport {
        level,
        cell_m: grid.cell_m_at(level),
        nodes: *nodes,
        bytes: *bytes,
    })
    .collect()
}

/// Reads `VmHWM` of `/proc/self/status`; `None` where that does not exist.
fn peak_memory_bytes() -> Option<u64> {
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
    fn peak_memory_is_known_on_linux() {
        let peak = peak_memory_bytes().unwrap();
        assert!((1 << 20..1 << 40).contains(&peak), "{peak}");
    }

    #[test]
    fn clock_records_stages_in_order() {
        let mut clock = StageClock::new();
        assert_eq!(clock.time("read", || 7), 7);
        clock.time("write", || std::thread::sleep(std::time::Duration::from_millis(5)));
        assert_eq!(clock.stages.iter().map(|stage| stage.name.as_str()).collect::<Vec<_>>(), ["read", "write"]);
        assert!(clock.stages[1].seconds >= 0.005 && clock.seconds() >= clock.stages[1].seconds);
    }
}
