//! A city whose nodes are made by rule: nothing is read, nothing sampled, no parent made from its children.
//!
//! In: [`GeneratedCity`] and a function from a node's name to its columns. Out: a city folder. Next: the server.
//!
//! Everything after the sampler is the bake's own: coding, packs, bounds, archives, the manifest. Cities of a million
//! buildings are made so for measurements, in minutes.

use std::path::Path;

use insula_protocol::{Manifest, TileId};

use super::feed::feed;
use crate::{
    columns::{parametrise::parametrise, voxels::VoxelNode},
    config::{BakeConfig, BakeOptions},
    error::BakeError,
    progress::Progress,
    read::ReadReport,
    scene::grid::{BLOCK_LEAVES, CityGrid},
    write::{
        city::{self, CityInput, SceneFacts},
        pack::{self, EncodedTile, PackId, StoredTile},
        scratch::{InputHashes, ScratchFolder},
        tree::{self, TileTree},
    },
};

/// What is known of such a city before its nodes.
#[derive(Debug, Clone)]
pub struct GeneratedCity {
    /// Where its nodes lie; scene and world coordinates are the same.
    pub grid: CityGrid,
    /// What it is made from, for [`Manifest::settings`].
    pub rule: String,
    /// World bounds, `[min, max]`.
    pub bounds: [[f64; 3]; 2],
    /// World height of the plane around it.
    pub ground_z_m: f64,
    /// Buildings.
    pub objects: u64,
    /// Their triangles.
    pub triangles: u64,
}

/// Writes the city into `options.out`, of which only the output, the names, the threads and the quality are looked at.
/// `node` is asked for every leaf of the grid's square, and for every parent of a leaf that it gave; it must give those.
pub fn bake_generated(
    made: &GeneratedCity,
    node: &(dyn Fn(TileId) -> Option<VoxelNode> + Sync),
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<Manifest, BakeError> {
    let config = BakeConfig::new(options)?;
    let mut scratch = ScratchFolder::lock(&config.out)?;
    scratch.prepare(&InputHashes { settings: config.settings.clone(), scene: made.rule.clone() }, false)?;
    let packs = scratch.packs();
    let depth = made.grid.depth;
    let mut tree = TileTree::new(depth);
    for level in (0..=depth).rev() {
        let chunks = if level == depth { leaf_packs(depth) } else { parent_packs(&tree, level) };
        progress.stage(&format!("level {level}"), chunks.len() as u64);
        let work = |(pack, ids): &(PackId, Vec<TileId>)| {
            let stored = chunk(made, node, &config, (&tree, &packs), (*pack, ids));
            progress.advance(1);
            stored
        };
        let done = feed(config.threads, &chunks, work)?;
        tree.set(level, done.into_iter().flatten().collect());
        if tree.level(level).is_empty() {
            return Err(BakeError::Empty { triangles: 0, cell_m: config.cell_m });
        }
    }
    let facts = SceneFacts {
        origin: [0.0; 3],
        bounds: made.bounds,
        ground_z_m: made.ground_z_m,
        has_terrain: true,
        objects: made.objects,
        triangles: made.triangles,
        crs: None,
    };
    let read = ReadReport::default();
    let grid = &made.grid;
    let fingerprints = Vec::new();
    let input =
        CityInput { config: &config, grid, facts: &facts, read: &read, tree: &tree, packs: &packs, fingerprints };
    progress.stage("write", tree.levels().iter().map(|level| level.len() as u64).sum());
    let written = city::write(input, &scratch.city(), |n| progress.advance(n))?;
    scratch.publish()?;
    Ok(written.manifest)
}

/// All leaves of the root square, pack by pack.
fn leaf_packs(depth: u8) -> Vec<(PackId, Vec<TileId>)> {
    let side = (1u32 << depth).div_ceil(BLOCK_LEAVES);
    let place = |i: u32| (i % side, i / side);
    let all = (0..side * side).map(place).map(|(x, y)| {
        let ids = (0..BLOCK_LEAVES * BLOCK_LEAVES).filter_map(|k| {
            TileId::new(depth, x * BLOCK_LEAVES + k % BLOCK_LEAVES, y * BLOCK_LEAVES + k / BLOCK_LEAVES)
        });
        (PackId { level: depth, y, x }, ids.collect())
    });
    all.collect()
}

fn parent_packs(tree: &TileTree, level: u8) -> Vec<(PackId, Vec<TileId>)> {
    let mut nodes = tree.parents_of(level + 1);
    nodes.sort_by_key(|id| PackId::of(*id));
    let chunks = nodes.chunk_by(|a, b| PackId::of(*a) == PackId::of(*b));
    chunks.map(|ids| (PackId::of(ids[0]), ids.to_vec())).collect()
}

fn chunk(
    made: &GeneratedCity,
    node: &(dyn Fn(TileId) -> Option<VoxelNode> + Sync),
    config: &BakeConfig,
    (tree, packs): (&TileTree, &Path),
    (pack, ids): (PackId, &[TileId]),
) -> Result<Vec<StoredTile>, BakeError> {
    let mut tiles = Vec::with_capacity(ids.len());
    for id in ids {
        match node(*id) {
            Some(voxels) => tiles.push(tile(&made.grid, config, tree, &voxels)?),
            None if id.level() == made.grid.depth => {}
            None => return Err(BakeError::Scratch { path: packs.to_owned() }),
        }
    }
    if tiles.is_empty() { Ok(Vec::new()) } else { pack::write(packs, pack, &tiles) }
}

fn tile(grid: &CityGrid, config: &BakeConfig, tree: &TileTree, voxels: &VoxelNode) -> Result<EncodedTile, BakeError> {
    let id = voxels.id;
    let map = parametrise(grid, voxels).map_err(BakeError::tile(id, "made from its voxels"))?;
    let [mut z_min_m, mut z_max_m] = tree::outward(tree::z_bounds(&map).unwrap_or([map.z_base_m(); 2]));
    if id.level() < grid.depth {
        for child in id.children().filter_map(|child| tree.get(child)) {
            (z_min_m, z_max_m) = (z_min_m.min(child.z_min_m), z_max_m.max(child.z_max_m));
        }
    }
    let bytes = map.encode_at(config.quality).map_err(BakeError::tile(id, "encoded"))?;
    Ok(EncodedTile { id, z_min_m, z_max_m, bytes })
}
