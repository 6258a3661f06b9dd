//! Nodes from their four children, level by level towards the root.
//!
//! In: the stored tiles of the level below. Out: this level's tiles in packs. Next: the level above, then `write`.

use insula_protocol::{BlockMap, TileId};
use rayon::prelude::*;

use super::Stage;
use crate::{
    error::BakeError,
    lod,
    parametrise::parametrise,
    write::{
        pack::{self, PackId, PackReader, Stored, Tile},
        tree::{self, Tree},
    },
};

/// Nodes of one pack that are to be made.
pub(super) struct Chunk {
    pub(super) pack: PackId,
    pub(super) nodes: Vec<TileId>,
}

/// The nodes one level up from `level`, pack by pack.
pub(super) fn chunks_above(tree: &Tree, level: u8) -> Vec<Chunk> {
    let mut nodes = tree.parents_of(level);
    nodes.sort_by_key(|id| PackId::of(*id));
    nodes
        .chunk_by(|a, b| PackId::of(*a) == PackId::of(*b))
        .map(|nodes| Chunk { pack: PackId::of(nodes[0]), nodes: nodes.to_vec() })
        .collect()
}

/// Makes one pack's nodes, or finds that an earlier run did.
pub(super) fn chunk(stage: &Stage<'_>, tree: &Tree, chunk: &Chunk) -> Result<(Vec<Stored>, bool), BakeError> {
    if let Some(stored) = stage.found(chunk.pack) {
        stage.progress.advance(chunk.nodes.len() as u64);
        return Ok((stored, true));
    }
    let tiles = chunk.nodes.par_iter().map(|id| parent(stage, tree, *id)).collect::<Result<Vec<Tile>, _>>()?;
    Ok((pack::write(stage.packs, chunk.pack, &tiles)?, false))
}

fn parent(stage: &Stage<'_>, tree: &Tree, id: TileId) -> Result<Tile, BakeError> {
    let mut reader = PackReader::new(stage.packs);
    let mut children: [Option<BlockMap>; 4] = [const { None }; 4];
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for stored in id.children().filter_map(|child| tree.get(child)) {
        let bytes = reader.read(stored)?;
        let child = BlockMap::decode(&bytes).map_err(BakeError::tile(stored.id, "read back"))?;
        children[stored.id.quadrant()] = Some(child);
        (low, high) = (low.min(stored.z_min_m), high.max(stored.z_max_m));
    }
    let node = lod::parent(stage.grid, id, children.each_ref().map(Option::as_ref));
    drop(children);
    let map = parametrise(stage.grid, &node).map_err(BakeError::tile(id, "made from its children"))?;
    if let Some(bounds) = tree::z_bounds(&map) {
        let [z_min_m, z_max_m] = tree::outward(bounds);
        (low, high) = (low.min(z_min_m), high.max(z_max_m));
    }
    stage.progress.advance(1);
    Ok(Tile { id, z_min_m: low, z_max_m: high, bytes: map.encode().map_err(BakeError::tile(id, "encoded"))? })
}
