//! One block's own small scene, and the hash of all that decides its tiles.
//!
//! In: a block's bucket. Out: a [`Scene`] for `sample`; a fingerprint that says whether tiles made before still hold.
//! Next: `leaves`.
//!
//! Objects and materials are renumbered by their first occurrence in the block, so that what comes and goes elsewhere in
//! the city changes no fingerprint here.

use std::collections::HashMap;

use crate::{
    config::BakeConfig,
    error::BakeError,
    scene::{
        Material, ObjectKind, Scene, SceneObject, SceneTriangle,
        grid::CityGrid,
        partition::{LeafBlock, Partition},
        scratch_scene::{RECORD_BYTES, ScratchScene, ShortHash, short, to_record},
    },
};

/// A block's triangles with numbers of their own.
pub(super) struct BlockScene {
    triangles: Vec<SceneTriangle>,
    /// The city's numbers of the objects and of the materials.
    objects: Vec<u32>,
    materials: Vec<u32>,
}

impl BlockScene {
    pub(super) fn load(partition: &Partition, block: &LeafBlock) -> Result<Self, BakeError> {
        let mut triangles = partition.triangles(block)?;
        let (mut objects, mut materials) = (Renumbering::default(), Renumbering::default());
        for triangle in &mut triangles {
            triangle.object = objects.number(triangle.object);
            triangle.material = materials.number(triangle.material);
        }
        Ok(Self { triangles, objects: objects.order, materials: materials.order })
    }

    /// Of settings, place, triangles in their order, objects, materials and pictures.
    pub(super) fn fingerprint(
        &self,
        city: &ScratchScene,
        (config, grid): (&BakeConfig, &CityGrid),
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
        for object in self.objects.iter().map(|number| city.objects[*number as usize]) {
            bytes.push((object.kind == ObjectKind::Terrain).into());
            bytes.extend_from_slice(&object.base_z_m.to_bits().to_le_bytes());
        }
        for paint in self.materials.iter().map(|number| city.paints[*number as usize]) {
            bytes.extend_from_slice(&paint.rgb);
            bytes.push(paint.picture.is_some().into());
            bytes.extend(paint.picture.iter().flat_map(|number| city.pictures.hash(*number)));
        }
        short(&blake3::hash(&bytes))
    }

    /// With the pictures that it needs.
    pub(super) fn into_scene(self, city: &ScratchScene) -> Result<Scene, BakeError> {
        let objects = self.objects.iter().map(|number| city.objects[*number as usize]);
        let objects = objects.map(|o| SceneObject { id: String::new(), kind: o.kind, base_z_m: o.base_z_m });
        let material = |number: &u32| {
            let paint = city.paints[*number as usize];
            let texture = paint.picture.map(|number| city.pictures.get(number)).transpose()?;
            Ok(Material { rgb: paint.rgb, texture })
        };
        Ok(Scene {
            origin: city.origin,
            triangles: self.triangles,
            objects: objects.collect(),
            materials: self.materials.iter().map(material).collect::<Result<_, BakeError>>()?,
            crs: None,
        })
    }
}

/// Numbers in the order of their first use.
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

/// About how much memory it takes to bake the block.
pub(super) fn memory_bytes(block: &LeafBlock, grid: &CityGrid, margin_m: f64) -> usize {
    let cell_m = grid.cell_m;
    let side_m = grid.node_side_m(grid.depth) * f64::from(crate::scene::grid::BLOCK_LEAVES);
    // Half of a bucket's surface lies in the margin, or less where that is narrow; samples lie half a cell apart.
    let share = side_m * side_m / ((side_m + 2.0 * margin_m) * (side_m + 2.0 * margin_m));
    let samples = block.surface_m2 * share * 4.0 / (cell_m * cell_m);
    let cells = (side_m / cell_m) * (side_m / cell_m);
    let map_texels = 16.0 * cells;
    (samples * 100.0 + cells * 500.0 + map_texels * 8.0 + block.triangles as f64 * 320.0) as usize
}
