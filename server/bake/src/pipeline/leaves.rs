//! Blocks of leaves to stored tiles.
//!
//! In: one block of the partition. Out: its leaves' tiles in a pack. Next: `parents`.

use insula_protocol::TileId;
use rayon::prelude::*;

use super::{Stage, block::LocalCity};
use crate::{
    error::BakeError,
    parametrise::parametrise,
    partition::{Block, Partition},
    report::Made,
    sample::{BlockInput, sample_block},
    spool::{City, ShortHash},
    voxels::VoxelNode,
    write::{
        pack::{self, PackId, Stored, Tile},
        tree,
    },
};

/// What the leaves are made from.
pub(super) struct Leaves<'a> {
    pub(super) stage: &'a Stage<'a>,
    pub(super) city: &'a City,
    pub(super) partition: &'a Partition,
}

impl Leaves<'_> {
    /// Bakes one block, or finds that an earlier run did, or that the city to update has it already.
    pub(super) fn block(&self, block: &Block, fingerprint: ShortHash) -> Result<(Vec<Stored>, Made), BakeError> {
        let Stage { grid, packs, progress, before, .. } = *self.stage;
        let pack = PackId { level: grid.depth, y: block.y, x: block.x };
        let leaves = self.partition.leaves(block);
        let held = before.filter(|before| before.holds(block, fingerprint)).and_then(|before| before.tiles(&leaves));
        let unchanged = held.is_some();
        let (mut stored, made) = if let Some(stored) = self.stage.found(pack) {
            (stored, Made::Resumed)
        } else if let Some(tiles) = held {
            (pack::write(packs, pack, &tiles)?, Made::Unchanged)
        } else {
            (pack::write(packs, pack, &self.bake(block, &leaves)?)?, Made::Baked)
        };
        stored.iter_mut().for_each(|tile| tile.unchanged = unchanged);
        progress.advance(leaves.len() as u64);
        Ok((stored, made))
    }

    fn bake(&self, block: &Block, leaves: &[TileId]) -> Result<Vec<Tile>, BakeError> {
        let Stage { grid, config, .. } = *self.stage;
        let scene = LocalCity::load(self.partition, block)?.into_scene(self.city)?;
        let triangles: Vec<u32> = (0..scene.triangles.len() as u32).collect();
        let input = BlockInput { scene: &scene, grid, triangles: &triangles, leaves };
        let mut nodes = sample_block(&input, &config.sample);
        drop((scene, triangles));
        nodes.sort_unstable_by_key(|node| node.id);
        nodes.into_par_iter().map(|node| self.tile(node)).collect()
    }

    /// Takes the node, so that its voxels are let go as soon as they are coded.
    fn tile(&self, node: VoxelNode) -> Result<Tile, BakeError> {
        let id: TileId = node.id;
        let map = parametrise(self.stage.grid, &node).map_err(BakeError::tile(id, "made from its voxels"))?;
        drop(node);
        let bounds = tree::z_bounds(&map).unwrap_or([map.z_base_m(); 2]);
        let [z_min_m, z_max_m] = tree::outward(bounds);
        let bytes = map.encode_at(self.stage.config.quality).map_err(BakeError::tile(id, "encoded"))?;
        Ok(Tile { id, z_min_m, z_max_m, bytes })
    }
}
