//! Blocks of leaves to stored tiles.
//!
//! In: one block of the partition. Out: its leaves' tiles in a pack. Next: `parents`.

use insula_protocol::TileId;
use rayon::prelude::*;

use super::{FinishedPack, TileContext, block::BlockScene};
use crate::{
    columns::{parametrise::parametrise, voxels::VoxelNode},
    error::BakeError,
    mesh,
    report::PackOutcome,
    sample::{BlockInput, sample_block},
    scene::{
        partition::{LeafBlock, Partition},
        scratch_scene::{ScratchScene, ShortHash},
    },
    write::{
        mesh_pack::{self, LeafMesh, StoredMesh},
        pack::{self, EncodedTile, PackId, StoredTile},
        tree,
    },
};

/// What the leaves are made from.
pub(super) struct LeafBaker<'a> {
    pub(super) stage: &'a TileContext<'a>,
    pub(super) city: &'a ScratchScene,
    pub(super) partition: &'a Partition,
}

impl LeafBaker<'_> {
    /// Bakes one block, or finds that an earlier run did, or that the city to update has it already.
    pub(super) fn block(&self, block: &LeafBlock, fingerprint: ShortHash) -> Result<FinishedPack, BakeError> {
        let TileContext { grid, packs, progress, before, config, .. } = *self.stage;
        let pack = PackId { level: grid.depth, y: block.y, x: block.x };
        let leaves = self.partition.leaves(block);
        let held = before.filter(|before| before.holds(block, fingerprint));
        let held = held.and_then(|before| Some((before.tiles(&leaves)?, before.meshes(&leaves)?)));
        let unchanged = held.is_some();
        let mut done = if let Some((tiles, meshes)) = self.found(pack) {
            FinishedPack { tiles, meshes, made: PackOutcome::Resumed }
        } else {
            let (made, (tiles, leaf_meshes)) = match held {
                Some(held) => (PackOutcome::Unchanged, held),
                None => (PackOutcome::Baked, self.bake(block, &leaves)?),
            };
            // Whoever finds the tiles finds their meshes too.
            let meshes = if config.meshes { mesh_pack::write(packs, pack, &leaf_meshes)? } else { Vec::new() };
            FinishedPack { tiles: pack::write(packs, pack, &tiles)?, meshes, made }
        };
        done.tiles.iter_mut().for_each(|tile| tile.unchanged = unchanged);
        progress.advance(leaves.len() as u64);
        Ok(done)
    }

    /// What an interrupted bake finished.
    fn found(&self, pack: PackId) -> Option<(Vec<StoredTile>, Vec<StoredMesh>)> {
        let tiles = self.stage.found(pack)?;
        let meshes = if self.stage.config.meshes { mesh_pack::find(self.stage.packs, pack)? } else { Vec::new() };
        Some((tiles, meshes))
    }

    fn bake(&self, block: &LeafBlock, leaves: &[TileId]) -> Result<(Vec<EncodedTile>, Vec<LeafMesh>), BakeError> {
        let TileContext { grid, config, .. } = *self.stage;
        let scene = BlockScene::load(self.partition, block)?.into_scene(self.city)?;
        let triangles: Vec<u32> = (0..scene.triangles.len() as u32).collect();
        let input = BlockInput { scene: &scene, grid, triangles: &triangles, leaves };
        let mut nodes = sample_block(&input, &config.sample);
        nodes.sort_unstable_by_key(|node| node.id);
        let mesh = |node: &VoxelNode| Ok((node.id, mesh::leaf(&scene, grid, node.id, config.quality)?));
        let meshes =
            if config.meshes { nodes.par_iter().map(mesh).collect::<Result<_, BakeError>>()? } else { Vec::new() };
        drop((scene, triangles));
        let tiles = nodes.into_par_iter().map(|node| self.tile(node)).collect::<Result<_, _>>()?;
        Ok((tiles, meshes))
    }

    /// Takes the node, so that its voxels are let go as soon as they are coded.
    fn tile(&self, node: VoxelNode) -> Result<EncodedTile, BakeError> {
        let id: TileId = node.id;
        let map = parametrise(self.stage.grid, &node).map_err(BakeError::tile(id, "made from its voxels"))?;
        drop(node);
        let bounds = tree::z_bounds(&map).unwrap_or([map.z_base_m(); 2]);
        let [z_min_m, z_max_m] = tree::outward(bounds);
        let bytes = map.encode_at(self.stage.config.quality).map_err(BakeError::tile(id, "encoded"))?;
        Ok(EncodedTile { id, z_min_m, z_max_m, bytes })
    }
}
