//! The scene of one block, and the fingerprint of everything that determines its tiles.
//!
//! Objects and materials are renumbered by their first occurrence in the block, so that changes elsewhere in the city
//! do not change its fingerprint.

use crate::config::BakeConfig;
use crate::error::BakeError;
use crate::hash::{ShortHash, short_hash};
use crate::scene::block_content::BlockContent;
use crate::scene::grid::{BLOCK_LEAVES, CityGrid};
use crate::scene::object_facts::{BlockObjectFacts, facts_of};
use crate::scene::partition::{LeafBlock, Partition};
use crate::scene::scratch_scene::ScratchScene;
use crate::scene::triangle_store::{RECORD_BYTES, to_record};
use crate::scene::{Landmark, ObjectKind, Scene, SceneObject, SceneTriangle};
use std::collections::HashMap;

/// The triangles of a block, with object and material numbers of the block.
pub(super) struct BlockScene {
    triangles: Vec<SceneTriangle>,
    /// Numbers of the block's objects in the city.
    objects: Vec<u32>,
    /// What is known of these.
    facts: Vec<BlockObjectFacts>,
    /// Numbers of the block's materials in the city.
    materials: Vec<u32>,
    /// From the city's origin to that of the triangles.
    origin_m: [f64; 3],
}

impl BlockScene {
    /// Reads the block's bucket, and what is known of its objects. Fails if these cannot be read or have changed.
    pub(super) fn load(
        partition: &Partition,
        city: &ScratchScene,
        block: &LeafBlock,
        grid: &CityGrid,
    ) -> Result<Self, BakeError> {
        let mut triangles = partition.triangles(block)?;
        let (mut objects, mut materials) = (Renumbering::default(), Renumbering::default());
        for triangle in &mut triangles {
            triangle.object = objects.number(triangle.object);
            triangle.material = materials.number(triangle.material);
        }
        let [x, y] = grid.block_offset_m([block.x, block.y]);
        let origin_m = [grid.corner[0] + x, grid.corner[1] + y, 0.0];
        let facts = facts_of(&city.object_facts, &objects.order)?;
        Ok(Self { triangles, objects: objects.order, facts, materials: materials.order, origin_m })
    }

    /// Hash of settings, position, triangles in order, objects, materials and textures.
    pub(super) fn fingerprint(
        &self,
        city: &ScratchScene,
        config: &BakeConfig,
        grid: &CityGrid,
        block: &LeafBlock,
    ) -> ShortHash {
        let mut bytes = Vec::with_capacity(self.triangles.len() * RECORD_BYTES + 256);
        bytes.extend_from_slice(config.settings.as_bytes());
        for number in grid.corner.into_iter().chain([grid.cell_m]) {
            bytes.extend_from_slice(&number.to_bits().to_le_bytes());
        }
        for number in [u64::from(grid.depth), block.x.into(), block.y.into(), block.leaves, block.triangles] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        for triangle in &self.triangles {
            bytes.extend_from_slice(&to_record(triangle));
        }
        for object in &self.facts {
            bytes.push(match object.kind {
                ObjectKind::Building => 0,
                ObjectKind::Terrain => 1,
                ObjectKind::GeneratedGround => 2,
            });
            bytes.extend_from_slice(&object.base_z_m.to_bits().to_le_bytes());
        }
        for Landmark { object, stone, anchor_m } in self.landmarks(city) {
            bytes.extend_from_slice(&object.to_le_bytes());
            bytes.push(stone.map_or(u8::MAX, |stone| stone));
            bytes.extend(anchor_m.iter().flat_map(|v| v.to_bits().to_le_bytes()));
        }
        for number in self.numbers() {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        for material in self.materials.iter().map(|number| city.materials[*number as usize]) {
            bytes.extend_from_slice(&material.rgb);
            bytes.push(u8::from(material.texture.is_some()) | u8::from(material.is_reflective) << 1);
            bytes.extend(material.texture.iter().flat_map(|number| city.textures.hash(*number)));
        }
        short_hash(&blake3::hash(&bytes))
    }

    /// The city's number of each object of the block.
    fn numbers(&self) -> impl Iterator<Item = u32> {
        self.facts.iter().map(|object| object.number)
    }

    /// The landmarks in the block, by its own numbers, relative to its origin.
    fn landmarks(&self, city: &ScratchScene) -> impl Iterator<Item = Landmark> {
        let of_block = |landmark: &Landmark| {
            let object = self.objects.iter().position(|object| *object == landmark.object)?;
            let anchor_m = |axis: usize| (f64::from(landmark.anchor_m[axis]) - self.origin_m[axis]) as f32;
            Some(Landmark { object: object as u32, anchor_m: std::array::from_fn(anchor_m), ..*landmark })
        };
        city.landmarks.iter().filter_map(of_block)
    }

    /// The block as a scene with its textures. Fails if a texture cannot be read.
    pub(super) fn into_scene(self, city: &ScratchScene) -> Result<Scene, BakeError> {
        let objects = self.facts.iter().map(|o| SceneObject { id: String::new(), kind: o.kind, base_z_m: o.base_z_m });
        let (numbers, landmarks) = (self.numbers().collect(), self.landmarks(city).collect());
        let materials = self.materials.iter().map(|number| city.load_material(city.materials[*number as usize]));
        Ok(Scene {
            origin: std::array::from_fn(|axis| city.origin[axis] + self.origin_m[axis]),
            triangles: self.triangles,
            objects: objects.collect(),
            materials: materials.collect::<Result<_, _>>()?,
            crs: None,
            numbers,
            landmarks,
        })
    }
}

/// Assigns new numbers in the order of first use.
#[derive(Default)]
struct Renumbering {
    known: HashMap<u32, u32>,
    order: Vec<u32>,
}

impl Renumbering {
    fn number(&mut self, of: u32) -> u32 {
        *self.known.entry(of).or_insert_with(|| {
            self.order.push(of);
            self.order.len() as u32 - 1
        })
    }
}

/// Estimates the memory needed to bake the block, to decide how many blocks are baked at once.
pub(super) fn estimate_memory_bytes(block: &LeafBlock, grid: &CityGrid) -> usize {
    let cells = block_cells(grid);
    // Samples are half a cell apart.
    let samples = block.content.surface_m2 * 4.0 / (grid.cell_m * grid.cell_m);
    let map_texels = 16.0 * cells;
    (samples * 100.0 + cells * 500.0 + map_texels * 8.0 + block.triangles as f64 * 320.0) as usize
}

/// Memory that the block needs if all of it is visible from everywhere.
pub(super) fn worst_memory_bytes(block: &LeafBlock, grid: &CityGrid) -> usize {
    /// Surfels, before and after they have a colour, per cell of surface.
    const SURFACE_BYTES: f64 = 450.0;
    /// Crossings per cell of surface seen from above.
    const FLAT_BYTES: f64 = 420.0;
    /// A triangle of the block in the mesh and its levels of detail.
    const TRIANGLE_BYTES: f64 = 600.0;
    let BlockContent { triangles, surface_m2, flat_m2, z_range_m: [low, high] } = block.content;
    let (cells, cell_m2) = (block_cells(grid), grid.cell_m * grid.cell_m);
    // A visibility map from near the horizon has texels of half a cell over the block's side and height.
    let height_m = f64::from((high - low).max(0.0));
    let map_texels = 6.0 * cells * (1.0 + height_m / (cells.sqrt() * grid.cell_m));
    let samples = (surface_m2 * SURFACE_BYTES + flat_m2 * FLAT_BYTES) / cell_m2;
    let all_triangles = triangles as f64 * TRIANGLE_BYTES + block.triangles as f64 * 320.0;
    (samples + cells * 500.0 + map_texels * 8.0 + all_triangles) as usize
}

fn block_cells(grid: &CityGrid) -> f64 {
    let side = grid.node_side_m(grid.depth) * f64::from(BLOCK_LEAVES) / grid.cell_m;
    side * side
}
