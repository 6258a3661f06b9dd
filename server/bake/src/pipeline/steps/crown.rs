//! `crown`: bakes the levels above the regions' roots.

use super::job::BakeSteps;
use super::layout::CityPlan;
use super::region;
use super::region_file::{self, INDEX_KIND, TileIndex, index_name};
use super::scan::scratch_folder;
use crate::error::BakeError;
use crate::hash::ShortHash;
use crate::pipeline::context::{FinishedTiles, TileContext};
use crate::pipeline::far_land::FarLand;
use crate::pipeline::levels;
use crate::report::StageClock;
use crate::write::tile_pack::{self, EncodedPack, EncodedTile, PackNodes, PackReader, StoredTile};
use crate::write::tile_tree::TileTree;
use insula_protocol::TileId;
use std::collections::HashSet;
use std::fs;

/// Folder of the crown's objects in the store.
pub(super) const FOLDER: &str = "crown";

impl BakeSteps<'_> {
    /// Bakes the levels above the regions. Fails if a region is not baked.
    pub(super) fn crown(&self) -> Result<(), BakeError> {
        let plan = self.read_plan()?;
        let objects = self.objects();
        let folder = scratch_folder()?;
        let packs = folder.path().join("packs");
        fs::create_dir(&packs).map_err(|cause| BakeError::io(&packs, "created", cause))?;
        let (config, grid, progress, plane_m) = (&self.config, &plan.grid, self.progress, plan.plane_m);
        let pool = &config.thread_pool()?;
        let context = TileContext { config, grid, pool, packs: &packs, progress, previous: None, plane_m };
        let mut tiles = FinishedTiles::new(&context);
        let (mut roots, of_city) = self.region_roots(&plan)?;
        if of_city.is_empty() {
            return Err(BakeError::Empty { triangles: plan.facts.triangles as usize, cell_m: config.options.cell_m });
        }
        let models = self.land(&plan)?;
        let levels = 0..=plan.region_level;
        let land = models
            .as_ref()
            .map(|models| FarLand::within(models, plan.facts.origin, grid, of_city.into_iter(), TileId::ROOT, levels));
        let own: HashSet<TileId> = land.iter().flat_map(|land| land.nodes(plan.region_level)).copied().collect();
        for id in land.iter().flat_map(|land| land.nodes(plan.region_level)) {
            roots.extend(land.as_ref().map(|land| land.bake(config, grid, *id)).transpose()?.flatten());
        }
        let by_id: std::collections::HashMap<_, _> = roots.iter().map(|root| (root.id, root)).collect();
        let mut stored: Vec<StoredTile> = Vec::with_capacity(roots.len());
        for PackNodes { pack, nodes } in PackNodes::group(roots.iter().map(|root| root.id).collect()) {
            let tiles = nodes.iter().filter_map(|id| by_id.get(id).copied().cloned()).collect();
            let content = EncodedPack { tiles, meshes: Vec::new() };
            stored.extend(tile_pack::write(&packs, pack, ShortHash::default(), &content)?.tiles);
        }
        drop(by_id);
        drop(roots);
        tiles.tree.set(plan.region_level, stored);
        let clock = &mut StageClock::new();
        levels::bake_parents(&context, clock, land.as_ref(), 0..plan.region_level, &mut tiles)?;
        let mut above = TileTree::new(grid.depth);
        (0..plan.region_level).for_each(|level| above.set(level, tiles.tree.level(level).to_vec()));
        let own_roots = tiles.tree.level(plan.region_level).iter().filter(|tile| own.contains(&tile.id));
        above.set(plan.region_level, own_roots.cloned().collect());
        let (bytes, path) = (&mut PackReader::new(&packs), folder.path().join("tiles"));
        region_file::write(objects, FOLDER, &above, 0..=plan.region_level, bytes, TileIndex::default(), &path).map(drop)
    }

    /// The tiles of the regions' roots, as far as they have content, and those of which have leaves of the city.
    fn region_roots(&self, plan: &CityPlan) -> Result<(Vec<EncodedTile>, Vec<TileId>), BakeError> {
        let objects = self.objects();
        self.progress.stage("regions", plan.regions.len() as u64);
        let (mut roots, mut of_city) = (Vec::new(), Vec::new());
        for region in 0..plan.regions.len() {
            let folder = region::folder_name(region);
            let index: TileIndex = objects.read(&index_name(&folder), INDEX_KIND)?;
            self.progress.advance(1);
            // The root is the first tile of a region.
            let Some((root, _)) = index.tiles.first() else { continue };
            let StoredTile { id, z_min_m, z_max_m, deviation, offset, bytes, shows_children, .. } = *root;
            if id.level() != plan.region_level {
                return Err(objects.damaged(&index_name(&folder), "its fields are damaged"));
            }
            let bytes = objects.store.range(&index.bytes, offset, bytes.into());
            let bytes = bytes.map_err(|cause| objects.failed(&index.bytes, cause))?;
            let points = index.root_points;
            let has_leaf = index.tiles.iter().any(|(tile, _)| tile.id.level() == plan.grid.depth);
            of_city.extend(has_leaf.then_some(id));
            roots.push(EncodedTile { id, z_min_m, z_max_m, deviation, points, bytes, shows_children });
        }
        Ok((roots, of_city))
    }
}
