//! Bakes blocks of leaves into packs.

use super::block_scene::{BlockScene, estimate_memory_bytes};
use super::context::{FinishedPack, NodeMeasures, TileContext, encode_node};
use super::work_queue::{MemoryBudget, run_bounded};
use crate::columns::deviation;
use crate::columns::voxels::VoxelNode;
use crate::config::BakeConfig;
use crate::error::BakeError;
use crate::hash::ShortHash;
use crate::mesh;
use crate::report::PackOutcome;
use crate::sample::{BlockInput, SampleSettings, sample_block};
use crate::scene::Scene;
use crate::scene::grid::CityGrid;
use crate::scene::partition::{LeafBlock, Partition};
use crate::scene::scratch_scene::ScratchScene;
use crate::write::tile_pack::{self, EncodedPack, LeafMesh, PackId};
use insula_protocol::{BlockMap, TileId};
use insula_source::subject;
use rayon::prelude::*;
use std::cmp::Reverse;

/// Bakes the leaves of a city.
pub(super) struct LeafBaker<'a> {
    pub(super) context: &'a TileContext<'a>,
    pub(super) city: &'a ScratchScene,
    pub(super) partition: &'a Partition,
}

impl LeafBaker<'_> {
    /// Bakes all blocks within the memory limit: samples, cuts meshes, parametrises, encodes and stores. `fingerprints`
    /// are those of the partition's blocks. Fails with the first error of a block.
    pub(super) fn bake_all(&self, fingerprints: &[ShortHash]) -> Result<Vec<FinishedPack>, BakeError> {
        let TileContext { config, grid, pool, progress, previous, .. } = *self.context;
        // The queue is processed from both ends: few heavy blocks are in memory together, and the last blocks are
        // neither large nor many.
        let mut blocks: Vec<(&LeafBlock, ShortHash)> =
            self.partition.blocks.iter().zip(fingerprints.iter().copied()).collect();
        blocks.sort_by_key(|(block, _)| (Reverse(block.triangles), block.y, block.x));
        let total = blocks.iter().map(|(block, _)| u64::from(block.leaves.count_ones())).sum();
        progress.stage("sample", total);
        let budget = MemoryBudget::new(config.block_bytes());
        run_bounded(config.threads, &blocks, |(block, fingerprint)| {
            // A block that is only copied needs hardly any memory.
            let is_copied = previous.is_some_and(|previous| previous.has_block(self.pack(block), *fingerprint));
            let bytes = if is_copied { 0 } else { estimate_memory_bytes(block, grid) };
            budget.with(bytes, || pool.install(|| self.bake_block(block, *fingerprint)))
        })
    }

    /// Bakes one block, unless an interrupted bake finished it or the city to update has it.
    fn bake_block(&self, block: &LeafBlock, fingerprint: ShortHash) -> Result<FinishedPack, BakeError> {
        let TileContext { grid, packs, progress, previous, .. } = *self.context;
        let (pack, input) = (self.pack(block), Some(fingerprint));
        subject::set(format_args!("block of leaves {}/{}/{}", grid.depth, block.x, block.y));
        let leaves = self.partition.leaves(block);
        if let Some(stored) = tile_pack::find(packs, pack, fingerprint) {
            progress.skip(leaves.len() as u64);
            return Ok(FinishedPack { id: pack, input, stored, outcome: PackOutcome::Resumed });
        }
        let (outcome, content) = match previous.and_then(|previous| previous.block(pack, fingerprint, &leaves)) {
            Some(reused) => (PackOutcome::Unchanged, reused),
            None => (PackOutcome::Baked, self.bake_leaves(block, &leaves)?),
        };
        let stored = tile_pack::write(packs, pack, fingerprint, &content)?;
        if outcome == PackOutcome::Baked {
            progress.advance(leaves.len() as u64);
        } else {
            progress.skip(leaves.len() as u64);
        }
        Ok(FinishedPack { id: pack, input, stored, outcome })
    }

    fn pack(&self, block: &LeafBlock) -> PackId {
        PackId { level: self.context.grid.depth, y: block.y, x: block.x }
    }

    fn bake_leaves(&self, block: &LeafBlock, leaves: &[TileId]) -> Result<EncodedPack, BakeError> {
        let TileContext { grid, config, .. } = *self.context;
        let scene = BlockScene::load(self.partition, self.city, block, grid)?.into_scene(self.city)?;
        let grid = grid.around_block([block.x, block.y]);
        encode_leaves(scene, &grid, config, &config.options.sample, leaves, config.options.meshes)
    }
}

/// Samples the leaves of a block of `grid`, and encodes their tiles, and their meshes if wanted. Takes the block's scene
/// to free it early. Fails if a leaf exceeds the format's limits.
pub(super) fn encode_leaves(
    scene: Scene,
    grid: &CityGrid,
    config: &BakeConfig,
    sample: &SampleSettings,
    leaves: &[TileId],
    has_meshes: bool,
) -> Result<EncodedPack, BakeError> {
    let thin = scene.with_thin_landmarks();
    let sampled = thin.as_ref().unwrap_or(&scene);
    let triangles: Vec<u32> = (0..sampled.triangles.len() as u32).collect();
    let input = BlockInput { scene: sampled, grid, triangles: &triangles, leaves };
    let mut nodes = sample_block(&input, sample);
    drop(thin);
    nodes.sort_unstable_by_key(|node| node.id);
    let mesh = |node: &VoxelNode| {
        // Columns show plain ground as exactly.
        let lods = if node.has_columns() {
            mesh::leaf_lods(&scene, grid, node.id, config.options.quality)?
        } else {
            Vec::new()
        };
        Ok(LeafMesh { id: node.id, lods })
    };
    let meshes = if has_meshes { nodes.par_iter().map(mesh).collect::<Result<_, BakeError>>()? } else { Vec::new() };
    let source = deviation::source_surface(&scene, grid.corner);
    drop((scene, triangles));
    let measure = |map: &BlockMap, node: &VoxelNode| NodeMeasures {
        deviation: deviation::of_leaf(map, node, source.as_ref()),
        points: deviation::leaf_points(map),
        shows_children: false,
    };
    let encode = |node| encode_node(grid, config, node, "made from its voxels", [].into_iter(), measure);
    let tiles = nodes.into_par_iter().map(encode).collect::<Result<_, _>>()?;
    Ok(EncodedPack { tiles, meshes })
}
