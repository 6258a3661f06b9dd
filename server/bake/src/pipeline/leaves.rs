//! Blocks of leaves to stored tiles.
//!
//! In: one block of the partition. Out: its leaves' tiles in a pack. Next: `parents`.

use insula_protocol::TileId;
use rayon::prelude::*;

use super::Stage;
use crate::{
    error::BakeError,
    parametrise::parametrise,
    partition::{Block, Partition},
    sample::{BlockInput, sample_block},
    scene::Scene,
    voxels::VoxelNode,
    write::{
        pack::{self, PackId, Stored, Tile},
        tree,
    },
};

/// What the leaves are made from.
pub(super) struct Leaves<'a> {
    pub(super) stage: &'a Stage<'a>,
    pub(super) scene: &'a Scene,
    pub(super) partition: &'a Partition,
}

impl Leaves<'_> {
    /// Bakes one block, or finds that an earlier run did.
    pub(super) fn block(&self, block: &Block) -> Result<(Vec<Stored>, bool), BakeError> {
        let Stage { grid, packs, progress, config, .. } = *self.stage;
        let pack = PackId { level: grid.depth, y: block.y, x: block.x };
        let leaves = self.partition.leaves(block);
        if let Some(stored) = self.stage.found(pack) {
            progress.advance(leaves.len() as u64);
            return Ok((stored, true));
        }
        let triangles = self.partition.triangles(block);
        let input = BlockInput { scene: self.scene, grid, triangles, leaves: &leaves };
        let mut nodes = sample_block(&input, &config.sample);
        nodes.sort_unstable_by_key(|node| node.id);
        let tiles = nodes.into_par_iter().map(|node| self.tile(node)).collect::<Result<Vec<Tile>, _>>()?;
        let stored = pack::write(packs, pack, &tiles)?;
        progress.advance(leaves.len() as u64);
        Ok((stored, false))
    }

    /// Takes the node, so that its voxels are let go as soon as they are coded.
    fn tile(&self, node: VoxelNode) -> Result<Tile, BakeError> {
        let id: TileId = node.id;
        let map = parametrise(self.stage.grid, &node).map_err(BakeError::tile(id, "made from its voxels"))?;
        drop(node);
        let bounds = tree::z_bounds(&map).unwrap_or([map.z_base_m(); 2]);
        let [z_min_m, z_max_m] = tree::outward(bounds);
        Ok(Tile { id, z_min_m, z_max_m, bytes: map.encode().map_err(BakeError::tile(id, "encoded"))? })
    }
}
