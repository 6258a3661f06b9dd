//! The grid of a city, and its triangles sorted into blocks with the fingerprint of each.

use super::block_scene::{BlockScene, worst_memory_bytes};
use super::work_queue::{MemoryBudget, run_bounded};
use crate::config::BakeConfig;
use crate::error::BakeError;
use crate::hash::ShortHash;
use crate::read::{ALIGNED_LEAVES, FarModels};
use crate::scene::grid::CityGrid;
use crate::scene::partition::{BlockSquare, LeafBlock, Partition, PartitionOptions};
use crate::scene::scratch_budget::ScratchBudget;
use crate::scene::scratch_scene::ScratchScene;
use insula_protocol::NODE_CELLS;
use std::path::Path;

/// Memory of a triangle while its block is hashed.
const HASHED_TRIANGLE_BYTES: usize = 220;

/// Places the quadtree. Fails if the city is too wide for the cell size.
pub(super) fn city_grid(
    city: &ScratchScene,
    [mut min, mut max]: [[f64; 3]; 2],
    surroundings: Option<&FarModels>,
    cell_m: f64,
) -> Result<CityGrid, BakeError> {
    if let Some(land) = surroundings {
        let leaf_m = cell_m * NODE_CELLS as f64;
        let square_m = leaf_m * ALIGNED_LEAVES;
        for axis in 0..2 {
            let origin = city.origin[axis];
            let low = (min[axis] + origin).min(land.bounds[0][axis]);
            // The corner's leaf is the first of a square at which the city's terrain may end.
            min[axis] = (low / square_m).floor() * square_m + leaf_m / 2.0 - origin;
            max[axis] = max[axis].max(land.bounds[1][axis] - origin);
        }
        min[2] = min[2].min(land.z_range_m[0] - city.origin[2]);
    }
    CityGrid::covering(min, max, city.origin, cell_m).ok_or_else(|| {
        let side_m = (max[0] - min[0]).max(max[1] - min[1]);
        BakeError::Extent { side_m, cell_m }
    })
}

/// Fails if a block needs more memory than it may use. The message names the object with most surface in it.
fn check_block(
    block: &LeafBlock,
    partition: &Partition,
    city: &ScratchScene,
    grid: &CityGrid,
    config: &BakeConfig,
) -> Result<(), BakeError> {
    let (needed, limit) = (worst_memory_bytes(block, grid), config.max_block_bytes());
    if needed <= limit {
        return Ok(());
    }
    let object = partition.largest_object(block, grid)?.unwrap_or(0);
    let offset_m = grid.block_offset_m([block.x, block.y]);
    let [x, y] = [0, 1].map(|axis| city.origin[axis] + grid.corner[axis] + offset_m[axis]);
    let [needed_mib, limit_mib] = [needed, limit].map(|bytes| bytes as u64 >> 20);
    Err(BakeError::BlockTooLarge { object: city.describe(object), x, y, needed_mib, limit_mib })
}

/// A partition with the fingerprint of each block.
pub(super) struct HashedPartition {
    pub(super) partition: Partition,
    /// In the order of the partition's blocks.
    pub(super) hashes: Vec<ShortHash>,
}

/// The input of a partition.
#[derive(Clone, Copy)]
pub(super) struct HashedInput<'a> {
    pub(super) city: &'a ScratchScene,
    pub(super) grid: &'a CityGrid,
    pub(super) config: &'a BakeConfig,
    /// Bounds the buckets.
    pub(super) budget: &'a ScratchBudget,
}

impl HashedPartition {
    /// Sorts the triangles into those blocks of a square that they touch, in buckets in `folder`, and hashes each block's input. Fails if
    /// a block needs more memory than it may use, or as [`Partition::new`].
    pub(super) fn new(
        HashedInput { city, grid, config, budget }: HashedInput<'_>,
        folder: &Path,
        square: BlockSquare,
        advance: impl Fn(u64),
    ) -> Result<Self, BakeError> {
        let margin_m = config.options.sample.margin_m;
        let (buffer_bytes, max_blocks) = (config.bucket_bytes(), config.max_blocks());
        let options = PartitionOptions { folder, square, margin_m, buffer_bytes, max_blocks, budget };
        let partition = Partition::new(city, grid, options, advance)?;
        partition.blocks.iter().try_for_each(|block| check_block(block, &partition, city, grid, config))?;
        let budget = MemoryBudget::new(config.block_bytes());
        let hashes = run_bounded(config.threads, &partition.blocks, |block| {
            budget.with(block.triangles as usize * HASHED_TRIANGLE_BYTES, || {
                Ok::<_, BakeError>(
                    BlockScene::load(&partition, city, block, grid)?.fingerprint(city, config, grid, block),
                )
            })
        })?;
        Ok(Self { partition, hashes })
    }

    /// Position and fingerprint of each block.
    pub(super) fn fingerprints(&self) -> Vec<((u32, u32), ShortHash)> {
        self.partition.blocks.iter().zip(&self.hashes).map(|(block, hash)| ((block.x, block.y), *hash)).collect()
    }
}
