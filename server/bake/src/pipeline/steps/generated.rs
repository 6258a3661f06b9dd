//! Tiles that a rule makes instead of the regions and the crown, for measurements of the join.

use super::job::BakeSteps;
use super::layout::{PLAN, PLAN_KIND};
use super::region_file::{INDEX_KIND, TileIndex, index_name};
use super::scan::{put_file, scratch_folder};
use super::{crown, region};
use crate::error::BakeError;
use crate::hash::short_hash;
use crate::write::archive::archive_order;
use crate::write::tile_pack::StoredTile;
use insula_protocol::TileId;
use insula_protocol::subtree::NodeDeviation;
use std::fs::File;
use std::io::Write;

impl BakeSteps<'_> {
    /// Replaces the plan by that of a square city without objects, and writes the results of all regions and the crown: tiles of random
    /// bytes, from half to one and a half times `tile_bytes` long, at all nodes to level `depth`. Returns the size of all tiles. Fails if
    /// there is no plan, or if the store does not take the tiles.
    pub fn generate_tiles(&self, depth: u8, tile_bytes: u32) -> Result<u64, BakeError> {
        let mut plan = self.read_plan()?;
        plan.grid.depth = depth;
        plan.region_level = depth.saturating_sub(self.region_leaves().ilog2() as u8);
        let side = 1_u32 << plan.region_level;
        plan.regions = (0..side * side).map(|i| [i % side, i / side]).collect();
        plan.regions.sort_unstable_by_key(|[x, y]| fast_hilbert::xy2h(*x, *y, plan.region_level));
        plan.rows = 0;
        let crown: Vec<TileId> = (0..plan.region_level).flat_map(|level| nodes_below(TileId::ROOT, level)).collect();
        let mut bytes = self.generate(crown::FOLDER, crown, tile_bytes)?;
        for (region, place) in plan.regions.iter().enumerate() {
            let root = TileId::new(plan.region_level, place[0], place[1]);
            let levels = || plan.region_level..=depth;
            let nodes = root.into_iter().flat_map(|root| levels().flat_map(move |level| nodes_below(root, level)));
            bytes += self.generate(&region::folder_name(region), nodes.collect(), tile_bytes)?;
        }
        self.objects().write(PLAN, PLAN_KIND, &plan)?;
        Ok(bytes)
    }

    fn generate(&self, folder: &str, mut nodes: Vec<TileId>, tile_bytes: u32) -> Result<u64, BakeError> {
        nodes.sort_by_cached_key(|id| archive_order(*id));
        let scratch = scratch_folder()?;
        let path = scratch.path().join("tiles");
        let failed = |cause| BakeError::io(&path, "written", cause);
        let mut file = std::io::BufWriter::new(File::create(&path).map_err(failed)?);
        let (mut start, mut index) = (0, TileIndex { bytes: format!("{folder}/bytes"), ..TileIndex::default() });
        for id in nodes {
            let mut state = u64::from(id.level()) << 59 | u64::from(id.x()) << 30 | u64::from(id.y()) << 1 | 1;
            let mut next = || {
                // xorshift64* (Vigna 2016).
                state ^= state >> 12;
                state ^= state << 25;
                state ^= state >> 27;
                state.wrapping_mul(0x2545_F491_4F6C_DD1D)
            };
            let words = (tile_bytes / 2 + (next() % u64::from(tile_bytes.max(1))) as u32).div_ceil(8).max(1);
            let tile: Vec<u8> = (0..words).flat_map(|_| next().to_le_bytes()).collect();
            file.write_all(&tile).map_err(failed)?;
            let stored = StoredTile {
                id,
                z_min_m: 0.0,
                z_max_m: 10.0,
                deviation: NodeDeviation::default(),
                offset: start,
                bytes: tile.len() as u32,
                points: 0,
                shows_children: false,
            };
            index.tiles.push((stored, short_hash(&blake3::hash(&tile))));
            start += tile.len() as u64;
        }
        file.flush().map_err(failed)?;
        drop(file);
        put_file(self.objects(), &index.bytes, &path)?;
        self.objects().write(&index_name(folder), INDEX_KIND, &index)?;
        Ok(start)
    }
}

/// The nodes of a level below a node, or itself.
fn nodes_below(root: TileId, level: u8) -> impl Iterator<Item = TileId> {
    let below = level.saturating_sub(root.level());
    let (x, y) = (root.x() << below, root.y() << below);
    (0..1_u32 << below).flat_map(move |dy| (0..1_u32 << below).filter_map(move |dx| TileId::new(level, x + dx, y + dy)))
}
