//! Blocks of leaves to stored tiles.
//!
//! In: one block of the partition. Out: its leaves' tiles in a pack. Next: `parents`.

use insula_protocol::TileId;
use rayon::prelude::*;

use super::{Done, Stage, block::LocalCity};
use crate::{
    columns::{parametrise::parametrise, voxels::VoxelNode},
    error::BakeError,
    mesh,
    report::Made,
    sample::{BlockInput, sample_block},
    scene::{
        partition::{Block, Partition},
        scratch_scene::{City, ShortHash},
    },
    write::{
        mesh_pack::{self, LeafMesh, StoredMesh},
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
    pub(super) fn block(&self, block: &Block, fingerprint: ShortHash) -> Result<Done, BakeError> {
        let Stage { grid, packs, progress, before, config, .. } = *self.stage;
        let pack = PackId { level: grid.depth, y: block.y, x: block.x };
        let leaves = self.partition.leaves(block);
        let held = before.filter(|before| before.holds(block, fingerprint));
        let held = held.and_then(|before| Some((before.tiles(&leaves)?, before.meshes(&leaves)?)));
        let unchanged = held.is_some();
        let mut done = if let Some((tiles, meshes)) = self.found(pack) {
            Done { tiles, meshes, made: Made::Resumed }
        } else {
            let (made, (tiles, leaf_meshes)) = match held {
                Some(held) => (Made::Unchanged, held),
                None => (Made::Baked, self.bake(block, &leaves)?),
            };
            // Whoever finds the tiles finds their meshes too.
            let meshes = if config.meshes { mesh_pack::write(packs, pack, &leaf_meshes)? } else { Vec::new() };
            Done { tiles: pack::write(packs, pack, &tiles)?, meshes, made }
        };
        done.tiles.iter_mut().for_each(|tile| tile.unchanged = unchanged);
        progress.advance(leaves.len() as u64);
        Ok(done)
    }

    /// What an interrupted bake finished.
    fn found(&self, pack: PackId) -> Option<(Vec<Stored>, Vec<StoredMesh>)> {
        let tiles = self.stage.found(pack)?;
        let meshes = if self.stage.config.meshes { mesh_pack::find(self.stage.packs, pack)? } else { Vec::new() };
        Some((tiles, meshes))
    }

    fn bake(&self, block: &Block, leaves: &[TileId]) -> Result<(Vec<Tile>, Vec<LeafMesh>), BakeError> {
        let Stage { grid, config, .. } = *self.stage;
        let scene = LocalCity::load(self.partition, block)?.into_scene(self.city)?;
        let triangles: Vec<u32> = (0..scene.triangles.len() as u32).collect();
        let input = BlockInput { scene: &scene, grid, triangles: &triangles, leaves };
        let mut nodes = sample_block(&input, &config.sample);
        nodes.sort_unstable_by_key(|node| node.id);
        let mesh = |node: &VoxelNode| Ok((node.id, mesh::leaf_lods(&scene, grid, node.id, config.quality)?));
        let meshes =
            if config.meshes { nodes.par_iter().map(mesh).collect::<Result<_, BakeError>>()? } else { Vec::new() };
        drop((scene, triangles));
        let tiles = nodes.into_par_iter().map(|node| self.tile(node)).collect::<Result<_, _>>()?;
        Ok((tiles, meshes))
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
