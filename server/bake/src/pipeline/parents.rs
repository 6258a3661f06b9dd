//! Nodes from their four children, level by level towards the root.
//!
//! In: the stored tiles of the level below. Out: this level's tiles in packs. Next: the level above, then `write`.

use insula_protocol::{BlockMap, TileId};
use rayon::prelude::*;

use super::{Done, Stage, update::Before};
use crate::{
    columns::{downsample, parametrise::parametrise},
    error::BakeError,
    report::Made,
    write::{
        pack::{self, PackId, PackReader, Tile},
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

/// Makes one pack's nodes, or finds that an earlier run did, or that nothing below them changed.
pub(super) fn chunk(stage: &Stage<'_>, tree: &Tree, chunk: &Chunk) -> Result<Done, BakeError> {
    if let Some(tiles) = stage.found(chunk.pack) {
        stage.progress.advance(chunk.nodes.len() as u64);
        return Ok(Done { tiles, meshes: Vec::new(), made: Made::Resumed });
    }
    let made = chunk.nodes.par_iter().map(|id| {
        let held = stage.before.filter(|before| unchanged(before, tree, *id)).and_then(|before| before.tile(*id));
        let unchanged = held.is_some();
        let tile = held.map_or_else(|| parent(stage, tree, *id), Ok)?;
        stage.progress.advance(1);
        Ok::<_, BakeError>((tile, unchanged))
    });
    let (tiles, unchanged): (Vec<Tile>, Vec<bool>) = made.collect::<Result<Vec<_>, _>>()?.into_iter().unzip();
    let mut tiles = pack::write(stage.packs, chunk.pack, &tiles)?;
    tiles.iter_mut().zip(&unchanged).for_each(|(tile, unchanged)| tile.unchanged = *unchanged);
    let made = if unchanged.iter().all(|unchanged| *unchanged) { Made::Unchanged } else { Made::Baked };
    Ok(Done { tiles, meshes: Vec::new(), made })
}

/// Whether the node has the children that it had, each as it was.
fn unchanged(before: &Before, tree: &Tree, id: TileId) -> bool {
    id.children().all(|child| match tree.get(child) {
        Some(stored) => stored.unchanged && before.has(child),
        None => !before.has(child),
    })
}

fn parent(stage: &Stage<'_>, tree: &Tree, id: TileId) -> Result<Tile, BakeError> {
    let mut reader = PackReader::new(stage.packs);
    let mut children: [Option<BlockMap>; 4] = [const { None }; 4];
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for stored in id.children().filter_map(|child| tree.get(child)) {
        let bytes = reader.read(stored)?;
        let child = BlockMap::decode(stored.id, &bytes).map_err(BakeError::tile(stored.id, "read back"))?;
        children[stored.id.quadrant()] = Some(child);
        (low, high) = (low.min(stored.z_min_m), high.max(stored.z_max_m));
    }
    let node = downsample::parent_node(stage.grid, id, children.each_ref().map(Option::as_ref));
    drop(children);
    let map = parametrise(stage.grid, &node).map_err(BakeError::tile(id, "made from its children"))?;
    if let Some(bounds) = tree::z_bounds(&map) {
        let [z_min_m, z_max_m] = tree::outward(bounds);
        (low, high) = (low.min(z_min_m), high.max(z_max_m));
    }
    let bytes = map.encode_at(stage.config.quality).map_err(BakeError::tile(id, "encoded"))?;
    Ok(Tile { id, z_min_m: low, z_max_m: high, bytes })
}
