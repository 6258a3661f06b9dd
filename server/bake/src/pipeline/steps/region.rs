//! `region R`: bakes the leaves of a region, their meshes, and all parents up to the region's root.

use super::job::BakeSteps;
use super::layout::{CityPlan, NumberedShape, PLAN, PlannedLandmark, PlannedMaterial, PlannedTexture};
use super::region_file::{self, INDEX_KIND, TileIndex, index_name};
use super::scan::{fetch, picture_name, scratch_folder};
use super::sealed::SealedStore;
use super::shuffle::{BundleHead, BundlePlace};
use crate::error::BakeError;
use crate::hash::short_hex;
use crate::pipeline::context::{FinishedTiles, TileContext};
use crate::pipeline::far_land::FarLand;
use crate::pipeline::hashed::{HashedInput, HashedPartition};
use crate::pipeline::levels;
use crate::report::StageClock;
use crate::scene::Landmark;
use crate::scene::object_facts::BlockObjectFacts;
use crate::scene::object_records::ObjectRecords;
use crate::scene::scratch_budget::ScratchBudget;
use crate::scene::scratch_scene::{ObjectPlacement, ScratchScene, StoredMaterial};
use crate::scene::texture_store::{TextureFacts, TextureStore, texture_path};
use crate::scene::triangle_store::TriangleStore;
use crate::write::tile_pack::{PackReader, StoredTile};
use insula_protocol::TileId;
use insula_protocol::codec::bincode;
use insula_scratch::record_list::RecordList;
use std::collections::HashMap;
use std::fs;
use std::path::Path;

/// Folder of the tiles of regions by the hash of their input: other jobs find them too.
pub(super) const TILES: &str = "tiles";

/// Folder of a region's objects in the store.
pub(super) fn folder_name(region: usize) -> String {
    format!("region/{region}")
}

impl BakeSteps<'_> {
    /// Bakes a region, unless a region of the same input is in the store, from another job. Fails if a chunk is not shuffled, or as baking
    /// a city does.
    pub(super) fn region(&self, region: usize) -> Result<(), BakeError> {
        let plan = self.read_plan()?;
        self.check_task("region", region, plan.regions.len())?;
        let (objects, name) = (self.objects(), index_name(&folder_name(region)));
        let bundles = self.bundles(plan.chunks, region)?;
        let input = self.input_hash(&plan, region, &bundles)?;
        let of_input = SealedStore { job: &input, ..objects };
        let shared = format!("{TILES}/{input}");
        let index = match of_input.find::<TileIndex>(&index_name(&shared), INDEX_KIND)? {
            Some(index) => index,
            None => self.bake_index(&plan, region, &bundles, (of_input, &shared))?,
        };
        objects.write(&name, INDEX_KIND, &index)
    }

    /// Hash of everything that determines the tiles of a region.
    fn input_hash(
        &self,
        plan: &CityPlan,
        region: usize,
        bundles: &[(usize, BundlePlace)],
    ) -> Result<String, BakeError> {
        let place = plan.regions.get(region);
        let given = (&self.job.program(), &self.config.settings, plan.grid, plan.facts.origin, plan.plane_m, plan.land);
        let bytes = bincode::to_bytes(&(given, plan.region_level, place));
        let damaged = |_| self.objects().damaged(PLAN, "its fields are damaged");
        let mut hasher = blake3::Hasher::new();
        hasher.update(&bytes.map_err(damaged)?);
        for (_, place) in bundles {
            hasher.update(&place.hash);
        }
        Ok(short_hex(&hasher.finalize()))
    }

    /// Bakes a region into objects of these names.
    fn bake_index(
        &self,
        plan: &CityPlan,
        region: usize,
        bundles: &[(usize, BundlePlace)],
        (objects, name): (SealedStore<'_>, &str),
    ) -> Result<TileIndex, BakeError> {
        let folder = scratch_folder()?;
        let packs = folder.path().join("packs");
        fs::create_dir(&packs).map_err(|cause| BakeError::io(&packs, "created", cause))?;
        let city = self.region_scene(plan, bundles, folder.path())?;
        let (tiles, partition) = self.bake_region(plan, region, city, folder.path(), &packs)?;
        let mut reader = PackReader::new(&packs);
        let root = tiles.tree.level(plan.region_level).first();
        let root_points = root.map(|root| reader.read_points(root)).transpose()?.unwrap_or_default();
        let fingerprints = partition.fingerprints();
        let index = TileIndex { fingerprints, root_points, ..TileIndex::default() };
        let (levels, path) = (plan.region_level..=plan.grid.depth, folder.path().join("tiles"));
        region_file::write(objects, name, &tiles.tree, levels, &mut reader, index, &path)
    }

    /// Bakes the scene of a region into packs.
    fn bake_region(
        &self,
        plan: &CityPlan,
        region: usize,
        mut city: ScratchScene,
        folder: &Path,
        packs: &Path,
    ) -> Result<(FinishedTiles, HashedPartition), BakeError> {
        let (grid, config, progress) = (&plan.grid, &self.config, self.progress);
        let square = plan.square(region).ok_or_else(|| BakeError::Scratch { path: folder.to_owned() })?;
        let budget = ScratchBudget::new(config.options.scratch_bytes);
        let input = HashedInput { city: &city, grid, config, budget: &budget };
        progress.stage("partition", city.triangles);
        let partition = HashedPartition::new(input, &folder.join("buckets"), square, |n| progress.advance(n))?;
        city.drop_triangles();
        let (pool, plane_m, top) = (&config.thread_pool()?, plan.plane_m, plan.region_level);
        let context = TileContext { config, grid, pool, packs, progress, previous: None, plane_m };
        let models = self.land(plan)?;
        let root = plan.regions.get(region).and_then(|[x, y]| TileId::new(top, *x, *y));
        let land = |leaves: &[StoredTile]| {
            // That of the root's own level is the crown's, which knows the regions around.
            let (nodes, levels) = (leaves.iter().map(|leaf| leaf.id), top + 1..=grid.depth);
            let around = models.as_ref().zip(root);
            Ok(around.map(|(models, root)| FarLand::within(models, plan.facts.origin, grid, nodes, root, levels)))
        };
        let tiles = levels::bake(&context, &mut StageClock::new(), city, &partition, top, land)?;
        Ok((tiles, partition))
    }

    /// The part of the city that a region needs, with triangles and textures in a folder.
    fn region_scene(
        &self,
        plan: &CityPlan,
        bundles: &[(usize, BundlePlace)],
        folder: &Path,
    ) -> Result<ScratchScene, BakeError> {
        let objects = self.objects();
        let budget = ScratchBudget::new(self.config.options.scratch_bytes);
        let mut builder = RegionBuilder::default();
        let mut stored = TriangleStore::in_file(folder.join("triangles"), budget.clone())?;
        for (chunk, place) in bundles {
            let bundle = self.bundle(*chunk, *place)?;
            let first_object = builder.placements.len() as u32;
            let materials = builder.add(&bundle.head);
            for mut triangle in bundle.triangles {
                triangle.object += first_object;
                triangle.material = materials[triangle.material as usize];
                stored.push(triangle);
                builder.triangles += 1;
            }
        }
        stored.finish()?;
        let textures = folder.join("textures");
        fs::create_dir(&textures).map_err(|cause| BakeError::io(&textures, "created", cause))?;
        for (number, picture) in (0..).zip(&builder.pictures) {
            fetch(objects, &picture_name(*picture), &texture_path(&textures, number))?;
        }
        let cache_bytes = self.config.texture_cache_bytes();
        Ok(ScratchScene {
            origin: plan.facts.origin,
            crs: None,
            bounds: None,
            objects: RecordList::default(),
            object_facts: builder.objects.into(),
            landmarks: builder.landmarks,
            standing: Vec::new(),
            parents: RecordList::default(),
            records: ObjectRecords::Memory(Vec::new()),
            materials: builder.materials,
            textures: TextureStore::of_files(builder.textures, textures, cache_bytes),
            triangles: builder.triangles,
            names: RecordList::default(),
            placements: builder.placements.into(),
            stored,
        })
    }
}

/// Collects what the bundles of a region show.
#[derive(Default)]
struct RegionBuilder {
    objects: Vec<BlockObjectFacts>,
    landmarks: Vec<Landmark>,
    placements: Vec<ObjectPlacement>,
    materials: Vec<StoredMaterial>,
    material_numbers: HashMap<StoredMaterial, u32>,
    textures: Vec<TextureFacts>,
    pictures: Vec<crate::hash::ShortHash>,
    texture_numbers: HashMap<PlannedTexture, u32>,
    triangles: u64,
}

impl RegionBuilder {
    /// Adds what a bundle shows, and returns the number of each of its materials.
    fn add(&mut self, head: &BundleHead) -> Vec<u32> {
        for planned in &head.objects {
            let object = planned.shown.map(|shown| {
                let NumberedShape { kind, base_z_m, number, .. } = shown;
                self.objects.push(BlockObjectFacts { kind, base_z_m, number });
                let object = self.objects.len() as u32 - 1;
                self.landmarks.extend(shown.landmark.map(|PlannedLandmark { stone, anchor_m }| Landmark {
                    object,
                    stone,
                    anchor_m,
                }));
                object
            });
            self.placements.push(ObjectPlacement { offset_m: planned.offset_m, object });
        }
        let mut own = Vec::with_capacity(head.textures.len());
        for texture in &head.textures {
            let next = self.textures.len() as u32;
            let number = *self.texture_numbers.entry(texture.clone()).or_insert(next);
            if number == next {
                self.textures.push(texture.facts.clone());
                self.pictures.push(texture.picture);
            }
            own.push(number);
        }
        let material = |planned: &PlannedMaterial| {
            let texture = planned.texture.and_then(|texture| own.get(texture as usize).copied());
            let stored = StoredMaterial { rgb: planned.rgb, texture, is_reflective: planned.is_reflective };
            let next = self.materials.len() as u32;
            let number = *self.material_numbers.entry(stored).or_insert(next);
            if number == next {
                self.materials.push(stored);
            }
            number
        };
        head.materials.iter().map(material).collect()
    }
}
