//! What the stages that bake tiles share.

use super::pack_inputs::PackInputs;
use super::update::PreviousCity;
use crate::columns::parametrise::parametrise;
use crate::columns::voxels::VoxelNode;
use crate::config::BakeConfig;
use crate::error::BakeError;
use crate::hash::ShortHash;
use crate::progress::Progress;
use crate::report::{PackCounts, PackOutcome};
use crate::scene::grid::CityGrid;
use crate::write::tile_pack::{EncodedTile, PackId, StoredPack, StoredTile};
use crate::write::tile_tree::{TileTree, round_outward, z_bounds};
use insula_protocol::BlockMap;
use insula_protocol::subtree::NodeDeviation;
use rayon::ThreadPool;
use std::path::Path;

/// The input of the stages that bake tiles.
#[derive(Clone, Copy)]
pub(super) struct TileContext<'a> {
    pub(super) config: &'a BakeConfig,
    pub(super) grid: &'a CityGrid,
    pub(super) pool: &'a ThreadPool,
    /// The folder of finished packs. Those of an interrupted bake that were made from the same input are not baked again.
    pub(super) packs: &'a Path,
    pub(super) progress: &'a dyn Progress,
    /// The city to update.
    pub(super) previous: Option<&'a PreviousCity>,
    /// Height of the plane above the grid's height zero, if generated ground ends at it.
    pub(super) plane_m: Option<f32>,
}

/// A baked, resumed or reused pack.
pub(super) struct FinishedPack {
    pub(super) id: PackId,
    /// Hash of what it is made from, if that is known.
    pub(super) input: Option<ShortHash>,
    pub(super) stored: StoredPack,
    pub(super) outcome: PackOutcome,
}

/// The tiles of all levels that are finished, and how they were obtained.
pub(super) struct FinishedTiles {
    pub(super) tree: TileTree,
    pub(super) inputs: PackInputs,
    pub(super) counts: PackCounts,
}

impl FinishedTiles {
    pub(super) fn new(context: &TileContext<'_>) -> Self {
        let (tree, inputs) = (TileTree::new(context.grid.depth), PackInputs::new(context.plane_m));
        Self { tree, inputs, counts: PackCounts::default() }
    }

    pub(super) fn add_level(&mut self, level: u8, packs: Vec<FinishedPack>) {
        let (mut tiles, mut meshes) = (Vec::new(), Vec::new());
        for pack in packs {
            self.counts.add(pack.outcome);
            if let Some(input) = pack.input {
                self.inputs.set(pack.id, input);
            }
            tiles.extend(pack.stored.tiles);
            meshes.extend(pack.stored.meshes);
        }
        self.tree.set(level, tiles);
        if !meshes.is_empty() {
            self.tree.set_meshes(meshes);
        }
    }
}

/// What a finished node is compared for.
#[derive(Default)]
pub(super) struct NodeMeasures {
    /// How far it lies from the source.
    pub(super) deviation: NodeDeviation,
    /// Points for its ancestors.
    pub(super) points: Vec<[f32; 3]>,
    /// Whether it shows the same as its children.
    pub(super) shows_children: bool,
}

/// Encodes a node, whose bounds are to contain those of its `children`. Takes the node to free its voxels early. `measure` compares
/// it with the source and its children. Fails if it exceeds the format's limits; `source` then says what the
/// node is made from.
pub(super) fn encode_node<'a>(
    grid: &CityGrid,
    config: &BakeConfig,
    node: VoxelNode,
    source: &'static str,
    children: impl Iterator<Item = &'a StoredTile>,
    measure: impl FnOnce(&BlockMap, &VoxelNode) -> NodeMeasures,
) -> Result<EncodedTile, BakeError> {
    let id = node.id;
    let map = parametrise(grid, &node).map_err(BakeError::tile(id, source))?;
    let NodeMeasures { deviation, points, shows_children } = measure(&map, &node);
    drop(node);
    let (mut z_min_m, mut z_max_m) = (f32::INFINITY, f32::NEG_INFINITY);
    let own = z_bounds(&map.clone().stand_on_ground()).map(round_outward);
    for [low, high] in children.map(|child| [child.z_min_m, child.z_max_m]).chain(own) {
        (z_min_m, z_max_m) = (z_min_m.min(low), z_max_m.max(high));
    }
    if z_min_m > z_max_m {
        [z_min_m, z_max_m] = round_outward([map.z_base_m(); 2]);
    }
    let bytes = map.encode_at(config.options.quality).map_err(BakeError::tile(id, "encoded"))?;
    Ok(EncodedTile { id, z_min_m, z_max_m, deviation, points, bytes, shows_children })
}
