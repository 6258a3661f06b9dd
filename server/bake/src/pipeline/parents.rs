//! Bakes parents from their four children, level by level towards the root.

use super::context::{FinishedPack, FinishedTiles, NodeMeasures, TileContext, encode_node};
use super::far_land::FarLand;
use super::work_queue::run_bounded;
use crate::columns::deviation::{self, FarLeaves};
use crate::columns::voxels::VoxelNode;
use crate::columns::{coarser, downsample};
use crate::error::BakeError;
use crate::report::PackOutcome;
use crate::write::tile_pack::{self, EncodedPack, EncodedTile, PackNodes, PackReader};
use crate::write::tile_tree::TileTree;
use insula_protocol::subtree::NodeDeviation;
use insula_protocol::{BlockMap, TileId};
use rayon::prelude::*;

/// Bakes all nodes of a level from the finished tiles of the level below: averages, parametrises, encodes and stores.
/// Nodes of the land around the city are made from its elevation models. Fails with the first error of a node.
pub(super) fn bake_level(
    context: &TileContext<'_>,
    finished: &FinishedTiles,
    land: Option<&FarLand<'_>>,
    level: u8,
) -> Result<Vec<FinishedPack>, BakeError> {
    let mut nodes = finished.tree.parents_of(level + 1);
    nodes.extend(land.into_iter().flat_map(|land| land.nodes(level)));
    let packs = PackNodes::group(nodes);
    context.progress.stage(&format!("level {level}"), packs.iter().map(|pack| pack.nodes.len() as u64).sum());
    run_bounded(context.config.threads, &packs, |pack| {
        context.pool.install(|| bake_pack(context, finished, land, pack))
    })
}

/// Bakes the nodes of one pack, unless an interrupted bake finished it. Nodes that the city to update has of the same input are taken
/// from it.
fn bake_pack(
    context: &TileContext<'_>,
    FinishedTiles { tree, inputs, .. }: &FinishedTiles,
    land: Option<&FarLand<'_>>,
    pack: &PackNodes,
) -> Result<FinishedPack, BakeError> {
    let land_of = |id: TileId| land.filter(|land| land.contains(id));
    let input_of = |id: TileId| match land_of(id) {
        Some(land) => Some(land.input(context.config, context.grid)),
        None => inputs.of_parent(id),
    };
    let id = pack.pack;
    let input = inputs.of_parents(pack.nodes.iter().map(|id| (*id, input_of(*id))));
    if let Some(stored) = input.and_then(|input| tile_pack::find(context.packs, id, input)) {
        context.progress.skip(pack.nodes.len() as u64);
        return Ok(FinishedPack { id, input, stored, outcome: PackOutcome::Resumed });
    }
    let baked = pack.nodes.par_iter().map(|id| {
        if let Some(land) = land_of(*id) {
            let tile = land.bake(context.config, context.grid, *id)?;
            context.progress.advance(1);
            return Ok(tile.map(|tile| (tile, false)));
        }
        let reused = context.previous.and_then(|previous| previous.parent(*id, input_of(*id)));
        let is_unchanged = reused.is_some();
        let mut reader = PackReader::new(context.packs);
        let children = id.children().filter_map(|child| tree.get(child));
        let points: Vec<_> = children.map(|child| reader.read_points(child)).collect::<Result<_, _>>()?;
        let points = deviation::spread(points.concat());
        let tile = match reused {
            Some(tile) => EncodedTile { points, ..tile },
            None => bake_node(context, tree, *id, &mut reader, points)?,
        };
        if is_unchanged {
            context.progress.skip(1)
        } else {
            context.progress.advance(1)
        };
        Ok::<_, BakeError>(Some((tile, is_unchanged)))
    });
    let baked: Vec<Option<(EncodedTile, bool)>> = baked.collect::<Result<_, _>>()?;
    let (tiles, unchanged): (Vec<EncodedTile>, Vec<bool>) = baked.into_iter().flatten().unzip();
    let content = EncodedPack { tiles, meshes: Vec::new() };
    // Without a known input, it is never looked for.
    let stored = tile_pack::write(context.packs, id, input.unwrap_or_default(), &content)?;
    let all_unchanged = unchanged.iter().all(|unchanged| *unchanged);
    let outcome = if all_unchanged { PackOutcome::Unchanged } else { PackOutcome::Baked };
    Ok(FinishedPack { id, input, stored, outcome })
}

/// Makes a node from its children. `points` are those of its leaves.
fn bake_node(
    context: &TileContext<'_>,
    tree: &TileTree,
    id: TileId,
    reader: &mut PackReader<'_>,
    points: Vec<[f32; 3]>,
) -> Result<EncodedTile, BakeError> {
    let mut children: [Option<BlockMap>; 4] = [const { None }; 4];
    for stored in id.children().filter_map(|child| tree.get(child)) {
        let bytes = reader.read(stored)?;
        let child = BlockMap::decode(stored.id, &bytes).map_err(BakeError::tile(stored.id, "read back"))?;
        children[stored.id.quadrant()] = Some(child);
    }
    let node = downsample::parent_node(context.grid, id, children.each_ref().map(Option::as_ref), context.plane_m);
    let stored = || id.children().filter_map(|child| tree.get(child));
    let below = stored().fold(NodeDeviation::default(), |most, child| most.max(&child.deviation));
    let leaf_cell_m = (id.level() + 1 < context.grid.depth).then_some(context.grid.cell_m);
    let measure = |map: &BlockMap, _: &VoxelNode| {
        let far_leaves = leaf_cell_m.map(|cell_m| FarLeaves { points: &points, cell_m });
        let deviation = deviation::of_parent(map, children.iter().flatten(), &below, far_leaves);
        let all = children.each_ref().map(Option::as_ref);
        let shows_children = coarser::shows_children(map, all, context.grid.cell_m as f32);
        NodeMeasures { deviation, points, shows_children }
    };
    encode_node(context.grid, context.config, node, "made from its children", stored(), measure)
}
